"""Many closed loops whose virtual damping is chosen from outside, advanced by one compiled call for each decision."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sffr_baselines.control_law import (
    Law,
    LawState,
    LawWork,
    control,
    law_shapes,
    make_states,
    perceive,
    start_state,
    state_shapes,
)
from sffr_baselines.schedule import apply_decision, decisions_of_panel, see
from sffr_gym.compile.kernels import entry, kernel
from sffr_gym.compile.lanes import columns, gather, take, where
from sffr_gym.envs.batch import (
    Batch,
    Group,
    Stepper,
    advance_group,
    begin,
    clipped,
    group_shapes,
    load,
    sense_lane,
    store,
)
from sffr_gym.physics.actuators import command_of
from sffr_gym.task.control_period import PeriodWork
from sffr_gym.task.reward import REWARDS
from sffr_gym.task.signals import ERROR
from sffr_gym.task.status import RUNNING
from sffr_gym.task.task_model import TaskModel
from sffr_gym.types import Array, IntArray

SMALLEST_CHUNK = 1  # environments that pay for a thread: a decision holds many control periods


class Damping(NamedTuple):
    """What ``n`` closed loops have beyond their :class:`batch.Batch`."""

    law: LawState  #: (n, ...) of the law; ``factor`` and ``share`` of the last decision, ``seen`` for the next one
    price: Array  #: (n, n_p) of the last decision, panel by panel: what the score takes of it; see ``_add``
    end: IntArray  #: (n,) control period at which the episode is over


class Decision(NamedTuple):
    """What is held in a group of environments during a decision, and summed; see :class:`Damping`."""

    law: LawState
    running: Array  #: (1,) 1 while the episode goes on, else 0
    reward: Array  #: (1,)
    cost: Array  #: (1,)
    terms: Array  #: (3,)
    price: Array  #: (n_p,) of each panel


class DecisionWork(NamedTuple):
    """Memory of a group: the control period's first, so that those of one environment can share a block."""

    period: PeriodWork
    group: Group
    decision: Decision
    law: LawWork


def decision_shapes(task, law):
    """Shapes of the :class:`DecisionWork` of a robot under a law."""
    group, n_p = group_shapes(task), len(law.allocation)
    held = state_shapes(law)._replace(seen=(0,))  # which only a decision's end changes
    decision = Decision(held, (1,), (1,), (1,), (len(REWARDS),), (n_p,))
    return DecisionWork(group.period, group.group, decision, law_shapes(law))


def make_damping(law: Law, n: int) -> Damping:
    """Allocate ``n`` loops of one law."""
    n_p = len(law.allocation)
    return Damping(law=make_states(law, n), price=np.zeros((n, n_p)), end=np.zeros(n, dtype=np.int64))


def start_damping(law: Law, damping: Damping, chosen: Any) -> None:
    """Put the laws of the chosen environments, by index or mask, at the start of an episode."""
    start_state(law, damping.law, chosen)
    damping.price[chosen] = 0.0


class DampingStepper(Stepper):
    """Advances a batch under a law, by one decision at a time.

    A step holds one decision in each active environment for ``law.schedule.hold`` control periods, or to its end.
    Reward, its terms and cost are sums over these periods; signals, commands and status are those of the last one.

    Args:
        plants: see :class:`sffr_gym.envs.batch.Stepper`.
        batch: likewise; actions (n, n_p n_d) are decisions.
        law: what runs inside.
        damping: its state, advanced in place.
    """

    def __init__(self, plants: Sequence[TaskModel], batch: Batch, law: Law, damping: Damping) -> None:
        n_a = len(law.allocation) * decisions_of_panel(law)
        shapes = decision_shapes(plants[0], law)
        super().__init__(damping_range, plants, batch, n_a, shapes, (law, damping), see_range, SMALLEST_CHUNK)


@entry
def see_range(law, damping, obs, chosen, first, last):
    """Write what schedules see in observations of the chosen environments from ``first`` up to ``last``.

    damping: :class:`Damping`, whose law's ``seen`` is changed, see :func:`schedule.see`; obs: (n, n_o); chosen: (n,).
    """
    for i in range(first, last):
        if chosen[i]:
            see(law, obs[i], damping.law.demand[i], damping.law.seen[i])


