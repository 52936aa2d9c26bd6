"""Checks of the closed chain: two arms that hold the object, driven by random joint torques, against two engines.

First without panels, where both peers converge to us as their own error is refined; then the whole robot.
"""

from __future__ import annotations

from functools import cache, partial

import numpy as np

from sffr_gym.types import Array
from sffr_workbench.verify import exudyn_robot, figures, motion, mujoco_robot
from sffr_workbench.verify.check import Check, CheckFigure, make_check, relative, rms
from sffr_workbench.verify.motion import Motion

SECONDS = 5.0
RIGID_TORQUE, TORQUE = 1.0, 0.1  # N m; with panels less, so that they bend by a centimetre at most and stay linear
SOFTNESS = (1.0e-2, 1.0e-3, 1.0e-4)  # MuJoCo's own limit is 1e-4
STEPS = (4.0e-3, 2.0e-3, 1.0e-3)  # s, Exudyn's


def checks(quick: bool) -> list[partial[Check]]:
    """List the checks of this module."""
    rigid = map(partial, (rigid_places_mujoco, rigid_forces_mujoco, rigid_places_exudyn, rigid_forces_exudyn))
    return [*rigid, *(partial(check, engine) for engine in ("MuJoCo", "Exudyn") for check in (places, forces))]


def rigid_places_mujoco() -> Check:
    """Check base, grippers and object without panels; MuJoCo's softness extrapolated to none."""
    a, b = rigid_ours(), _harder(*(rigid_mujoco(s) for s in SOFTNESS[-2:]))
    errors = {
        "MuJoCo, softness": (list(SOFTNESS), [place_error(a, rigid_mujoco(s)) for s in SOFTNESS]),
        "Exudyn, step [s]": (list(STEPS), [place_error(a, rigid_exudyn(h)) for h in STEPS]),
    }
    picture = CheckFigure(
        "The closed chain: both peers converge to us",
        "Largest difference of base, grippers and object in 5 s of random joint torques up to 1 N m, without panels. "
        "MuJoCo's grasps are soft, and the difference is proportional to the softness; Exudyn's is of second order in "
        "its step.",
        partial(figures.convergence, errors),
    )
    return make_check(
        "Closed chain without panels: base, grippers, object", "MuJoCo, its softness extrapolated to 0",
        place_error(a, b), 1.0e-9, "m",
        f"Random torques up to {RIGID_TORQUE:g} N m, {SECONDS:g} s; angles count as metres at 1 m. "
        + _series("at softness", SOFTNESS, errors["MuJoCo, softness"][1]), picture,
    )  # fmt: skip


def rigid_forces_mujoco() -> Check:
    """Check grasp forces without panels."""
    a, b = rigid_ours(), _harder(*(rigid_mujoco(s) for s in SOFTNESS[-2:]))
    found = [relative(rigid_mujoco(s).lam, a.lam) for s in SOFTNESS]
    return make_check(
        "Closed chain without panels: grasp forces", "MuJoCo, its softness extrapolated to 0", relative(b.lam, a.lam),
        1.0e-6, "", "Relative to the largest force. " + _series("at softness", SOFTNESS, found),
    )  # fmt: skip


def rigid_places_exudyn() -> Check:
    """Check base, grippers and object without panels; Exudyn's step extrapolated to none."""
    a, b = rigid_ours(), mujoco_robot.extrapolate(*(rigid_exudyn(h) for h in STEPS[-2:]))
    found = [place_error(a, rigid_exudyn(h)) for h in STEPS]
    return make_check(
        "Closed chain without panels: base, grippers, object", "Exudyn, its step extrapolated to 0", place_error(a, b),
        1.0e-7, "m", _series("at a step of", STEPS, found, " s"),
    )  # fmt: skip


def rigid_forces_exudyn() -> Check:
    """Check grasp forces without panels."""
    a, b = rigid_ours(), rigid_exudyn(STEPS[-1])
    found = [rms(rigid_exudyn(h).lam - a.lam) / rms(a.lam) for h in STEPS]
    return make_check(
        "Closed chain without panels: grasp forces", "Exudyn, step 1 ms", rms(b.lam - a.lam) / rms(a.lam), 0.001, "",
        "Rms relative; its multipliers lag where the torques jump. " + _series("at a step of", STEPS, found, " s"),
    )  # fmt: skip


