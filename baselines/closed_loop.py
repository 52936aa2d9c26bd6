"""The compiled closed loop: law and plant over many control periods in one call, on the observation alone.

The same kernels as behind ``SFFRFlex-v0``, so that stepping a policy through the Gymnasium interface gives the same
trajectory.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from baselines.mic import Layout, mic, mic_workspace
from baselines.regulator import Regulator, regulate
from baselines.schedule import Schedule, reschedule, schedule_workspace
from baselines.suppression import Suppression, suppress
from sffr_gym._jit import assign, kernel
from sffr_gym.beam import Array
from sffr_gym.disturbances import hit, sense
from sffr_gym.model import N_BASE, IntArray, Model
from sffr_gym.reference import Reference
from sffr_gym.task import NOT_FINITE, RUNNING, control_period


class Law(NamedTuple):
    """HSC and its relatives as one compiled law; everything here is what the controller believes.

    Attributes:
        prior: the robot.
        reference: the formation that the task asks for.
        held: joints that hold their angles.
        Kp, Kd: gains [1/s2, 1/s].
        layout: places in the observation.
        suppression: the panels' law.
        regulator: what is added to it, of no effect in the paper's laws.
        schedule: what changes the virtual damping over time, of no effect in them either.
        allocation: (n_p, n_c, 3) volts for a wanted tip force.
        scale: (n_u,) command of a unit action.
    """

    prior: Model
    reference: Reference
    held: IntArray
    Kp: float
    Kd: float
    layout: Layout
    suppression: Suppression
    regulator: Regulator
    schedule: Schedule
    allocation: Array
    scale: Array


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


@kernel(inline=True)
def control(law, obs, B_hat, factor, work, command):
    """Write the command (n_u,) of the law for an observation and adapt ``B_hat`` (n_p, 3) in place.

    factor: (n_p, 3) of the virtual damping; work: a :class:`mic.MicWork`.
    """
    n_volts = law.allocation.shape[0] * law.allocation.shape[1]
    limit = law.scale[:n_volts]
    yaw_rate = obs[law.layout.yaw_rate]
    suppress(
        law.suppression, law.allocation, limit, obs, law.layout.elastic, yaw_rate, factor, B_hat, command[:n_volts]
    )
    if law.regulator.active > 0.0:
        regulate(law.regulator, law.allocation, obs, law.layout.elastic, law.layout.reference, command[:n_volts])
    mic(
        law.prior, law.reference, law.held, law.Kp, law.Kd, law.layout, obs, work,
        command[n_volts : n_volts + N_BASE], command[n_volts + N_BASE :],
    )  # fmt: skip


@kernel(allocates=True)
def act(law, tick, obs, B_hat, factor, actions):
    """Write the actions (n, n_u) for observations (n, n_o) after ``tick`` control periods.

    B_hat, factor: (n, n_p, 3) virtual damping and what a schedule makes of it, both changed in place.
    """
    work, schedule_work = mic_workspace(law.prior), schedule_workspace(law)
    for i in range(len(obs)):
        if law.schedule.hold > 0 and tick % law.schedule.hold == 0:
            reschedule(law, obs[i], schedule_work, factor[i])
        control(law, obs[i], B_hat[i], factor[i], work, actions[i])
        for k in range(len(law.scale)):
            actions[i, k] /= law.scale[k]


@kernel(allocates=True, nogil=True)
def run(robot, reference, sensing, impulses, law, buffers, first, last, p, v, obs, B_hat, factor, record):
    """Run law and plant from period ``first`` up to ``last``, in place.

    robot, reference, sensing, impulses: the plant and the episode's :class:`reference.Reference`,
        :class:`disturbances.Sensing` and :class:`disturbances.Impulses`; law: what the controller does and believes.
    p, v: (n,) positions and velocities; obs: (n_o,) their observation.
    B_hat, factor: (n_p, 3) virtual damping and what a schedule makes of it.
    record: written; its rows count from period 0.

    Returns the number of periods that ran and the status of the last one.
    """
    work, schedule_work = mic_workspace(law.prior), schedule_workspace(law)
    command, wrench = np.zeros(len(law.scale)), np.zeros(3)
    for tick in range(first, last):
        keep = tick % record.stride == 0
        row = tick // record.stride
        if law.schedule.hold > 0 and tick % law.schedule.hold == 0:
            reschedule(law, obs, schedule_work, factor)
        if keep:
            assign(record.p[row], p)
            assign(record.v[row], v)
            assign(record.obs[row], obs)
            record.B_hat[row, :, :] = factor * B_hat
        control(law, obs, B_hat, factor, work, command)
        for k in range(len(command)):  # an action's bounds, as in the environment
            command[k] = min(max(command[k] / law.scale[k], -1.0), 1.0) * robot.scale[k]
        hit(impulses, tick, robot.period, wrench)
        t_end = (tick + 1) * robot.period
        outcome = control_period(robot, reference, t_end, p, v, command, wrench, buffers, obs, record.signals[tick])
        _note_tips(robot, p, record.tips[tick])
        if outcome != NOT_FINITE:  # else the last observation stays
            sense(robot, reference, sensing, tick + 1, buffers.p, buffers.v, buffers.step.dynamics, obs)
        if keep:
            assign(record.applied[row], buffers.applied)
            assign(record.q_flex[row], buffers.step.q_flex)
            record.lam[row, :, :] = buffers.step.lam
        if outcome != RUNNING:
            return tick + 1, outcome
    return last, RUNNING


@kernel(inline=True)
def _note_tips(robot, p, tips):
    """Write each panel's transverse tip displacement [m], along its y axis, into ``tips`` (n_p,)."""
    n_p, n_m = robot.model.omega2.shape
    start = N_BASE + len(robot.model.link_mass)
    for i in range(n_p):
        tip = 0.0
        for m in range(n_m):
            tip += robot.actuators.tips[i, m, 1] * p[start + i * n_m + m]
        tips[i] = tip
