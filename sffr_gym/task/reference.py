"""The desired motion: the object's centre on a path, base and grippers in formation with it (sec. 5.3: on a circle).

The *reference axes* turn with the desired heading: they are the inertial axes when the heading is fixed, and turn with
the path when it is tangent, or as a slew asks. In them the formation (base offset, grasp points, orientations) is
constant. A closed path, circle or figure-eight, is a pair of harmonics of one angle; every other one consists of
polynomials in time, piece by piece.
"""

from __future__ import annotations

from math import atan2, cos, sin
from typing import NamedTuple

import numpy as np

from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.lanes import any_lane, where
from sffr_gym.config.params import Params
from sffr_gym.config.path import DEGREE, LOBES, N_PIECE
from sffr_gym.physics.model import Model, joint_slice, object_slice
from sffr_gym.types import Array

N_REFERENCE = 12  # numbers of a Reference before its arrays
Y, HEADING = DEGREE + 2, 2 * DEGREE + 3  # places in a piece; x is at 1


class Reference(NamedTuple):
    """Constants of one episode's desired motion. Without an object the base itself follows the path."""

    radius: float  #: of a closed path [m]
    rate: float  #: rate of the angle on it [rad/s]
    phase: float  #: angle on it at t = 0 [rad]
    lobes: float  #: how often x swings for each swing of y: 1 on a circle, 2 on a figure-eight [-]
    turning: float  #: turn of the heading for each turn along the path: 1 if it follows the path, else 0 [-]
    bearing: float  #: direction of the path at t = 0 [rad]
    x0: float  #: desired position of the object at t = 0 [m]
    y0: float
    base_x: float  #: base relative to the object, reference axes [m]
    base_y: float
    yaw: float  #: orientation of base and object relative to the reference axes [rad]
    phi: float
    joints: Array  #: (n_l,) joint angles at the start, which held joints keep [rad]
    pieces: Array  #: (n ``N_PIECE``,) of a path that is not closed, see :attr:`sffr_gym.config.path.Path.pieces`


class Desired(NamedTuple):
    """Desired motion of the object at one time: position [m] and its derivatives (inertial axes), and heading."""

    x: float
    y: float
    xd: float
    yd: float
    xdd: float
    ydd: float
    heading: float  #: angle of the reference axes [rad]
    turn: float  #: its rate [rad/s]
    xddd: float  #: [m/s3]
    yddd: float
    turn_acceleration: float  #: [rad/s2]
    turn_jerk: float  #: [rad/s3]


def path_reference(params: Params, model: Model, p: Array, speed: float | None = None, phase: float = 0.0) -> Reference:
    """Return the path that leaves from the object's pose in ``p`` (n,); a closed one is tangent to +x at phase 0.

    Args:
        params: the path.
        model: the robot.
        p: positions of the undisturbed start; the formation is read from it.
        speed: path speed if it differs from the configured one [m/s].
        phase: angle on a closed path at the start [rad].
    """
    carried = p[object_slice(model)] if model.object_mass > 0 else p[:3]
    path = params.path if speed is None else params.path.model_copy(update={"speed": speed})
    reference = Reference(
        radius=path.radius,
        rate=path.rate,
        phase=phase,
        lobes=LOBES.get(path.kind, 1.0),
        turning=1.0 if path.heading == "tangent" else 0.0,
        bearing=0.0,
        x0=float(carried[0]),
        y0=float(carried[1]),
        base_x=float(p[0] - carried[0]),
        base_y=float(p[1] - carried[1]),
        yaw=float(p[2]),
        phi=float(carried[2]),
        joints=p[joint_slice(model)].copy(),
        pieces=path.pieces.ravel(),
    )
    if path.kind == "circle":  # whose heading is its angle
        return reference
    start = desired(reference._replace(turning=0.0), 0.0)
    return reference._replace(bearing=atan2(start.yd, start.xd))


@kernel
def on_circle(reference):
    """Whether the path is a circle."""
    return len(reference.pieces) == 0 and reference.lobes == 1.0


def flat_reference(reference: Reference) -> Array:
    """Return the numbers (``N_REFERENCE`` + n_l + pieces,) of a reference, the joints and pieces last."""
    return np.concatenate([reference[:N_REFERENCE], reference.joints, reference.pieces])


@kernel
def reference_at(row, n_l):
    """The :class:`Reference` of the numbers that :func:`flat_reference` returns, of a robot with ``n_l`` joints."""
    return Reference(
        row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10], row[11],
        row[N_REFERENCE : N_REFERENCE + n_l], row[N_REFERENCE + n_l :],
    )  # fmt: skip


def read_reference(row: Array, model: Model) -> Reference:
    """Return the reference of numbers that :func:`flat_reference` returns, as plain Python has it."""
    numbers = dict(zip(Reference._fields, row[:N_REFERENCE].tolist(), strict=False))
    read: Reference = reference_at(row, len(model.link_mass))
    return read._replace(**numbers)


