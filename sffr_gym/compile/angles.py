"""Angles in the kernels: wrapped to a turn, and cosines and sines of angles near one whose own are known.

Calls of the system's sine and cosine took an eighth of a control period. Within a step no angle turns far, so that its
cosine and sine follow from those at the step's start by the turn between, for which short series are exact to rounding.
"""

from __future__ import annotations

from math import cos, pi, sin
from typing import NamedTuple

from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.lanes import any_lane, floor, where
from sffr_gym.types import Array

NEAR = 0.03  # rad; the first neglected terms of the series are below 2e-17


class Anchor(NamedTuple):
    """Angles whose cosines and sines are known."""

    angle: Array  #: (n,) [rad]
    cos: Array  #: (n,)
    sin: Array  #: (n,)


def anchor_shapes(n):
    """Shapes of an :class:`Anchor` of ``n`` angles."""
    return Anchor(angle=(n,), cos=(n,), sin=(n,))


@kernel
def wrap(angle):
    """The same angle in [-pi, pi), up to rounding."""
    return angle - 2.0 * pi * floor((angle + pi) / (2.0 * pi))


@kernel
def cos_sin_near(anchor, k, angle, refresh):
    """Cosine and sine of an angle [rad].

    anchor: an :class:`Anchor`, whose angle ``k`` moves to this one if that is far off, or if ``refresh`` (bool).
    """
    if refresh:
        anchor.angle[k], anchor.cos[k], anchor.sin[k] = angle, cos(angle), sin(angle)
        return anchor.cos[k], anchor.sin[k]
    turn = angle - anchor.angle[k]
    far = abs(turn) >= NEAR
    if any_lane(far):
        anchor.angle[k] = where(far, angle, anchor.angle[k])
        anchor.cos[k], anchor.sin[k] = where(far, cos(angle), anchor.cos[k]), where(far, sin(angle), anchor.sin[k])
        turn = angle - anchor.angle[k]
    z = turn * turn
    s = turn * (1.0 - z * (1.0 / 6.0) * (1.0 - z * (1.0 / 20.0) * (1.0 - z * (1.0 / 42.0))))
    less = -0.5 * z * (1.0 - z * (1.0 / 12.0) * (1.0 - z * (1.0 / 30.0)))  # cos(turn) - 1
    c0, s0 = anchor.cos[k], anchor.sin[k]
    return c0 + (c0 * less - s0 * s), s0 + (s0 * less + c0 * s)
