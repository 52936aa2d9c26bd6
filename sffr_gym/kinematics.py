"""Positions, velocities and Jacobians of points of the rigid part, in plain NumPy, for all that is not a hot loop.

Inertial axes throughout; see ``model`` for frames and signs. The compiled counterparts are in ``arms``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sffr_gym.beam import Array
from sffr_gym.model import N_BASE, Model


class Point(NamedTuple):
    """A point of the rigid part and how it moves.

    Attributes:
        x: (2,) position [m].
        J: (2, n) Jacobian, xd = J qd.
        Jd_qd: (2,) its acceleration at qdd = 0 [m/s2].
        w: (n,) Jacobian of the angular velocity of the body that the point belongs to.
    """

    x: Array
    J: Array
    Jd_qd: Array
    w: Array


def base_point(model: Model, q: Array, qd: Array, offset: Array) -> Point:
    """A point fixed in the base at ``offset`` (2,) [m], base frame (Eq. 49)."""
    n = N_BASE + len(model.link_mass)
    r = rotation(q[2]) @ offset
    J, w = np.zeros((2, n)), np.zeros(n)
    J[:, :2] = np.eye(2)
    J[:, 2] = perpendicular(r)
    w[2] = 1.0
    return Point(q[:2] + r, J, -(qd[2] ** 2) * r, w)


def arm_points(model: Model, q: Array, qd: Array, arm: int) -> tuple[list[Point], Point]:
    """Centres of mass of an arm's links, and its tip."""
    mount = model.arm_mount[arm]
    joint = base_point(model, q, qd, mount[:2])
    centres, angle, w = [], q[2] + mount[2], joint.w
    for k in range(model.arm_first[arm], model.arm_first[arm + 1]):
        angle = angle + q[N_BASE + k]
        w = w.copy()
        w[N_BASE + k] = 1.0
        along = np.array([np.cos(angle), np.sin(angle)])
        centres.append(_beyond(joint, along, model.link_com[k], w, qd))
        joint = _beyond(joint, along, model.link_length[k], w, qd)
    return centres, joint


def rotation(angle: float) -> Array:
    """Planar rotation matrix."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def perpendicular(r: Array) -> Array:
    """Velocity of a point at ``r`` (2,) for unit angular velocity: z x r."""
    return np.array([-r[1], r[0]])


def grasp_points(model: Model, x_obj: Array) -> Array:
    """Inertial positions (n_g, 2) of the grasp points of an object at pose ``x_obj`` (3,)."""
    return x_obj[:2] + model.grasp_point @ rotation(x_obj[2]).T


def _beyond(joint: Point, along: Array, distance: float, w: Array, qd: Array) -> Point:
    """The point of a link at a distance from its joint, in the link's direction."""
    r = distance * along
    J = joint.J + np.outer(perpendicular(r), w)
    return Point(joint.x + r, J, joint.Jd_qd - (w @ qd) ** 2 * r, w)