@entry
def damping_range(groups, plants, batch, law, damping, actions, active, work, one, first, last):
    """Advance the active environments from ``first`` up to ``last`` by one decision.

    Arguments as in :func:`sffr_gym.envs.batch.step_range`; work: :class:`DecisionWork`.
    """
    group, decision, width = work.group, work.decision, columns(work.group.t).shape[1]
    for i in range(first, last, width):
        task = groups[i // width if len(groups) > 1 else 0]
        load(batch, i, group)
        _begin_decision(law, batch, damping, actions, active, i, decision)
        for _ in range(law.schedule.hold):
            if not _any_running(decision):
                break
            for k in range(width):
                if columns(decision.running)[0, k] > 0.0:
                    begin(task, batch, i + k, group, k)
            perceive(law, group.t[0] - task.period, group.obs, decision.law, work.law)
            control(law, decision.law, work.law, group.command)
            for k in range(len(group.command)):
                group.command[k] = group.command[k] / law.scale[k]
            command_of(group.command, task.scale, group.command)
            advance_group(task, group, work.period)
            _add(task, group, work.period, decision)
            for k in range(width):
                if columns(decision.running)[0, k] > 0.0:
                    sense_lane(plants[i + k if len(plants) > 1 else 0], batch, i + k, group, work.period, k, one)
                    if columns(group.status)[0, k] != RUNNING or batch.tick[i + k] >= damping.end[i + k]:
                        columns(decision.running)[0, k] = 0.0
                        _end_decision(law, batch, damping, i + k, group, work.period, decision, k)
        for k in range(width):
            if columns(decision.running)[0, k] > 0.0:
                _end_decision(law, batch, damping, i + k, group, work.period, decision, k)


@kernel
def _any_running(decision):
    """Whether the episode goes on in any lane."""
    running = columns(decision.running)
    for k in range(running.shape[1]):
        if running[0, k] > 0.0:
            return True
    return False


@kernel
def _begin_decision(law, batch, damping, actions, active, i, decision):
    """Take what the decisions of the environments from ``i`` on set, and nothing summed yet."""
    running = columns(decision.running)
    for k in range(running.shape[1]):
        goes_on = active[i + k] and batch.tick[i + k] < damping.end[i + k]
        running[0, k] = 1.0 if goes_on else 0.0
        if active[i + k]:
            batch.reward[i + k] = batch.cost[i + k] = 0.0  # stays so after the end of the episode
            batch.terms[i + k, :] = damping.price[i + k, :] = 0.0
            batch.clipped[i + k] = clipped(actions[i + k])
            apply_decision(law, batch.obs[i + k], actions[i + k], damping.law.factor[i + k], damping.law.share[i + k])
    _load_state(damping.law, i, decision.law)
    decision.reward[0] = decision.cost[0] = 0.0
    decision.terms[:] = 0.0
    decision.price[:] = 0.0


@kernel
def _add(task, group, period, decision):
    """Add what a control period gave to the sums, where the episode still runs.

    A panel's price is the integral over time of its own vibration and effort and its share of the squared tracking
    error, each over its scale and times its weight: linear in them, as the score is, and without bounds.
    """
    runs, weights = decision.running[0] > 0.0, task.weights
    decision.reward[0] += where(runs, group.reward[0], 0.0)
    decision.cost[0] += where(runs, group.cost[0], 0.0)
    for k in range(len(group.terms)):
        decision.terms[k] += where(runs, group.terms[k], 0.0)
    n_c, n_p = task.actuators.gain.shape[1], len(period.energy)
    square = group.signals[ERROR] * group.signals[ERROR]
    for k in range(n_p):
        effort = 0.0
        for c in range(k * n_c, (k + 1) * n_c):
            effort += period.applied[c] * period.applied[c]
        price = weights.tracking * square / (weights.tracking_scale * n_p)
        price += weights.vibration * period.energy[k] / weights.vibration_scale
        price += weights.effort * effort / weights.effort_scale
        decision.price[k] += where(runs, task.period * price, 0.0)


@kernel
def _end_decision(law, batch, damping, i, group, period, decision, lane):
    """Bring a lane back as environment ``i`` with the sums of its decision, and the features of the next one."""
    store(batch, i, group, period, lane)
    batch.reward[i], batch.cost[i] = columns(decision.reward)[0, lane], columns(decision.cost)[0, lane]
    take(decision.terms, lane, batch.terms[i])
    take(decision.price, lane, damping.price[i])
    _store_state(decision.law, lane, damping.law, i)
    see(law, batch.obs[i], damping.law.demand[i], damping.law.seen[i])


@kernel
def _load_state(states, i, state):
    """Take the states of the laws from ``i`` on, a lane each."""
    for panel in range(len(state.B_hat)):
        gather(states.B_hat[:, panel], i, state.B_hat[panel])
        gather(states.factor[:, panel], i, state.factor[panel])
    gather(states.share, i, state.share)
    for k in range(len(state.errors)):
        gather(states.errors[:, k], i, state.errors[k])
    gather(states.integral, i, state.integral)
    gather(states.late, i, state.late)
    gather(states.age, i, state.age)
    for panel in range(len(state.filters)):
        for mode in range(len(state.filters[panel])):
            gather(states.filters[:, panel, mode], i, state.filters[panel, mode])
        gather(states.plan[:, panel], i, state.plan[panel])
    gather(states.wait, i, state.wait)


@kernel
def _store_state(state, lane, states, i):
    """Bring a lane back as the state of law ``i``; factor and share are what they were."""
    for panel in range(len(state.B_hat)):
        take(state.B_hat[panel], lane, states.B_hat[i, panel])
    for k in range(len(state.errors)):
        take(state.errors[k], lane, states.errors[i, k])
    take(state.demand, lane, states.demand[i])
    take(state.integral, lane, states.integral[i])
    take(state.late, lane, states.late[i])
    take(state.age, lane, states.age[i])
    for panel in range(len(state.filters)):
        for mode in range(len(state.filters[panel])):
            take(state.filters[panel, mode], lane, states.filters[i, panel, mode])
        take(state.plan[panel], lane, states.plan[i, panel])
    take(state.wait, lane, states.wait[i])
