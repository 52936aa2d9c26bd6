"""Angles in the kernels: wrapped to a turn, and cosines and sines of angles near one whose own are known.

Calls of the system's sine and cosine took an eighth of a control period. Within a step no angle turns far, so that its
cosine and sine follow from those at the step's start by the turn between, for which short series are exact to rounding.
"""

from __future__ import annotations

from math import cos, pi, sin

from sffr_gym._jit import kernel
from sffr_gym.lanes import any_lane, floor, where

NEAR = 0.03  # rad; the first neglected terms of the series are below 2e-17


@kernel(inline=True)
def wrap(angle):
    """The same angle in [-pi, pi), up to rounding."""
    return angle - 2.0 * pi * floor((angle + pi) / (2.0 * pi))


@kernel(inline=True)
def cos_sin_near(anchor, angle, anew):
    """Cosine and sine of an angle [rad].

    anchor: (3,) an angle, its cosine and its sine; moved to ``angle`` if that is far off, or if ``anew``.
    """
    if anew:
        anchor[0], anchor[1], anchor[2] = angle, cos(angle), sin(angle)
        return anchor[1], anchor[2]
    turn = angle - anchor[0]
    far = abs(turn) >= NEAR
    if any_lane(far):
        anchor[0] = where(far, angle, anchor[0])
        anchor[1], anchor[2] = where(far, cos(angle), anchor[1]), where(far, sin(angle), anchor[2])
        turn = angle - anchor[0]
    z = turn * turn
    s = turn * (1.0 - z * (1.0 / 6.0) * (1.0 - z * (1.0 / 20.0) * (1.0 - z * (1.0 / 42.0))))
    less = -0.5 * z * (1.0 - z * (1.0 / 12.0) * (1.0 - z * (1.0 / 30.0)))  # cos(turn) - 1
    c0, s0 = anchor[1], anchor[2]
    return c0 + (c0 * less - s0 * s), s0 + (s0 * less + c0 * s)
