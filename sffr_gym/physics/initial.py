"""Initial states: from the parameters to positions and velocities that satisfy the grasps exactly."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sffr_gym.config.params import Params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.physics.beam import N_TIP
from sffr_gym.physics.kinematics import arm_points, grasp_points, perpendicular, rotation
from sffr_gym.physics.model import N_BASE, Model, joint_slice, modal, mode_slice, object_slice
from sffr_gym.physics.reach import initial_joints, reach
from sffr_gym.types import Array

ASSEMBLY_TOLERANCE = 1.0e-14  # m, gap at which Newton's iteration stops
ASSEMBLY_STEPS = 20
LARGEST_ADJUSTMENT = 0.05  # rad, more than rounding of the joint angles can need


def initial_positions(params: Params, model: Model) -> tuple[Array, Array]:
    """Return positions and velocities ``p, v`` (n,) of the configured start, the object at rest in the grippers.

    Joint angles and rates of the grasping arms are corrected by what the pins ask for (rounding of Table IV's digits).

    Raises:
        ConfigError: if the end-effectors cannot reach the grasp points from the given joint angles.
    """
    p, v = np.zeros(model.at.end), np.zeros(model.at.end)
    rigid = slice(0, joint_slice(model).stop)
    p[rigid] = [*params.initial.q[:N_BASE], *initial_joints(params)]
    if params.initial.qd is not None:
        v[rigid] = params.initial.qd
    p[mode_slice(model)] = modal(model, tip_displacement(model, params.initial.qf))
    v[mode_slice(model)] = modal(model, tip_displacement(model, params.initial.qfd))
    if params.object is not None:
        p[object_slice(model)] = _object_pose(model, p[rigid], v[rigid])
        close_grasps(model, p)
    if params.initial.qd is None:
        v[:N_BASE] = _along_path(params, p[:2], p[object_slice(model)][:2] if params.object else p[:2])
    if params.object is not None:
        match_velocities(model, p, v)
    return p, v


def held_positions(params: Params, model: Model, pose: ArrayLike | None, guess: ArrayLike | None) -> Array:
    """Return positions (n,) with straight panels and the object held at a pose; see :func:`reach.reach`."""
    held, p = reach(params, pose, guess), np.zeros(model.at.end)
    base = params.initial.q[:N_BASE]
    p[: model.at.modes] = [*base, *held.joints]
    p[object_slice(model)] = [*(base[:2] + rotation(base[2]) @ held.pose[:2]), base[2] + held.pose[2]]
    close_grasps(model, p)
    return p


def _along_path(params: Params, base: Array, carried: Array) -> Array:
    """Return the velocity (3,) of the base with which the body at ``carried`` moves along the path, all as one."""
    x, y, turn = params.path.start
    return np.append(np.array([x, y]) + turn * perpendicular(base - carried), turn)


def tip_displacement(model: Model, tip: tuple) -> Array:
    """Return nodal coordinates (n_p, n_f) of panels whose tips are displaced: the static shape under tip loads.

    Args:
        model: the robot.
        tip: three numbers for every panel, or three for each (axial m, transverse m, slope rad, or their rates).
    """
    n_p, n_f = model.shapes.shape[:2]
    tips = np.broadcast_to(np.asarray(tip, dtype=float), (n_p, N_TIP))
    length = model.panel_length[:, None]
    xi = np.arange(1, n_f // N_TIP + 1) / (n_f // N_TIP)
    nodes = np.zeros((n_p, len(xi), N_TIP))
    w, s = tips[:, 1, None], tips[:, 2, None] * length
    nodes[:, :, 0] = tips[:, 0, None] * xi
    nodes[:, :, 1] = w * (3 * xi**2 - 2 * xi**3) + s * (xi**3 - xi**2)
    nodes[:, :, 2] = (w * (6 * xi - 6 * xi**2) + s * (3 * xi**2 - 2 * xi)) / length
    return nodes.reshape(n_p, n_f)


def close_grasps(model: Model, p: Array) -> None:
    """Move the joints of the grasping arms, in place, until every tip sits on its grasp point.

    Raises:
        ConfigError: if the gap does not close within a small correction.
    """
    start = p[joint_slice(model)].copy()
    n, still = joint_slice(model).stop, np.zeros(joint_slice(model).stop)
    at = object_slice(model)
    for _ in range(ASSEMBLY_STEPS):
        targets = grasp_points(model, p[at])
        gaps = []
        for g, arm in enumerate(model.grasp_arm):
            _, tip = arm_points(model, p[:n], still, int(arm))
            gaps.append(np.linalg.norm(targets[g] - tip.x))
            joints = _joints(model, int(arm))
            p[joints] += np.linalg.pinv(tip.J[:, joints]) @ (targets[g] - tip.x)
        if max(gaps, default=0.0) < ASSEMBLY_TOLERANCE:
            break
    moved = np.abs(p[joint_slice(model)] - start).max(initial=0.0)
    if not moved < LARGEST_ADJUSTMENT:
        raise ConfigError(
            f"initial.q: the end-effectors do not reach the object's grasp points: closing the grasp would move a "
            f"joint by {moved:.3g} rad, more than the {LARGEST_ADJUSTMENT} rad that rounding may need; change "
            f"initial.q or object.grasps"
        )


def match_velocities(model: Model, p: Array, v: Array) -> None:
    """Give the object, in place, the velocity that the grippers share, and their joints the rates that keep it."""
    v[object_slice(model)] = _object_twist(model, p, v)
    match_joint_rates(model, p, v)


def match_joint_rates(model: Model, p: Array, v: Array) -> None:
    """Give the joints of the grasping arms, in place, the rates that keep the grasps of the moving object."""
    n, at = joint_slice(model).stop, object_slice(model)
    for g, arm in enumerate(model.grasp_arm):
        _, tip = arm_points(model, p[:n], v[:n], int(arm))
        joints = _joints(model, int(arm))
        r = rotation(p[at][2]) @ model.grasp_point[g]
        desired = v[at][:2] + v[at][2] * perpendicular(r)
        v[joints] += np.linalg.pinv(tip.J[:, joints]) @ (desired - tip.J @ v[:n])


def _object_twist(model: Model, p: Array, v: Array) -> Array:
    """Return the object's velocity (3,) nearest to the tips' velocities: at rest relative to the grippers."""
    n, at = joint_slice(model).stop, object_slice(model)
    velocities, rows = [], []
    for g, arm in enumerate(model.grasp_arm):
        _, tip = arm_points(model, p[:n], v[:n], int(arm))
        velocities.append(tip.J @ v[:n])
        rows.append(np.column_stack([np.eye(2), perpendicular(rotation(p[at][2]) @ model.grasp_point[g])]))
    return np.linalg.lstsq(np.vstack(rows), np.concatenate(velocities), rcond=None)[0]


def _object_pose(model: Model, q: Array, qd: Array) -> Array:
    """Return the pose (3,) whose grasp points lie nearest to the arms' tips; turned as the base for a single grasp."""
    tips = np.array([arm_points(model, q, qd, int(arm))[1].x for arm in model.grasp_arm])
    points = model.grasp_point
    centre, middle = tips.mean(axis=0), points.mean(axis=0)
    along = (tips - centre).ravel() @ (points - middle).ravel()
    across = sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(points - middle, tips - centre, strict=True))
    angle = float(np.arctan2(across, along)) if len(tips) > 1 else float(q[2])
    return np.append(centre - rotation(angle) @ middle, angle)


def _joints(model: Model, arm: int) -> slice:
    """Return the indices of an arm's joints in ``p``."""
    return slice(N_BASE + int(model.arm_first[arm]), N_BASE + int(model.arm_first[arm + 1]))
