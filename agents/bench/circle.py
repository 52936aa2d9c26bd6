"""The common ground of the physics: the case study on its circle under AHSC, and our simulator's drive around it.

Open-loop forces would not do: the two arms and the object are an unstable chain, in which rounding errors grow from
1e-16 to millimetres within the circle. So every engine closes the loop with the same law, and what is timed is the
engine's part alone.
"""

from __future__ import annotations

from time import perf_counter
from typing import NamedTuple

import numpy as np

from agents.bench.kernels.loops import forces_of, replay
from baselines import make_policy
from baselines.closed_loop import Law, Record, run
from baselines.policies import LawPolicy
from sffr_gym.actuators import generalized_forces, saturate
from sffr_gym.beam import N_TIP, Array
from sffr_gym.env import SFFRFlexEnv
from sffr_gym.episode import Episode
from sffr_gym.integrator import ETDRK4, step_workspace
from sffr_gym.model import joint_slice, mode_slice, n_positions, object_slice
from sffr_gym.params import Params
from sffr_gym.reference import Reference
from sffr_gym.task import N_SIGNALS, RUNNING, Buffers, Robot, make_buffers, view

CHECKPOINTS = 50  # of the circle, at which engines are compared


class Course(NamedTuple):
    """The start of the circle.

    Attributes:
        params, robot, episode: the case study.
        p, v: (n,) positions and velocities at the start; obs: (n_o,) their observation.
        ticks: control periods to the end.
    """

    params: Params
    robot: Robot
    episode: Episode
    p: Array
    v: Array
    obs: Array
    ticks: int

    @property
    def reference(self) -> Reference:
        """The desired motion."""
        return self.episode.reference

    def control(self, robot: Robot, law: Law, buffers: Buffers, record: Record) -> tuple[int, int]:
        """Drive the robot along the course in the compiled loop; return the periods that ran and the status."""
        p, v, obs, episode = self.p.copy(), self.v.copy(), self.obs.copy(), self.episode
        B_hat = np.tile(law.suppression.B0 * law.suppression.damped, (len(law.allocation), 1))
        return run(
            robot, episode.reference, episode.sensing, episode.impulses, law, buffers, 0, self.ticks, p, v, obs, B_hat,
            np.ones_like(B_hat), record,
        )  # fmt: skip

    @property
    def every(self) -> int:
        """Control periods between two checkpoints."""
        return max(self.ticks // CHECKPOINTS, 1)


class Drive(NamedTuple):
    """What an engine did on the course.

    Attributes:
        seconds: time that its physics took [s].
        rigid: (rows, 12) base pose, joint angles and pose of the object at the checkpoints [m, rad].
        tips: (rows, n_p) transverse displacement of the panels' tips there [m].
    """

    seconds: float
    rigid: Array
    tips: Array


def make_course(seconds: float | None = None, *overrides: str) -> Course:
    """The case study, changed by ``overrides``, for the first ``seconds`` of its circle; the whole one if left out."""
    env = SFFRFlexEnv(overrides=overrides)
    obs, _ = env.reset(seed=0)
    ticks = env.scenario.ticks(env.params) if seconds is None else round(seconds / env.robot.period)
    return Course(env.params, env.robot, env.episode, env.positions, env.velocities, obs, ticks)


def shared_coordinates(course: Course, p: Array) -> tuple[Array, Array]:
    """``rigid`` and ``tips`` of a :class:`Drive`, of positions (rows, n)."""
    model = course.robot.model
    rigid = np.concatenate([p[:, : joint_slice(model).stop], p[:, object_slice(model)]], axis=1)
    amplitudes = p[:, mode_slice(model)].reshape(len(p), *model.omega2.shape)
    return rigid, np.einsum("pm,tpm->tp", model.shapes[:, -N_TIP + 1, :], amplitudes)


def relative_errors(drive: Drive, reference: Drive) -> Array:
    """Error (rows,) at the checkpoints: of the rigid coordinates or of the tips, whichever is larger.

    Each relative to the largest norm of its coordinates along the course.
    """
    pairs = (drive.rigid, reference.rigid), (drive.tips, reference.tips)
    errors = [np.linalg.norm(own - true, axis=1) / np.linalg.norm(true, axis=1).max() for own, true in pairs]
    return np.asarray(np.maximum(*errors))


def close_loop(course: Course, integrator: int = ETDRK4, steps: int = 1) -> Array:
    """Drive the course in the compiled loop and return the generalised forces (ticks, n) of every period.

    Raises:
        RuntimeError: if the episode ends before the course does.
    """
    robot, ticks = course.robot._replace(integrator=integrator, steps=steps), course.ticks
    law, record = _law(course), make_record(course)
    done, outcome = course.control(robot, law.law, make_buffers(robot), record)
    if outcome != RUNNING:
        raise RuntimeError(f"the drive ended in period {done} of {ticks}")
    forces = np.zeros((ticks, n_positions(robot.model)))
    forces_of(robot.model, robot.actuators, record.applied, forces)
    return forces


def drive(course: Course, forces: Array, integrator: int = ETDRK4, steps: int = 1) -> Drive:
    """Repeat a drive from its forces, physics alone; with the same integrator and steps it is the same to the bit."""
    model, p, v = course.robot.model, course.p.copy(), course.v.copy()
    kept, work = np.zeros((len(forces) // course.every, len(p))), step_workspace(model)
    rest = course.robot.period, steps, integrator, work, p, v, course.every, kept
    replay(model, forces[:0], *rest)  # compiled, or loaded, before the clock starts
    start = perf_counter()
    replay(model, forces, *rest)
    elapsed = perf_counter() - start
    return Drive(elapsed, *shared_coordinates(course, kept))


def make_record(course: Course) -> Record:
    """Allocate what :func:`close_loop` keeps of every period."""
    robot, ticks = course.robot, course.ticks
    n, n_p, n_g = len(course.p), len(robot.model.panel_root), len(robot.model.grasp_arm)
    return Record(
        signals=np.zeros((ticks, N_SIGNALS)), tips=np.zeros((ticks, n_p)), stride=1, p=np.zeros((ticks, n)),
        v=np.zeros((ticks, n)), obs=np.zeros((ticks, len(course.obs))),
        applied=np.zeros((ticks, len(robot.scale))), B_hat=np.zeros((ticks, n_p, 3)), q_flex=np.zeros((ticks, 3)),
        lam=np.zeros((ticks, n_g, 2)),
    )  # fmt: skip


class Controller:
    """AHSC for an engine that Python steps: positions and velocities in, what the actuators do out, once a period."""

    def __init__(self, course: Course) -> None:
        self._course, self._law = course, _law(course)
        self._buffers, self._obs, self._signals = make_buffers(course.robot), course.obs.copy(), np.zeros(N_SIGNALS)
        self.applied = np.zeros(len(course.robot.scale))  # piezo volts, base wrench (base axes), joint torques
        self.tau = np.zeros(len(course.p))  # the same as generalised forces

    def __call__(self, tick: int, p: Array, v: Array) -> None:
        """Set ``applied`` and ``tau`` for the period that starts now."""
        course, robot = self._course, self._course.robot
        view(robot, course.reference, tick * robot.period, p, v, self._buffers, self._obs, self._signals)
        saturate(robot.actuators, self._law(self._obs) * robot.scale, self.applied)
        generalized_forces(robot.model, robot.actuators, self.applied, self.tau)


def _law(course: Course) -> LawPolicy:
    law = make_policy("ahsc", course.params)
    assert isinstance(law, LawPolicy)
    return law
