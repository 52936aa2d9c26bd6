"""Many environments as arrays, advanced by one compiled call: the core of the single and of the vector environment."""

from __future__ import annotations

import functools
import itertools
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from sffr_gym.compile.arguments import Structures
from sffr_gym.compile.kernels import Call, Entry, entry, kernel
from sffr_gym.compile.lanes import WIDTH, columns, gather, put, take
from sffr_gym.compile.library import load_library
from sffr_gym.compile.threads import available_cores
from sffr_gym.compile.workspace import allocate, new_workspace, workspace
from sffr_gym.envs.lane_plants import LanePlants
from sffr_gym.physics.actuators import command_of, state_size
from sffr_gym.render.trace import Moment
from sffr_gym.task.control_period import PeriodWork, control_period, observe_state, period_shapes
from sffr_gym.task.disturbances import NEVER, Impulses, Sensing, impulse_wrench, sense
from sffr_gym.task.episode import Episode
from sffr_gym.task.observation import clip
from sffr_gym.task.reference import flat_reference, reference_at
from sffr_gym.task.reward import REWARDS, period_cost, reward_terms
from sffr_gym.task.scenario import MOST_IMPULSES
from sffr_gym.task.signals import N_SIGNALS
from sffr_gym.task.status import NOT_FINITE
from sffr_gym.task.task_model import TaskModel
from sffr_gym.types import Array, IntArray

THREADS = available_cores()
SMALLEST_CHUNK = 32  # environments; handing fewer to a thread costs more than it saves


class Batch(NamedTuple):
    """State and outputs of ``n`` environments; row i belongs to environment i alone."""

    tick: IntArray  #: (n,) control periods since the start
    p: Array  #: (n, n_q) positions and velocities
    v: Array  #: (n, n_q)
    reference: Array  #: (n, ...) numbers of each :class:`Reference`, joint angles and pieces last
    actuation: Array  #: (n, n_u + 9) numbers of each :class:`actuators.ActuatorState`
    wrench: Array  #: (n, 3) force of the surroundings on the base, base axes
    level: Array  #: (n, n_o), key, delay: (n,), quantum: (n, n_o), coarse: (n,) of each :class:`disturbances.Sensing`
    key: IntArray
    delay: IntArray
    quantum: Array
    coarse: IntArray
    impulse_tick: IntArray  #: (n, MOST_IMPULSES), impulse: (n, MOST_IMPULSES, 3) of each :class:`disturbances.Impulses`
    impulse: Array
    obs: Array  #: what the last period gave
    reward: Array
    terms: Array
    signals: Array
    cost: Array
    applied: Array  #: (n, n_u) what the actuators gave of the commands
    clipped: IntArray  #: (n,) how many entries of the last action lay beyond [-1, 1]
    status: IntArray  #: (n,) why an episode ended; see ``task.status``


class Group(NamedTuple):
    """Environments that a kernel advances at once: one, or one in each lane; see :class:`Batch`."""

    p: Array
    v: Array
    reference: Array
    actuation: Array
    wrench: Array
    command: Array
    t: Array  #: (1,) time at the end of the period [s]
    obs: Array
    signals: Array
    terms: Array
    reward: Array  #: (1,)
    cost: Array  #: (1,)
    status: Array  #: (1,)


class GroupWork(NamedTuple):
    """Memory of a group: the control period's first, so that those of one environment can share a block."""

    period: PeriodWork
    group: Group


def group_shapes(task):
    """Shapes of the :class:`GroupWork` of a robot."""
    n, n_u, n_o = task.model.at.end, len(task.scale), len(task.bound)
    group = Group(
        p=(n,), v=(n,), reference=(task.reference,), actuation=(state_size(n_u),), wrench=(3,), command=(n_u,), t=(1,),
        obs=(n_o,), signals=(N_SIGNALS,), terms=(len(REWARDS),), reward=(1,), cost=(1,), status=(1,),
    )  # fmt: skip
    return GroupWork(period_shapes(task), group)


