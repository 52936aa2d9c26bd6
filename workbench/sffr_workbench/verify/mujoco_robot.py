"""The robot in MuJoCo: a tree of joint coordinates, panels of rigid segments with hinge springs, soft grasps.

Nothing is shared with the simulator but the numbers of the configuration and the initial positions. A panel of N cells
has a hinge of stiffness EI / ds in the middle of each cell (its axial stiffness is infinite): its error is of second
order in ds, so that two runs extrapolate to the beam.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from scipy.linalg import eigh

from sffr_gym.config.params import Params
from sffr_gym.config.sections import Panel
from sffr_gym.physics.simulator import Simulator
from sffr_gym.types import Array
from sffr_workbench.verify.motion import RECORD, Motion, Piece, panel_displacement, stack

BASE_JOINTS = ("x", "y", "yaw")
OBJECT_JOINTS = ("object x", "object y", "object yaw")
STABLE = 0.8  # step [s] of the Runge-Kutta method times the squared number of segments


def simulate(params: Params, pieces: Sequence[Piece], segments: int = 20, softness: float = 1.0e-6) -> Motion:
    """Run an experiment of ``sffr_workbench.verify.motion`` by the classical Runge-Kutta method.

    Args:
        params: the robot; ``panel.elements`` and the damping are ignored.
        pieces: the forces.
        segments: hinges per panel.
        softness: part of the acceleration that a grasp lets through (1 - impedance); 0 would be rigid.
    """
    step = RECORD / np.ceil(RECORD / min(STABLE / segments**2, 2.0e-3))
    model, data = assemble(params, segments, softness, step)
    forced = [model.joint(name).dofadr[0] for name in joint_names(params)]
    every = round(RECORD / step)
    rows: list[tuple[Array, ...]] = []
    for piece in pieces:
        data.qfrc_applied[forced] = np.concatenate([piece.wrench, piece.joints])
        if not rows:
            rows.append(_row(params, model, data))
        for k in range(round(piece.duration / step)):
            mujoco.mj_step(model, data)
            if (k + 1) % every == 0:
                rows.append(_row(params, model, data))
    return stack(rows)


def assemble(params: Params, segments: int, softness: float, step: float) -> tuple[Any, Any]:
    """Return MuJoCo's model and data of the robot at rest in its initial pose; arguments as in :func:`simulate`."""
    model = _build(params, segments, softness, step).compile()
    data = mujoco.MjData(model)
    start = Simulator(params).initial_state()
    data.qpos[[model.joint(name).qposadr[0] for name in joint_names(params)]] = start.q
    if start.obj is not None:
        data.qpos[[model.joint(name).qposadr[0] for name in OBJECT_JOINTS]] = start.obj
    return model, data


def frequencies(params: Params, segments: int) -> Array:
    """Return the natural angular frequencies at the initial configuration [rad/s], without rigid motion, rising."""
    model = _build(params, segments, 0.0, 1.0e-3).compile()
    data = mujoco.MjData(model)
    data.qpos[[model.joint(name).qposadr[0] for name in joint_names(params)]] = params.initial.q
    mujoco.mj_forward(model, data)
    M = np.zeros((model.nv, model.nv))
    for row, unit in zip(M, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, row, unit)
    squares = eigh(np.diag(model.jnt_stiffness), M, eigvals_only=True)
    return np.sqrt(squares[np.count_nonzero(model.jnt_stiffness == 0.0) :])


def joint_names(params: Params) -> list[str]:
    """Return names of the joints in the order of q."""
    return [*BASE_JOINTS, *(f"{arm.name} {k}" for arm in params.arms for k in range(len(arm.links)))]


def extrapolate(coarse: Motion, fine: Motion) -> Motion:
    """Extrapolate a second-order error from two runs, the second twice as fine."""
    return Motion(*(f + (f - c) / 3.0 for c, f in zip(coarse, fine, strict=True)))


