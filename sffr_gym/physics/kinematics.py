"""Points of the robot in plain NumPy, for all that is not a hot loop: the rigid part's Jacobians, the panels' tips.

Inertial axes throughout; see ``model`` for frames and signs. The compiled counterparts are in ``arms``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sffr_gym.physics.beam import N_TIP
from sffr_gym.physics.model import N_BASE, Model, mode_slice
from sffr_gym.types import Array


class Point(NamedTuple):
    """A point of the rigid part and how it moves."""

    x: Array  #: (2,) position [m]
    J: Array  #: (2, n) Jacobian, xd = J qd
    Jd_qd: Array  #: (2,) its acceleration at qdd = 0 [m/s2]
    w: Array  #: (n,) Jacobian of the angular velocity of the body that the point belongs to


def base_point(model: Model, q: Array, qd: Array, offset: Array) -> Point:
    """Return the point fixed in the base at ``offset`` (2,) [m], base frame (Eq. 49)."""
    n = N_BASE + len(model.link_mass)
    r = rotation(q[2]) @ offset
    J, w = np.zeros((2, n)), np.zeros(n)
    J[:, :2] = np.eye(2)
    J[:, 2] = perpendicular(r)
    w[2] = 1.0
    return Point(q[:2] + r, J, -(qd[2] ** 2) * r, w)


def arm_points(model: Model, q: Array, qd: Array, arm: int) -> tuple[list[Point], Point]:
    """Return the centres of mass of an arm's links, and its tip."""
    joint = base_point(model, q, qd, model.arm_mount[arm])
    centres, angle, w = [], q[2] + model.arm_angle[arm], joint.w
    for k in range(model.arm_first[arm], model.arm_first[arm + 1]):
        angle = angle + q[N_BASE + k]
        w = w.copy()
        w[N_BASE + k] = 1.0
        along = np.array([np.cos(angle), np.sin(angle)])
        centres.append(_beyond(joint, along, model.link_com[k], w, qd))
        joint = _beyond(joint, along, model.link_length[k], w, qd)
    return centres, joint


def rotation(angle: float) -> Array:
    """Return the planar rotation matrix (2, 2) of an angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def perpendicular(r: Array) -> Array:
    """Return the velocity of a point at ``r`` (2,) for unit angular velocity: z x r."""
    return np.array([-r[1], r[0]])


def grasp_points(model: Model, x_obj: Array) -> Array:
    """Return the inertial positions (n_g, 2) [m] of the grasp points of an object at pose ``x_obj`` (3,)."""
    return x_obj[:2] + model.grasp_point @ rotation(x_obj[2]).T


def tip_deflections(model: Model, p: Array) -> Array:
    """Return the panels' transverse tip deflections (rows, n_p) [m] of positions (rows, n)."""
    return modal_tip_deflections(model, p[:, mode_slice(model)].reshape(len(p), *model.omega2.shape))


def modal_tip_deflections(model: Model, amplitudes: Array) -> Array:
    """Return the panels' transverse tip deflections (rows, n_p) [m] of modal amplitudes (rows, n_p, n_m)."""
    tips: Array = np.einsum("pm,tpm->tp", model.shapes[:, -N_TIP + 1, :], amplitudes)
    return tips


def _beyond(joint: Point, along: Array, distance: float, w: Array, qd: Array) -> Point:
    """Return the point of a link at a distance from its joint [m], in the link's direction."""
    r = distance * along
    J = joint.J + perpendicular(r)[:, None] * w
    return Point(joint.x + r, J, joint.Jd_qd - (w @ qd) ** 2 * r, w)