def make_batch(task: TaskModel, n: int) -> Batch:
    """Allocate ``n`` environments of one robot."""
    size, n_u, n_o = task.model.at.end, len(task.scale), len(task.bound)
    return Batch(
        tick=np.zeros(n, dtype=np.int64), p=np.zeros((n, size)), v=np.zeros((n, size)),
        reference=np.zeros((n, task.reference)),
        actuation=np.zeros((n, state_size(n_u))), wrench=np.zeros((n, 3)), level=np.zeros((n, n_o)),
        key=np.zeros(n, dtype=np.int64), delay=np.zeros(n, dtype=np.int64), quantum=np.zeros((n, n_o)),
        coarse=np.zeros(n, dtype=np.int64), impulse_tick=np.zeros((n, MOST_IMPULSES), dtype=np.int64),
        impulse=np.zeros((n, MOST_IMPULSES, 3)), obs=np.zeros((n, n_o)), reward=np.zeros(n),
        terms=np.zeros((n, len(REWARDS))), signals=np.zeros((n, N_SIGNALS)), cost=np.zeros(n),
        applied=np.zeros((n, n_u)), clipped=np.zeros(n, dtype=np.int64), status=np.zeros(n, dtype=np.int64),
    )  # fmt: skip


def put_episode(batch: Batch, i: int, episode: Episode) -> None:
    """Put environment ``i`` at the start of an episode; :meth:`Stepper.observe` then shows and measures it."""
    for array in batch:
        array[i] = 0
    batch.p[i], batch.v[i] = episode.p, episode.v
    batch.reference[i] = flat_reference(episode.reference)
    batch.level[i], batch.key[i], batch.delay[i], batch.quantum[i], batch.coarse[i] = episode.sensing
    count = len(episode.impulses.tick)
    batch.impulse_tick[i] = NEVER
    batch.impulse_tick[i, :count], batch.impulse[i, :count] = episode.impulses


class Setup(NamedTuple):
    """What is called to advance a batch; see :class:`Stepper`."""

    kernel: Entry
    plants: Structures
    batch: Batch
    more: tuple[Any, ...]
    shapes: Any  #: of the memory of a group
    seeing: Entry | None  #: called as ``seeing(*more, batch.obs, chosen, first, last)`` after an observation