def places(engine: str) -> Check:
    """Check base, grippers and object of the whole robot."""
    a, b = ours(), peer(engine)
    way = np.abs(np.hstack([b.base - b.base[0], b.obj - b.obj[0]])).max()
    moves = np.abs(b.tips[..., 1]).max()
    return make_check(
        "Closed chain of the whole robot: base, grippers, object", _against(engine), place_error(a, b), 1.0e-5, "m",
        f"Random torques up to {TORQUE:g} N m: base and object move {way:.2g} m, panels bend {moves:.2g} m. What is "
        "left are the panels: the peer's own refinement, and what a linear beam leaves out.",
    )  # fmt: skip


def forces(engine: str) -> Check:
    """Check grasp forces of the whole robot."""
    a, b = ours(), peer(engine)
    shown: list[CheckFigure] = []
    if engine == "MuJoCo":
        curves = {"MuJoCo": b.lam, "Exudyn": peer("Exudyn").lam, "sffr-gym": a.lam}
        caption = "Force of the object on the first gripper under random joint torques, and differences from MuJoCo's."
        drawn = partial(figures.forces, a.t, curves, "MuJoCo")
        shown.append(CheckFigure("Grasp forces of the whole robot", caption, drawn))
    return make_check(
        "Closed chain of the whole robot: grasp forces", _against(engine), rms(a.lam - b.lam) / rms(b.lam), 0.01, "",
        "Rms relative. Bending modes alone on our side: nothing damps an axial mode that the jumps of the torque set "
        "off, and neither peer resolves it.", *shown,
    )  # fmt: skip


def place_error(a: Motion, b: Motion) -> float:
    """Return the largest difference of base, grippers and object [m]; an angle counts as metres at 1 m."""
    return max(float(np.abs(x - y).max()) for x, y in ((a.base, b.base), (a.grippers, b.grippers), (a.obj, b.obj)))


@cache
def rigid_ours() -> Motion:
    """Simulate with ours, without panels."""
    return motion.simulate(motion.at_rest("panel.mounts=[]"), motion.random_torques(RIGID_TORQUE, SECONDS))


@cache
def rigid_mujoco(softness: float) -> Motion:
    """Simulate with MuJoCo, without panels."""
    pieces = motion.random_torques(RIGID_TORQUE, SECONDS)
    return mujoco_robot.simulate(motion.at_rest("panel.mounts=[]"), pieces, softness=softness)


@cache
def rigid_exudyn(step: float) -> Motion:
    """Simulate with Exudyn, without panels."""
    pieces = motion.random_torques(RIGID_TORQUE, SECONDS)
    return exudyn_robot.simulate(motion.at_rest("panel.mounts=[]"), pieces, step=step)


@cache
def ours() -> Motion:
    """Simulate with ours: eight elements, bending modes alone."""
    params = motion.at_rest("panel.elements=8", "panel.axial_cut=1", "panel.bending_cut=1.0e+9")
    return motion.simulate(params, motion.random_torques(TORQUE, SECONDS))


@cache
def peer(engine: str) -> Motion:
    """Simulate the whole robot in another engine."""
    params, pieces = motion.at_rest(), motion.random_torques(TORQUE, SECONDS)
    if engine == "Exudyn":
        return exudyn_robot.simulate(params, pieces, elements=16, step=1.0e-3)
    return mujoco_robot.extrapolate(*(mujoco_robot.simulate(params, pieces, n, SOFTNESS[-1]) for n in (10, 20)))


def _against(engine: str) -> str:
    detail = {"Exudyn": "16 cables per panel, revolute joints", "MuJoCo": "10 and 20 hinges per panel, extrapolated"}
    return f"{engine}, {detail[engine]}"


def _harder(soft: Motion, hard: Motion) -> Motion:
    """Extrapolate an error proportional to the softness from two runs, the second ten times harder."""
    return Motion(*(h + (h - s) / 9.0 for s, h in zip(soft, hard, strict=True)))


def _series(what: str, values: tuple[float, ...], errors: list[float] | Array, unit: str = "") -> str:
    """Return a sentence with the error at each value."""
    return "Alone: " + ", ".join(f"{e:.1e} {what} {v:g}{unit}" for v, e in zip(values, errors, strict=True)) + "."
