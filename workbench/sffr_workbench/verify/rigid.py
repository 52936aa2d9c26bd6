"""Checks of the rigid part (Eqs. 40-43) against Pinocchio: inertia, velocity terms, places, compiled solution."""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import numpy as np
import pinocchio as pin

from sffr_gym.config.params import Params, load_params
from sffr_gym.physics import monolithic
from sffr_gym.physics.kinematics import arm_points
from sffr_gym.physics.model import Model, pack
from sffr_gym.physics.simulator import Simulator, State
from sffr_gym.types import Array
from sffr_workbench.verify.check import Check, make_check, relative

ROUNDING = "Rounding alone; relative to the largest entry at each state."


def checks(quick: bool) -> list[partial[Check]]:
    """List the checks of this module."""
    states = 100 if quick else 1000
    return [partial(check, states=states) for check in (inertia, velocity_terms, arm_ends, solution)]


def inertia(states: int) -> Check:
    """Check H of Eq. 41 against the composite rigid body algorithm."""
    tree, data, model = _robots()
    worst = 0.0
    for q, qd in _states(model, states):
        upper = np.triu(pin.crba(tree, data, q))
        H, _ = monolithic.rigid_equations(model, q, qd)
        worst = max(worst, relative(H, upper + np.triu(upper, 1).T))
    return make_check("Eq. 41a, rigid H", f"Pinocchio, {states} random states", worst, 1.0e-11, "", ROUNDING)


def velocity_terms(states: int) -> Check:
    """Check C of Eqs. 41b and 41c against the recursive Newton-Euler algorithm."""
    tree, data, model = _robots()
    worst = 0.0
    for q, qd in _states(model, states):
        _, C = monolithic.rigid_equations(model, q, qd)
        worst = max(worst, relative(C, pin.nonLinearEffects(tree, data, q, qd)))
    return make_check("Eqs. 41b, 41c, rigid C", f"Pinocchio, {states} random states", worst, 1.0e-11, "", ROUNDING)


def arm_ends(states: int) -> Check:
    """Check places, Jacobians and velocity-dependent accelerations of the ends of the arms."""
    tree, data, model = _robots()
    worst = 0.0
    for q, qd in _states(model, states):
        pin.forwardKinematics(tree, data, q, qd, np.zeros_like(q))
        pin.computeJointJacobians(tree, data, q)
        pin.updateFramePlacements(tree, data)
        for arm in range(len(model.arm_mount)):
            frame = tree.getFrameId(f"end {arm}")
            _, end = arm_points(model, q, qd, arm)
            J = pin.getFrameJacobian(tree, data, frame, pin.LOCAL_WORLD_ALIGNED)
            bias = pin.getFrameClassicalAcceleration(tree, data, frame, pin.LOCAL_WORLD_ALIGNED).linear
            worst = max(
                worst,
                relative(end.x, data.oMf[frame].translation[:2]),
                relative(end.J, J[:2]),
                relative(end.w, J[5]),
                relative(end.Jd_qd, bias[:2]),
            )
    return make_check(
        "Ends of the arms: x, J, Jd qd", f"Pinocchio, {states} random states", worst, 1.0e-11, "", ROUNDING
    )


def solution(states: int) -> Check:
    """Check compiled accelerations of a robot without panels and object against the articulated body algorithm."""
    tree, data, model = _robots()
    sim = Simulator(_bare())
    worst, rng = 0.0, np.random.default_rng(1)
    empty = np.zeros((0, sim.initial_state().qf.shape[1]))
    for q, qd in _states(model, states):
        base, joints = rng.uniform(-50.0, 50.0, 3), rng.uniform(-5.0, 5.0, model.link_mass.size)
        qdd, _, _ = sim.acceleration(State(0.0, q, qd, empty, empty, None, None), wrench=base, joints=joints)
        c, s = np.cos(q[2]), np.sin(q[2])
        tau = np.concatenate([[c * base[0] - s * base[1], s * base[0] + c * base[1], base[2]], joints])
        worst = max(worst, relative(qdd, pin.aba(tree, data, q, qd, tau)))
    return make_check(
        "Eq. 40, compiled accelerations without panels", f"Pinocchio (ABA), {states} random states", worst, 1.0e-12, "",
        "Random thrust and joint torques; rounding, times the condition of H.",
    )  # fmt: skip


def tree_of(params: Params) -> tuple[Any, Any]:
    """Return Pinocchio's model and data of base and arms; ends of the arms are the frames ``end 0``, ``end 1``, ..."""
    tree = pin.Model()
    tree.gravity = pin.Motion.Zero()
    joint = 0
    for name, kind in ("x", pin.JointModelPX()), ("y", pin.JointModelPY()), ("yaw", pin.JointModelRZ()):
        joint = tree.addJoint(joint, kind, pin.SE3.Identity(), name)
    base = joint
    _attach(tree, base, params.base.mass, params.base.inertia, 0.0)
    for number, arm in enumerate(params.arms):
        joint, place = base, _placement(arm.mount, arm.mount_angle)
        for k, link in enumerate(arm.links):
            joint = tree.addJoint(joint, pin.JointModelRZ(), place, f"{arm.name} {k}")
            _attach(tree, joint, link.mass, link.inertia, link.com)
            place = _placement((link.length, 0.0), 0.0)
        tree.addFrame(pin.Frame(f"end {number}", joint, place, pin.FrameType.OP_FRAME))
    return tree, tree.createData()


def _bare() -> Params:
    """Return the case study without panels and object."""
    return load_params().with_overrides("object=null", "panel.mounts=[]", "initial.qfd=[0, 0, 0]")


@cache
def _robots() -> tuple[Any, Any, Model]:
    return *tree_of(load_params()), pack(_bare())


def _states(model: Model, count: int, seed: int = 0) -> list[tuple[Array, Array]]:
    rng = np.random.default_rng(seed)
    n = 3 + len(model.link_mass)
    return [(rng.uniform(-3.0, 3.0, n), rng.uniform(-2.0, 2.0, n)) for _ in range(count)]


def _attach(tree: Any, joint: int, mass: float, inertia: float, com: float) -> None:
    about_com = np.diag([inertia, inertia, inertia])  # the planar motion sees the last entry alone
    tree.appendBodyToJoint(joint, pin.Inertia(mass, np.array([com, 0.0, 0.0]), about_com), pin.SE3.Identity())


def _placement(point: tuple[float, float], angle: float) -> Any:
    return pin.SE3(pin.utils.rotate("z", angle), np.array([*point, 0.0]))
