"""The desired motion: the object's centre on a circle, base and grippers in formation with it (sec. 5.3).

The *reference axes* turn with the desired heading: they are the inertial axes when the heading is fixed, and turn with
the path when it is tangent. In them the formation (base offset, grasp points, orientations) is constant.
"""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple

import numpy as np

from sffr_gym.compile.kernels import kernel
from sffr_gym.config.params import Params
from sffr_gym.physics.model import Model, joint_slice, object_slice
from sffr_gym.types import Array


class Reference(NamedTuple):
    """Constants of one episode's desired motion. Without an object the base itself follows the path."""

    radius: float  #: [m]
    rate: float  #: angular rate along the circle [rad/s]
    phase: float  #: angle on the circle at t = 0 [rad]
    turning: float  #: turn of the heading for each turn along the path: 1 if it follows the path, else 0 [-]
    x0: float  #: desired position of the object at t = 0 [m]
    y0: float
    base_x: float  #: base relative to the object, reference axes [m]
    base_y: float
    yaw: float  #: orientation of base and object relative to the reference axes [rad]
    phi: float
    joints: Array  #: (n_l,) joint angles at the start, which held joints keep [rad]


class Desired(NamedTuple):
    """Desired motion of the object at one time: position [m], velocity, acceleration (inertial axes) and heading."""

    x: float
    y: float
    xd: float
    yd: float
    xdd: float
    ydd: float
    heading: float  #: angle of the reference axes [rad]
    turn: float  #: its rate [rad/s]


def circle_reference(
    params: Params, model: Model, p: Array, speed: float | None = None, phase: float = 0.0
) -> Reference:
    """Return the circle that leaves from the object's pose in ``p`` (n,), tangent to +x at phase 0.

    Args:
        params: the path's radius, speed and heading.
        model: the robot.
        p: positions of the undisturbed start; the formation is read from it.
        speed: path speed if it differs from the configured one [m/s].
        phase: angle on the circle at the start [rad].
    """
    carried = p[object_slice(model)] if model.object_mass > 0 else p[:3]
    return Reference(
        radius=params.path.radius,
        rate=(params.path.speed if speed is None else speed) / params.path.radius,
        phase=phase,
        turning=1.0 if params.path.heading == "tangent" else 0.0,
        x0=float(carried[0]),
        y0=float(carried[1]),
        base_x=float(p[0] - carried[0]),
        base_y=float(p[1] - carried[1]),
        yaw=float(p[2]),
        phi=float(carried[2]),
        joints=p[joint_slice(model)].copy(),
    )


def flat_reference(reference: Reference) -> Array:
    """Return the numbers (10 + n_l,) of a reference, the joints last."""
    return np.concatenate([reference[:-1], reference.joints])


@kernel
def reference_at(row):
    """The :class:`Reference` of the numbers (10 + n_l,) that :func:`flat_reference` returns."""
    return Reference(row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10:])


@kernel
def desired(reference, t):
    """Desired motion of the object at time ``t`` [s] as a :class:`Desired`."""
    radius, rate = reference.radius, reference.rate
    angle = reference.phase + rate * t
    c, s = cos(angle), sin(angle)
    speed = radius * rate
    return Desired(
        reference.x0 + radius * (s - sin(reference.phase)),
        reference.y0 + radius * (cos(reference.phase) - c),
        speed * c,
        speed * s,
        -speed * rate * s,
        speed * rate * c,
        reference.turning * rate * t,
        reference.turning * rate,
    )
