"""Experiments that every engine can run, and the motion that each returns: the common ground of all comparisons.

An experiment starts at rest from q(0) of Table IV with straight panels and holds forces piece by piece.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sffr_gym.config.params import Params, load_params
from sffr_gym.physics.beam import N_TIP
from sffr_gym.physics.kinematics import arm_points, rotation
from sffr_gym.physics.simulator import Simulator, State
from sffr_gym.types import Array

RECORD = 0.02  # s, between two recorded states
STEP = 2.0e-3  # s, of our simulator
UNLIKE = (  # panels that differ from each other and from what the section has
    "panel.mounts.0.mass=6.0", "panel.mounts.0.EI=31.0", "panel.mounts.1.length=2.7", "panel.mounts.1.mass=11.0",
)  # fmt: skip


class Piece(NamedTuple):
    """Forces that are held for a while."""

    duration: float  #: [s], a multiple of ``RECORD``
    wrench: Array  #: (3,) force on the base's centre of mass, inertial axes [N], and moment [N m]
    joints: Array  #: (n_l,) joint torques [N m]


class Motion(NamedTuple):
    """What an engine computed, at ``t = 0, RECORD, ...``; inertial axes except for the panels."""

    t: Array  #: (k,) [s]
    base: Array  #: (k, 3) x, y [m] and yaw [rad]
    tips: Array  #: (k, n_p, 2) axial and transverse displacement of each panel's tip, panel axes [m]
    grippers: Array  #: (k, n_a, 2) ends of the arms [m]
    obj: Array  #: (k, 3) pose of the object [m, rad]; (k, 0) without one
    lam: Array  #: (k, n_g, 2) force of the object on each gripper just before ``t`` [N]; at 0 just after


def at_rest(*overrides: str) -> Params:
    """Return the case study undamped and at rest with straight panels, changed by ``overrides``."""
    start = ("initial.qd=[0, 0, 0, 0, 0, 0, 0, 0, 0]", "initial.qf=[0, 0, 0]", "initial.qfd=[0, 0, 0]")
    return load_params().with_overrides("panel.strain_rate_damping=0", *start, *overrides)


def pulse(scale: float, seconds: float = 20.0) -> list[Piece]:
    """Return the force of Fig. 5: 2 N along x and 0.5 N m on the base for 1 s, then none; all times ``scale``."""
    still = np.zeros(load_params().n_links)
    return [Piece(1.0, scale * np.array([2.0, 0.0, 0.5]), still), Piece(seconds - 1.0, np.zeros(3), still)]


def random_torques(amplitude: float, seconds: float, seed: int = 0, held: float = 0.1) -> list[Piece]:
    """Draw uniform random torques up to ``amplitude`` [N m] on every joint, each held for ``held`` [s]."""
    rng = np.random.default_rng(seed)
    pieces, joints = round(seconds / held), load_params().n_links
    return [Piece(held, np.zeros(3), rng.uniform(-amplitude, amplitude, joints)) for _ in range(pieces)]


def simulate(params: Params, pieces: Sequence[Piece], step: float = STEP) -> Motion:
    """Run an experiment in our simulator.

    The force on the base is inertial, the simulator's along the base axes: each step takes the axes of its middle.
    """
    sim = Simulator(params, max_step=step)
    state = sim.initial_state()
    rows = [_row(sim, state, pieces[0].joints, np.zeros(3))]
    every = round(RECORD / step)
    for piece in pieces:
        for k in range(round(piece.duration / step)):
            wrench = _base_axes(state, piece.wrench, step)
            state = sim.step(state, wrench=wrench, joints=piece.joints, dt=step)
            if (k + 1) % every == 0:
                rows.append(_row(sim, state, piece.joints, _base_axes(state, piece.wrench, 0.0)))
    return stack(rows)


def stack(rows: list[tuple[Array, ...]]) -> Motion:
    """Put recorded rows of ``base, tips, grippers, obj, lam`` together."""
    t = np.arange(len(rows), dtype=np.float64) * RECORD
    return Motion(t, *(np.array(column) for column in zip(*rows, strict=True)))


def panel_displacement(params: Params, base: Array, tips: Array) -> Array:
    """Return the displacement (n_p, 2) [m] in each panel's axes of tips at inertial positions (n_p, 2)."""
    local = (tips - base[:2]) @ rotation(base[2])
    mounts = params.panel.mounts
    return np.array([
        rotation(mount.angle).T @ (point - mount.root) - [panel.length, 0.0]
        for mount, panel, point in zip(mounts, params.panel.each, local, strict=True)
    ]).reshape(-1, 2)  # fmt: skip


def _row(sim: Simulator, state: State, joints: Array, wrench: Array) -> tuple[Array, ...]:
    tips = state.qf[:, -N_TIP:][:, :2]
    arms = range(len(sim.params.arms))
    grippers = np.array([arm_points(sim.model, state.q, state.qd, arm)[1].x for arm in arms])
    if state.obj is None:
        return state.q[:3], tips, grippers, np.zeros(0), np.zeros((0, 2))
    return state.q[:3], tips, grippers, state.obj, sim.grasp_forces(state, joints=joints, wrench=wrench)


def _base_axes(state: State, wrench: Array, ahead: float) -> Array:
    """Return an inertial wrench along the base axes half of ``ahead`` [s] later."""
    yaw = state.q[2] + 0.5 * ahead * state.qd[2]
    return np.append(rotation(yaw).T @ wrench[:2], wrench[2])
