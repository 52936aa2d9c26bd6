"""The compiled closed loop: law and plant over many control periods in one call, on the observation alone.

The same kernels as behind ``SFFRFlex-v0``, so that stepping a policy through the Gymnasium interface gives the same
trajectory.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sffr_baselines.control_law import LawWork, control, law_shapes, perceive, state_at
from sffr_baselines.schedule import update_schedule
from sffr_gym.compile.kernels import entry, kernel
from sffr_gym.compile.linalg import assign
from sffr_gym.physics.actuators import command_of
from sffr_gym.physics.beam import N_TIP
from sffr_gym.task.control_period import PeriodWork, control_period, period_shapes
from sffr_gym.task.disturbances import impulse_wrench, sense
from sffr_gym.task.signals import N_SIGNALS, tip_deflection
from sffr_gym.task.status import NOT_FINITE, RUNNING
from sffr_gym.task.task_model import TaskModel
from sffr_gym.types import Array


class Record(NamedTuple):
    """What the loop keeps: signals and tips of every period, the rest of every ``stride``-th, at its start.

    Attributes:
        signals: (n_ticks, N_SIGNALS); see ``task.SIGNALS``.
        tips: (n_ticks, n_p) transverse tip displacements at the period's end [m].
        stride: periods between two rows of the rest.
        p, v, obs, applied, B_hat, q_flex, lam: (rows, ...) states, observations, commands after the limits, virtual
            damping as it acts, Q_flex and grasp forces (base axes).
    """

    signals: Array
    tips: Array
    stride: int
    p: Array
    v: Array
    obs: Array
    applied: Array
    B_hat: Array
    q_flex: Array
    lam: Array


class LoopWork(NamedTuple):
    """Memory of the closed loop."""

    period: PeriodWork  #: of the plant's control period
    law: LawWork
    command: Array  #: (n_u,) of the law
    wrench: Array  #: (3,) impulses on the base


def loop_shapes(plant, law):
    """Shapes of the :class:`LoopWork` of a plant under a :class:`control_law.Law`."""
    return LoopWork(period_shapes(plant), law_shapes(law), (len(law.scale),), (3,))


def make_record(task: TaskModel, ticks: int, stride: int) -> Record:
    """Allocate what an episode of ``ticks`` control periods leaves."""
    rows, n, n_p = (ticks - 1) // stride + 1, task.model.at.end, len(task.model.panel_root)
    return Record(
        signals=np.zeros((ticks, N_SIGNALS)), tips=np.zeros((ticks, n_p)), stride=stride, p=np.zeros((rows, n)),
        v=np.zeros((rows, n)), obs=np.zeros((rows, len(task.bound))), applied=np.zeros((rows, len(task.scale))),
        B_hat=np.zeros((rows, n_p, N_TIP)), q_flex=np.zeros((rows, 3)),
        lam=np.zeros((rows, len(task.model.grasp_arm), 2)),
    )  # fmt: skip


@entry
def act(law, tick, obs, states, actions, work):
    """Write the actions (n, n_u) for observations (n, n_o) after ``tick`` (1,) control periods.

    law: a :class:`control_law.Law`; states: its :class:`control_law.LawState` in each environment, (n, ...), changed in
    place; work: :class:`control_law.LawWork`.
    """
    for i in range(len(obs)):
        state = state_at(states, i)
        perceive(law, tick[0] * law.observer.period, obs[i], state, work)
        if law.schedule.hold > 0 and tick[0] % law.schedule.hold == 0:
            update_schedule(law, obs[i], state, work.schedule)
        control(law, state, work, actions[i])
        for k in range(len(law.scale)):
            actions[i, k] /= law.scale[k]


@entry
def run(plant, reference, sensing, impulses, law, work, first, last, p, v, actuation, obs, states, record, outcome):
    """Run law and plant from period ``first`` up to ``last``, in place.

    plant: a :class:`task_model.TaskModel`; reference, sensing, impulses: those of the episode.
    law: what the controller does and believes; work: :class:`LoopWork`.
    p, v: (n,) positions and velocities; actuation: (n_u + 9,) numbers of the actuators' state; obs: (n_o,) observation.
    states: (1, ...) what the law remembers, :class:`control_law.LawState`.
    record: written; its rows count from period 0.
    outcome: (2,) the period that was reached, and the status of the last one that ran, written.
    """
    period, command, state = work.period, work.command, state_at(states, 0)
    outcome[0], outcome[1] = last, RUNNING
    for tick in range(first, last):
        keep = tick % record.stride == 0
        row = tick // record.stride
        perceive(law, tick * plant.period, obs, state, work.law)
        if law.schedule.hold > 0 and tick % law.schedule.hold == 0:
            update_schedule(law, obs, state, work.law.schedule)
        if keep:
            _keep_state(record, row, p, v, obs, state)
        control(law, state, work.law, command)
        for k in range(len(command)):
            command[k] /= law.scale[k]
        command_of(command, plant.scale, command)
        impulse_wrench(impulses, tick, plant.period, work.wrench)
        t_end, signals = (tick + 1) * plant.period, record.signals[tick]
        status = control_period(plant, reference, t_end, p, v, command, actuation, work.wrench, period, obs, signals)
        for i in range(len(plant.model.panel_root)):
            record.tips[tick, i] = tip_deflection(plant.actuators, plant.model, i, p)
        if status != NOT_FINITE:  # else the last observation stays
            sense(plant, reference, sensing, tick + 1, period.before.p, period.before.v, period.step.dynamics, obs)
        if keep:
            _keep_forces(record, row, period)
        if status != RUNNING:
            outcome[0], outcome[1] = tick + 1, status
            return


@kernel
def _keep_state(record, row, p, v, obs, state):
    """Write the state at a period's start, and the virtual damping as it acts, into a row of the record."""
    assign(record.p[row], p)
    assign(record.v[row], v)
    assign(record.obs[row], obs)
    for i in range(len(state.B_hat)):
        for k in range(N_TIP):
            record.B_hat[row, i, k] = state.factor[i, k] * state.B_hat[i, k]


@kernel
def _keep_forces(record, row, period):
    """Write what acted during a period into a row of the record."""
    forces = period.step.forces
    assign(record.applied[row], period.applied)
    assign(record.q_flex[row], forces.q_flex)
    for g in range(len(forces.lam_x)):
        record.lam[row, g, 0], record.lam[row, g, 1] = forces.lam_x[g], forces.lam_y[g]