@kernel
def desired(reference, t):
    """Desired motion of the object at time ``t`` [s] as a :class:`Desired`."""
    if len(reference.pieces) > 0:
        return _on_pieces(reference, t)
    radius, rate = reference.radius, reference.rate
    angle = reference.phase + rate * t
    c, s = cos(angle), sin(angle)
    if any_lane(reference.lobes > 1.0):
        return _on_figure_eight(reference, angle, c, s)
    speed = radius * rate
    return Desired(
        reference.x0 + radius * (s - sin(reference.phase)),
        reference.y0 + radius * (cos(reference.phase) - c),
        speed * c,
        speed * s,
        -speed * rate * s,
        speed * rate * c,
        reference.turning * rate * t,
        reference.turning * rate + 0.0 * t,
        -speed * rate * rate * c,
        -speed * rate * rate * s,
        0.0 * t,
        0.0 * t,
    )


@kernel
def _on_figure_eight(reference, angle, c, s):
    """Desired motion on ``x = r sin 2 a, y = 2 r (1 - cos a)``, a lemniscate of Gerono; c, s: of the angle ``a``."""
    r, rate = reference.radius, reference.rate
    c2, s2 = cos(2.0 * angle), sin(2.0 * angle)
    xd, yd = 2.0 * r * rate * c2, 2.0 * r * rate * s
    xdd, ydd = -4.0 * r * rate * rate * s2, 2.0 * r * rate * rate * c
    xddd, yddd = -4.0 * rate * rate * xd, -rate * rate * yd
    xdddd, ydddd = -4.0 * rate * rate * xdd, -rate * rate * ydd
    x = reference.x0 + r * (s2 - sin(2.0 * reference.phase))
    y = reference.y0 + 2.0 * r * (cos(reference.phase) - c)
    heading, turn, acceleration, jerk = _along(reference, xd, yd, xdd, ydd, xddd, yddd, xdddd, ydddd)
    return Desired(x, y, xd, yd, xdd, ydd, heading, turn, xddd, yddd, acceleration, jerk)


@kernel
def _on_pieces(reference, t):
    """Desired motion on the piece that has begun last."""
    pieces, n = reference.pieces, len(reference.pieces) // N_PIECE
    x = xd = xdd = xddd = xdddd = y = yd = ydd = yddd = ydddd = a = ad = add = addd = 0.0 * t
    for k in range(n):
        at = k * N_PIECE
        inside = t >= pieces[at]
        if k + 1 < n:
            inside = inside & (t < pieces[at + N_PIECE])
        if any_lane(inside):
            s = t - pieces[at]
            f, fd, fdd, fddd, fdddd = _polynomial(pieces, at + 1, s)
            x, xd, xdd = where(inside, f, x), where(inside, fd, xd), where(inside, fdd, xdd)
            xddd, xdddd = where(inside, fddd, xddd), where(inside, fdddd, xdddd)
            f, fd, fdd, fddd, fdddd = _polynomial(pieces, at + Y, s)
            y, yd, ydd = where(inside, f, y), where(inside, fd, yd), where(inside, fdd, ydd)
            yddd, ydddd = where(inside, fddd, yddd), where(inside, fdddd, ydddd)
            f, fd, fdd, fddd, _ = _polynomial(pieces, at + HEADING, s)
            a, ad, add, addd = (
                where(inside, f, a),
                where(inside, fd, ad),
                where(inside, fdd, add),
                where(inside, fddd, addd),
            )
    heading, turn, acceleration, jerk = _along(reference, xd, yd, xdd, ydd, xddd, yddd, xdddd, ydddd)
    return Desired(
        reference.x0 + x, reference.y0 + y, xd, yd, xdd, ydd, a + heading, ad + turn, xddd, yddd,
        add + acceleration, addd + jerk,
    )  # fmt: skip


@kernel
def _polynomial(pieces, at, s):
    """A polynomial of degree ``DEGREE`` with ascending coefficients from ``pieces[at]`` on, and four derivatives."""
    f = fd = fdd = fddd = fdddd = 0.0 * s
    for k in range(DEGREE, -1, -1):  # Horner's scheme of Taylor coefficients
        fdddd = fdddd * s + fddd
        fddd = fddd * s + fdd
        fdd = fdd * s + fd
        fd = fd * s + f
        f = f * s + pieces[at + k]
    return f, fd, 2.0 * fdd, 6.0 * fddd, 24.0 * fdddd


@kernel
def _along(reference, xd, yd, xdd, ydd, xddd, yddd, xdddd, ydddd):
    """Heading along the path since the start, and three derivatives; 0 where the heading does not follow it."""
    if not any_lane(reference.turning > 0.0):
        return 0.0 * xd, 0.0 * xd, 0.0 * xd, 0.0 * xd
    on, N, D = reference.turning, xd * ydd - yd * xdd, xd * xd + yd * yd  # turn = N / D
    Nd, Dd = xd * yddd - yd * xddd, 2.0 * (xd * xdd + yd * ydd)
    Ndd = xdd * yddd - ydd * xddd + xd * ydddd - yd * xdddd
    Ddd = 2.0 * (xdd * xdd + ydd * ydd + xd * xddd + yd * yddd)
    turn = N / D
    acceleration = (Nd - turn * Dd) / D
    jerk = (Ndd - 2.0 * acceleration * Dd - turn * Ddd) / D
    heading = atan2(yd, xd) - reference.bearing
    return on * heading, on * turn, on * acceleration, on * jerk