class Stepper:
    """Advances a batch, by calls that are prepared once: in lanes where these can be filled, on threads that pay.

    Args:
        kernel: called as ``kernel(groups, plants, batch, *more, actions, active, work, one, first, last)`` for the
            environments from ``first`` up to ``last``: step_range or a relative.
        plants: of each environment, or a single one if all are alike.
        batch: the environments; advanced in place.
        n_actions: numbers of an action.
        shapes: of the memory of a group, which begins with a :class:`PeriodWork`.
        more: further arguments of the kernel.
        seeing: what else an observation is followed by; see :class:`Setup`.
        smallest: environments that pay for a thread.

    Attributes:
        actions: (n, n_actions) and active: (n,) what :meth:`step` takes; to be filled.
        setup: what is called.
    """

    def __init__(
        self, kernel: Entry, plants: Sequence[TaskModel], batch: Batch, n_actions: int, shapes: Any,
        more: tuple[Any, ...] = (), seeing: Entry | None = None, smallest: int = SMALLEST_CHUNK,
    ) -> None:  # fmt: skip
        n = len(batch.tick)
        self.actions, self.active = np.zeros((n, n_actions)), np.ones(n, dtype=np.bool_)
        self._plants = Structures(plants)
        self.setup = Setup(kernel, self._plants, batch, more, shapes, seeing)
        filled = n - n % WIDTH if load_library() is not None else 0
        own = len(plants) > 1 and filled > 0
        self._groups = LanePlants(plants[k : k + WIDTH] for k in range(0, filled, WIDTH)) if own else None
        groups = self._plants if self._groups is None else self._groups.structures
        arguments = self._plants, batch, *more, self.actions, self.active

        def prepare(groups: Structures, first: int, last: int, width: int) -> list[Call]:
            chunks = max(1, min(THREADS, (last - first) // smallest))
            ends = [first + (last - first) * chunk // chunks // width * width for chunk in range(chunks)] + [last]
            spans = list(itertools.pairwise(ends)) if last > first else []
            return [kernel.bind(groups, *arguments, *group_memory(shapes, width), *span) for span in spans]

        parts = prepare(groups, 0, filled, WIDTH), prepare(self._plants, filled, n, 1)
        self._in_lanes = [calls for calls in parts if calls]
        self._one_by_one = [prepare(self._plants, 0, n, 1)] if own else self._in_lanes
        self._chosen = np.zeros(n, dtype=np.bool_)
        self._observing = [observe_range.bind(self._plants, batch, self._chosen, new_workspace(shapes.period), 0, n)]
        if seeing is not None:
            self._observing.append(seeing.bind(*more, batch.obs, self._chosen, 0, n))

    def put_plant(self, i: int, plant: TaskModel) -> None:
        """Replace the plant of environment ``i``."""
        self._plants[i] = plant
        if self._groups is not None:
            self._groups.put(i, plant)

    def step(self) -> None:
        """Advance the active environments under the actions."""
        as_they_are = self._groups is None or self._groups.fit
        for calls in self._in_lanes if as_they_are else self._one_by_one:
            jobs = [_pool().submit(call) for call in calls[1:]]  # this thread works, too: it need not be woken
            calls[0]()
            for job in jobs:
                job.result()

    def observe(self, chosen: Any = True) -> None:
        """Observe and measure the chosen environments (n,), or all, where they are, without a step."""
        self._chosen[:] = chosen
        for call in self._observing:
            call()


def group_memory(shapes: Any, width: int) -> tuple[Any, PeriodWork]:
    """Return memory of a group of so many environments, and of the control period of a single one."""
    work = workspace(allocate(shapes, lanes=width > 1)[0], shapes)
    return work, work.period if width == 1 else new_workspace(shapes.period)


@entry
def observe_range(plants, batch, chosen, one, first, last):
    """Observe the chosen environments from ``first`` up to ``last`` at their present time, without a step.

    plants, batch: see :class:`Stepper`; chosen: (n,); one: :class:`PeriodWork` of a single environment.
    """
    for i in range(first, last):
        if chosen[i]:
            task = plants[i if len(plants) > 1 else 0]
            reference = reference_at(batch.reference[i], len(task.model.link_mass))
            p, v, obs = batch.p[i], batch.v[i], batch.obs[i]
            observe_state(task, reference, batch.tick[i] * task.period, p, v, one, obs, batch.signals[i])
            clip(task.bound, obs)  # late sensors see it as it is
            sense(task, reference, _sensing(batch, i), batch.tick[i], p, v, one.step.dynamics, obs)


@entry
def step_range(groups, plants, batch, actions, active, work, one, first, last):
    """Advance the active environments from ``first`` up to ``last`` by one control period.

    groups: the plants in the kind of number of a group, of each group or a single one for all.
    plants, batch, actions, active: see :class:`Stepper`; what lies beyond [-1, 1] is clipped and counted.
    work: :class:`GroupWork`, whose kind of number decides how many environments are advanced at once.
    one: :class:`PeriodWork` of a single environment, the same memory if that is what a group is.
    """
    group, width = work.group, columns(work.group.t).shape[1]
    for i in range(first, last, width):
        task = groups[i // width if len(groups) > 1 else 0]
        load(batch, i, group)
        gather(actions, i, group.command)
        command_of(group.command, task.scale, group.command)
        for k in range(i, i + width):
            if active[k]:
                begin(task, batch, k, group, k - i)
                batch.clipped[k] = clipped(actions[k])
        advance_group(task, group, work.period)
        for k in range(i, i + width):
            if active[k]:
                sense_lane(plants[k if len(plants) > 1 else 0], batch, k, group, work.period, k - i, one)
                store(batch, k, group, work.period, k - i)
                batch.reward[k], batch.cost[k] = columns(group.reward)[0, k - i], columns(group.cost)[0, k - i]
                take(group.terms, k - i, batch.terms[k])


@kernel
def clipped(action):
    """How many entries of an action (n,) lie beyond [-1, 1]."""
    count = 0
    for k in range(len(action)):
        count += abs(action[k]) > 1.0
    return count


@kernel
def load(batch, i, group):
    """Take the environments from ``i`` on into a group."""
    gather(batch.p, i, group.p)
    gather(batch.v, i, group.v)
    gather(batch.reference, i, group.reference)
    gather(batch.actuation, i, group.actuation)
    gather(batch.obs, i, group.obs)
    gather(batch.signals, i, group.signals)


@kernel
def begin(task, batch, i, group, lane):
    """Let the next control period of environment ``i`` begin in a lane of a group, with its impulses."""
    impulses = Impulses(batch.impulse_tick[i], batch.impulse[i])
    impulse_wrench(impulses, batch.tick[i], task.period, batch.wrench[i])
    put(batch.wrench[i], group.wrench, lane)
    batch.tick[i] += 1
    columns(group.t)[0, lane] = batch.tick[i] * task.period


@kernel
def advance_group(task, group, period):
    """Hold the command of a group for one control period; period: :class:`control_period.PeriodWork`."""
    group.status[0] = control_period(
        task, reference_at(group.reference, len(task.model.link_mass)), group.t[0], group.p, group.v, group.command,
        group.actuation, group.wrench, period, group.obs, group.signals,
    )  # fmt: skip
    group.reward[0] = reward_terms(task.weights, group.signals, group.status[0], group.terms)
    group.cost[0] = period_cost(group.signals, group.status[0])


@kernel
def sense_lane(task, batch, i, group, period, lane, one):
    """Turn the true observation of a lane, environment ``i``, into what its sensors see.

    period: :class:`control_period.PeriodWork` of :func:`advance_group`; one: that of a single environment.
    """
    if columns(group.status)[0, lane] == NOT_FINITE or not (
        batch.key[i] > 0 or batch.delay[i] > 0 or batch.coarse[i] > 0
    ):
        return
    before = one.before
    take(period.before.p, lane, before.p)
    take(period.before.v, lane, before.v)
    take(group.obs, lane, before.obs)
    reference, sensing = reference_at(batch.reference[i], len(task.model.link_mass)), _sensing(batch, i)
    sense(task, reference, sensing, batch.tick[i], before.p, before.v, one.step.dynamics, before.obs)
    put(before.obs, group.obs, lane)


@kernel
def store(batch, i, group, period, lane):
    """Bring a lane of a group back as environment ``i``; period: as in :func:`sense_lane`."""
    batch.status[i] = int(columns(group.status)[0, lane])
    take(group.p, lane, batch.p[i])
    take(group.v, lane, batch.v[i])
    take(group.actuation, lane, batch.actuation[i])
    take(group.obs, lane, batch.obs[i])
    take(group.signals, lane, batch.signals[i])
    take(period.applied, lane, batch.applied[i])


def visible(batch: Batch, i: int) -> Moment:
    """Return what a picture of environment ``i`` shows now; its arrays are the batch's."""
    return Moment(int(batch.tick[i]), batch.p[i], batch.v[i], batch.applied[i], float(batch.status[i]))


@functools.cache
def _pool() -> ThreadPoolExecutor:
    """Threads for the kernels, which release the interpreter's lock."""
    return ThreadPoolExecutor(THREADS, thread_name_prefix="sffr-gym")


if hasattr(os, "register_at_fork"):  # threads do not survive a fork: the child makes its own
    os.register_at_fork(after_in_child=_pool.cache_clear)


@kernel
def _sensing(batch, i):
    return Sensing(batch.level[i], batch.key[i], batch.delay[i], batch.quantum[i], batch.coarse[i])