def _build(params: Params, segments: int, softness: float, step: float) -> Any:
    spec = mujoco.MjSpec()
    spec.option.gravity = [0, 0, 0]
    spec.option.timestep = step
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.tolerance = 0.0
    spec.compiler.degree = False
    base = _floating(spec, "base", BASE_JOINTS, params.base.mass, params.base.inertia)
    for arm in params.arms:
        parent, place, angle = base, arm.mount, arm.mount_angle
        for k, link in enumerate(arm.links):
            parent = _body(parent, place, angle, link.mass, link.inertia, link.com)
            _hinge(parent, f"{arm.name} {k}")
            place, angle = (link.length, 0.0), 0.0
        parent.add_site(name=f"end {arm.name}", pos=[*place, 0])
    for i, (mount, panel) in enumerate(zip(params.panel.mounts, params.panel.each, strict=True)):
        _add_panel(panel, base, mount, i, segments)
    if params.object is not None:
        held = _floating(spec, "object", OBJECT_JOINTS, params.object.mass, params.object.inertia)
        for g, grasp in enumerate(params.object.grasps):
            held.add_site(name=f"grasp {g}", pos=[*grasp.point, 0])
            pin = spec.add_equality(
                type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_SITE,
                name1=f"end {grasp.arm}", name2=f"grasp {g}",
            )  # fmt: skip
            pin.solref = [0.05, 1.0]  # s, time constant of the gap's decay, critically damped
            pin.solimp = [1.0 - softness, 1.0 - softness, 1.0, 0.5, 2.0]
    return spec


def _floating(spec: Any, name: str, joints: Sequence[str], mass: float, inertia: float) -> Any:
    body = _body(spec.worldbody, (0.0, 0.0), 0.0, mass, inertia, 0.0, name)
    for joint, axis in zip(joints[:2], ([1, 0, 0], [0, 1, 0]), strict=True):
        body.add_joint(name=joint, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    _hinge(body, joints[2])
    return body


def _body(
    parent: Any, place: Sequence[float], angle: float, mass: float, inertia: float, com: float, name: str = ""
) -> Any:
    """Add a rigid body at ``place`` (2,) of its parent, turned by ``angle``, its centre of mass at ``com``."""
    turn = [np.cos(angle / 2), 0, 0, np.sin(angle / 2)]
    return parent.add_body(
        name=name, pos=[*place, 0], quat=turn, mass=mass, inertia=[inertia] * 3, ipos=[com, 0, 0], explicitinertial=True
    )


def _hinge(body: Any, name: str, stiffness: float = 0.0) -> None:
    body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1], stiffness=stiffness)


def _add_panel(panel: Panel, base: Any, mount: Any, index: int, segments: int) -> None:
    """Add half a segment fixed to the base, whole ones between the hinges, half a segment at the tip."""
    size = panel.length / segments
    parent, place, angle = base, mount.root, mount.angle
    for k in range(segments + 1):
        length = size if 0 < k < segments else size / 2
        mass = panel.mass * length / panel.length
        parent = _body(parent, place, angle, mass, mass * length**2 / 12, length / 2)
        if k > 0:
            _hinge(parent, f"panel {index} {k}", panel.EI / size)
        place, angle = (length, 0.0), 0.0
    parent.add_site(name=f"tip {index}", pos=[*place, 0])


def _row(params: Params, model: Any, data: Any) -> tuple[Array, ...]:
    mujoco.mj_forward(model, data)
    base = np.array([data.qpos[model.joint(name).qposadr[0]] for name in BASE_JOINTS])
    tips = np.array([data.site(f"tip {i}").xpos[:2] for i in range(params.n_panels)]).reshape(-1, 2)
    grippers = np.array([data.site(f"end {arm.name}").xpos[:2] for arm in params.arms])
    if params.object is None:
        return base, panel_displacement(params, base, tips), grippers, np.zeros(0), np.zeros((0, 2))
    obj = np.array([data.qpos[model.joint(name).qposadr[0]] for name in OBJECT_JOINTS])
    n_g = len(params.object.grasps)
    lam = data.efc_force[: 3 * n_g].reshape(n_g, 3)[:, :2].copy()  # on the first site, the arm's end
    return base, panel_displacement(params, base, tips), grippers, obj, lam
