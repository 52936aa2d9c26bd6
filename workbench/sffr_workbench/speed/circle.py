"""The common ground of the physics: the case study on its circle under AHSC, and our simulator's drive around it.

Open-loop forces would not do: the two arms and the object are an unstable chain, in which rounding errors grow from
1e-16 to millimetres within the circle. So every engine closes the loop with the same law, and what is timed is the
engine's part alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sffr_baselines import make_policy
from sffr_baselines.closed_loop import Record, loop_shapes, make_record, run
from sffr_baselines.control_law import Law, LawState, make_states
from sffr_baselines.laws import LawPolicy
from sffr_gym.compile.workspace import new_workspace
from sffr_gym.config.params import Params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.actuators import state_size
from sffr_gym.physics.integrator import ETDRK4, step_shapes
from sffr_gym.physics.kinematics import tip_deflections
from sffr_gym.physics.model import joint_slice, object_slice
from sffr_gym.task.control_period import observe_states, period_shapes
from sffr_gym.task.episode import Episode
from sffr_gym.task.reference import Reference
from sffr_gym.task.signals import N_SIGNALS
from sffr_gym.task.status import RUNNING
from sffr_gym.task.task_model import TaskModel
from sffr_gym.types import Array
from sffr_workbench.speed.kernels.loops import forces_of, replay
from sffr_workbench.speed.measure import seconds

CHECKPOINTS = 50  # of the circle, at which engines are compared


class Course(NamedTuple):
    """The start of the circle."""

    params: Params  #: the case study
    plant: TaskModel
    episode: Episode
    p: Array  #: (n,) positions and velocities at the start
    v: Array  #: (n,)
    obs: Array  #: (n_o,) their observation
    ticks: int  #: control periods to the end

    @property
    def reference(self) -> Reference:
        """The desired motion."""
        return self.episode.reference

    @property
    def every(self) -> int:
        """Control periods between two checkpoints."""
        return max(self.ticks // CHECKPOINTS, 1)


class Loop:
    """The compiled loop of law and plant along a course: a call drives all of it, from the start.

    Args:
        course: where it starts, and how far it goes.
        plant: the robot.
        law: its controller.
        record: written by each drive.
    """

    def __init__(self, course: Course, plant: TaskModel, law: Law, record: Record) -> None:
        self._start = course.p, course.v, np.zeros(state_size(len(law.scale))), course.obs, *make_states(law, 1)
        self._state = tuple(each.copy() for each in self._start)
        p, v, actuation, obs, *states = self._state
        self._outcome, episode = np.zeros(2), course.episode
        self._run = run.bind(
            plant, episode.reference, episode.sensing, episode.impulses, law, new_workspace(loop_shapes(plant, law)), 0,
            course.ticks, p, v, actuation, obs, LawState(*states), record, self._outcome,
        )  # fmt: skip

    def __call__(self) -> tuple[int, int]:
        """Drive; return the periods that ran and the status of the last one."""
        for array, start in zip(self._state, self._start, strict=True):
            array[...] = start
        self._run()
        done, status = self._outcome
        return int(done), int(status)


class Drive(NamedTuple):
    """What an engine did on the course."""

    seconds: float  #: time that its physics took [s]
    rigid: Array  #: (rows, 12) base pose, joint angles and pose of the object at the checkpoints [m, rad]
    tips: Array  #: (rows, n_p) transverse displacement of the panels' tips there [m]


def make_course(seconds: float | None = None, *overrides: str) -> Course:
    """Return the first ``seconds`` of the case study, changed by ``overrides``, or all of its circle."""
    env = SFFRFlexEnv(overrides=overrides)
    obs, _ = env.reset(seed=0)
    ticks = env.scenario.ticks(env.params) if seconds is None else round(seconds / env.plant_task.period)
    return Course(env.params, env.plant_task, env.episode, env.positions, env.velocities, obs, ticks)


def shared_coordinates(course: Course, p: Array) -> tuple[Array, Array]:
    """Return ``rigid`` and ``tips`` of a :class:`Drive`, of positions (rows, n)."""
    model = course.plant.model
    rigid = np.concatenate([p[:, : joint_slice(model).stop], p[:, object_slice(model)]], axis=1)
    return rigid, tip_deflections(model, p)


def relative_errors(drive: Drive, reference: Drive) -> Array:
    """Return the error (rows,) at the checkpoints: of the rigid coordinates or of the tips, whichever is larger.

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
    plant, ticks = course.plant._replace(integrator=integrator, steps=steps), course.ticks
    law, record = _law(course).law, make_record(plant, ticks, 1)
    done, status = Loop(course, plant, law, record)()
    if status != RUNNING:
        raise RuntimeError(f"the drive ended in period {done} of {ticks}")
    forces = np.zeros((ticks, plant.model.at.end))
    forces_of(plant.model, plant.actuators, record.applied, record.applied, forces)
    return forces


def drive(course: Course, forces: Array, integrator: int = ETDRK4, steps: int = 1) -> Drive:
    """Repeat a drive from its forces, physics alone; with the same integrator and steps it is the same to the bit."""
    model, p, v = course.plant.model, course.p.copy(), course.v.copy()
    kept, work = np.zeros((len(forces) // course.every, len(p))), new_workspace(step_shapes(model))
    call = replay.bind(model, forces, course.plant.period, steps, integrator, work, p, v, course.every, kept)
    return Drive(seconds(call), *shared_coordinates(course, kept))


class Controller:
    """AHSC for an engine that Python steps: positions and velocities in, what the actuators do out, once a period.

    Attributes:
        applied: (n_u,) piezo volts, base wrench (base axes), joint torques.
        tau: (n,) the same as generalised forces.
    """

    def __init__(self, course: Course) -> None:
        plant, self._law = course.plant, _law(course)
        self._plant, self._t, self._obs = plant, np.zeros(1), course.obs[None].copy()
        self._p, self._v = np.zeros((2, 1, len(course.p)))
        self._command, applied, tau = np.zeros((1, len(plant.scale))), np.zeros((1, len(plant.scale))), 0.0 * self._p
        self.applied, self.tau = applied[0], tau[0]
        work, signals = new_workspace(period_shapes(plant)), np.zeros(N_SIGNALS)
        self._observe = observe_states.bind(
            plant, course.reference, self._t, self._p, self._v, work, self._obs, signals
        )  # fmt: skip
        self._apply = forces_of.bind(plant.model, plant.actuators, self._command, applied, tau)

    def __call__(self, tick: int, p: Array, v: Array) -> None:
        """Set ``applied`` and ``tau`` for the period that starts now."""
        self._t[0], self._p[0], self._v[0] = tick * self._plant.period, p, v
        self._observe()
        self._command[0] = self._law(self._obs[0]) * self._plant.scale
        self._apply()


def _law(course: Course) -> LawPolicy:
    law = make_policy("ahsc", course.params)
    assert isinstance(law, LawPolicy)
    return law
