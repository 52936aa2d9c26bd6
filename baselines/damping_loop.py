"""Many closed loops whose virtual damping is chosen from outside, advanced by one compiled call for each decision."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from baselines.closed_loop import Law, control
from baselines.mic import mic_workspace
from baselines.schedule import N_FEATURES, look, stretch
from sffr_gym._jit import kernel
from sffr_gym.batch import Batch, advance_group, begin, clipped, load, make_group, sense_lane, share_out, store
from sffr_gym.beam import Array
from sffr_gym.fleet import Fleet, robot_at
from sffr_gym.lanes import ONE, columns, gather, in_lanes, take, where, zeros
from sffr_gym.model import IntArray
from sffr_gym.task import RUNNING, make_buffers


class Damping(NamedTuple):
    """What ``n`` closed loops have beyond their :class:`batch.Batch`.

    Attributes:
        B_hat: (n, n_p, 3) virtual damping of the law.
        factor: (n, n_p, 3) by which the last decision multiplies it.
        seen: (n, n_p N_FEATURES) what the next decision sees.
        reward: (n, n_p) reward of each panel's own vibration and effort during the last decision.
        end: (n,) control period at which the episode is over.
    """

    B_hat: Array
    factor: Array
    seen: Array
    reward: Array
    end: IntArray


class Decision(NamedTuple):
    """What is held in a group of environments during a decision, and summed; see :class:`Damping`."""

    B_hat: Array
    factor: Array
    running: Array  # (1,) 1 while the episode goes on
    total: Array  # (2,) reward and cost
    terms: Array
    panels: Array  # (n_p,) reward of each panel


def make_damping(law: Law, n: int) -> Damping:
    """Allocate ``n`` loops of one law."""
    n_p = len(law.allocation)
    return Damping(
        B_hat=np.zeros((n, n_p, 3)), factor=np.ones((n, n_p, 3)), seen=np.zeros((n, n_p * N_FEATURES)),
        reward=np.zeros((n, n_p)), end=np.zeros(n, dtype=np.int64),
    )  # fmt: skip


def start_damping(law: Law, batch: Batch, damping: Damping, i: int, end: int) -> None:
    """Put the law of environment ``i`` at its start, after ``start_episode``."""
    damping.B_hat[i], damping.factor[i] = law.suppression.B0 * law.suppression.damped, 1.0
    damping.reward[i], damping.end[i] = 0.0, end
    see_one(law, batch.obs[i], damping.seen[i])


@kernel
def see_one(law, obs, seen):
    """Write what a schedule sees in an observation; see :func:`schedule.look`."""
    look(law, obs, seen)


def step_damping(fleet: Fleet, batch: Batch, law: Law, damping: Damping, actions: Array, active: np.ndarray) -> None:
    """Hold one decision in each active environment for ``law.schedule.hold`` control periods, or to its end.

    Reward, its terms and cost are sums over these periods; signals, commands and status are those of the last one.

    Args:
        fleet: the plants.
        batch: the environments, advanced in place.
        law: what runs inside.
        damping: its state, advanced in place.
        actions: (n, n_p n_d) decisions; what lies beyond [-1, 1] is clipped and counted.
        active: (n,) False leaves an environment as it is.
    """
    share_out(fleet, batch, damping_range, damping_lanes, (fleet, batch, law, damping, actions, active), smallest=1)


@kernel(allocates=True, nogil=True)
def damping_range(fleet, batch, law, damping, actions, active, first, last):
    """Advance the active environments from ``first`` up to ``last`` by one decision, one after the other."""
    robot = robot_at(fleet, first, np.zeros(2, dtype=np.int64))
    buffers = make_buffers(robot)
    _decide(
        fleet, robot, batch, law, damping, actions, active, first, last, make_group(robot, ONE), buffers, buffers,
        _make_decision(robot, law, ONE), mic_workspace(law.prior),
    )  # fmt: skip


@kernel(allocates=True, nogil=True)
def damping_lanes(fleet, batch, law, damping, actions, active, first, last):
    """Do the same in lanes, for robots that are alike and as many as fill all lanes."""
    robot, one = robot_at(fleet, first, np.zeros(2, dtype=np.int64)), in_lanes(ONE)
    _decide(
        fleet, robot, batch, law, damping, actions, active, first, last, make_group(robot, one),
        make_buffers(robot, one), make_buffers(robot), _make_decision(robot, law, one), mic_workspace(law.prior, one),
    )  # fmt: skip


@kernel(allocates=True, inline=True)
def _decide(
    fleet, robot, batch, law, damping, actions, active, first, last, group, buffers, alone, decision, work
):  # fmt: skip
    """Advance environments, as many at once as a group holds.

    robot: the first one, or all of them; buffers: the group's; alone: those of a single robot; decision: a
        :class:`Decision`; work: a :class:`mic.MicWork`.
    """
    cursor = np.zeros(2, dtype=np.int64)
    width = columns(group.t).shape[1]
    running = np.zeros(width, dtype=np.bool_)
    for i in range(first, last, width):
        if len(fleet.numbers) > 1:
            robot = robot_at(fleet, i, cursor)
        load(batch, i, group)
        _take_decision(law, batch, damping, actions, active, i, decision, running)
        for _ in range(law.schedule.hold):
            if not running.any():
                break
            for k in range(width):
                columns(decision.running)[0, k] = 1.0 if running[k] else 0.0
                if running[k]:
                    begin(robot, batch, i + k, group, k)
            control(law, group.obs, decision.B_hat, decision.factor, work, group.command)
            for k in range(len(group.command)):  # an action's bounds, as in the environment
                group.command[k] = min(max(group.command[k] / law.scale[k], -1.0), 1.0) * robot.scale[k]
            advance_group(robot, group, buffers)
            _add(robot, group, buffers, decision)
            for k in range(width):
                if running[k]:
                    sense_lane(robot, batch, i + k, group, buffers, k, alone)
                    if columns(group.status)[0, k] != RUNNING or batch.tick[i + k] >= damping.end[i + k]:
                        running[k] = False
                        _end_decision(law, batch, damping, i + k, group, buffers, decision, k)
        for k in range(width):
            if running[k]:
                _end_decision(law, batch, damping, i + k, group, buffers, decision, k)


@kernel(inline=True)
def _take_decision(law, batch, damping, actions, active, i, decision, running):
    """Take what the decisions of the environments from ``i`` on set, and nothing summed yet."""
    for k in range(len(running)):
        running[k] = active[i + k] and batch.tick[i + k] < damping.end[i + k]
        if active[i + k]:
            batch.clipped[i + k] = clipped(actions[i + k])
            stretch(law, batch.obs[i + k], actions[i + k], damping.factor[i + k])
    for panel in range(len(decision.factor)):
        gather(damping.factor[:, panel], i, decision.factor[panel])
        gather(damping.B_hat[:, panel], i, decision.B_hat[panel])
    decision.total[:] = 0.0
    decision.terms[:] = 0.0
    decision.panels[:] = 0.0


@kernel(inline=True)
def _add(robot, group, buffers, decision):
    """Add what a control period gave to the sums, where the episode still runs."""
    runs = decision.running[0] > 0.0
    decision.total[0] += where(runs, group.reward[0], 0.0)
    decision.total[1] += where(runs, group.cost[0], 0.0)
    for k in range(len(group.terms)):
        decision.terms[k] += where(runs, group.terms[k], 0.0)
    n_c = robot.actuators.gain.shape[1]
    for k in range(len(buffers.energy)):
        price = robot.weight[1] * buffers.energy[k]
        for c in range(k * n_c, (k + 1) * n_c):
            price += robot.weight[2] * buffers.applied[c] * buffers.applied[c]
        decision.panels[k] -= where(runs, robot.period * price, 0.0)


@kernel(inline=True)
def _end_decision(law, batch, damping, i, group, buffers, decision, lane):
    """Bring a lane back as environment ``i`` with the sums of its decision, and look."""
    store(batch, i, group, buffers, lane)
    batch.reward[i], batch.cost[i] = columns(decision.total)[0, lane], columns(decision.total)[1, lane]
    take(decision.terms, lane, batch.terms[i])
    take(decision.panels, lane, damping.reward[i])
    for panel in range(len(decision.B_hat)):
        take(decision.B_hat[panel], lane, damping.B_hat[i, panel])
    look(law, batch.obs[i], damping.seen[i])


@kernel(allocates=True)
def _make_decision(robot, law, one):
    n_p = len(law.allocation)
    return Decision(
        B_hat=zeros(one, (n_p, 3)), factor=zeros(one, (n_p, 3)), running=zeros(one, 1), total=zeros(one, 2),
        terms=zeros(one, len(robot.weight)), panels=zeros(one, n_p),
    )  # fmt: skip
