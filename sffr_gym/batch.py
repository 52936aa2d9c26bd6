"""Many environments as arrays, advanced by one compiled call: the core of the single and of the vector environment."""

from __future__ import annotations

import functools
import itertools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from sffr_gym._jit import kernel
from sffr_gym.beam import Array
from sffr_gym.disturbances import Impulses, Sensing, hit, sense
from sffr_gym.episode import Episode
from sffr_gym.fleet import Fleet, robot_at
from sffr_gym.lanes import ONE, WIDTH, columns, gather, in_lanes, put, take, zeros
from sffr_gym.model import IntArray, n_positions
from sffr_gym.reference import Reference
from sffr_gym.scenario import MOST_IMPULSES
from sffr_gym.task import (
    N_SIGNALS,
    NOT_FINITE,
    REWARDS,
    Robot,
    control_period,
    make_buffers,
    period_cost,
    reward_terms,
    view,
)

THREADS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
N_REFERENCE = len(Reference._fields) - 1  # numbers of a Reference beside its joints
NEVER = -1  # control period of a blow that does not come
SMALLEST_CHUNK = 32  # environments; handing fewer to a thread costs more than it saves


class Batch(NamedTuple):
    """State and outputs of ``n`` environments; row i belongs to environment i alone.

    Attributes:
        tick: (n,) control periods since the start.
        p, v: (n, n_p) positions and velocities.
        reference: (n, 10) numbers of each :class:`Reference`; joints: (n, n_l) its joint angles.
        wrench: (n, 3) force of the surroundings on the base, base axes.
        level: (n, n_o), key, delay: (n,) of each :class:`disturbances.Sensing`.
        impulse_tick: (n, MOST_IMPULSES), impulse: (n, MOST_IMPULSES, 3) of each :class:`disturbances.Impulses`.
        obs, reward, terms, signals, cost: what the last period gave.
        applied: (n, n_u) commands after the limits.
        clipped: (n,) how many entries of the last action lay beyond [-1, 1].
        status: (n,) why an episode ended; see ``task``.
    """

    tick: IntArray
    p: Array
    v: Array
    reference: Array
    joints: Array
    wrench: Array
    level: Array
    key: IntArray
    delay: IntArray
    impulse_tick: IntArray
    impulse: Array
    obs: Array
    reward: Array
    terms: Array
    signals: Array
    cost: Array
    applied: Array
    clipped: IntArray
    status: IntArray


class Group(NamedTuple):
    """Environments that a kernel advances at once: one, or one in each lane; see :class:`Batch`."""

    p: Array
    v: Array
    reference: Array
    joints: Array
    wrench: Array
    command: Array
    t: Array  # (1,) time at the end of the period [s]
    obs: Array
    signals: Array
    terms: Array
    reward: Array  # (1,)
    cost: Array  # (1,)
    status: Array  # (1,)


@kernel(allocates=True)
def make_group(robot, one):
    """Allocate a group of environments, of numbers of the kind of ``one``; see :func:`lanes.zeros`."""
    n, n_u, n_o = n_positions(robot.model), len(robot.actuators.limit), len(robot.bound)
    return Group(
        p=zeros(one, n), v=zeros(one, n), reference=zeros(one, N_REFERENCE),
        joints=zeros(one, len(robot.model.link_mass)), wrench=zeros(one, 3), command=zeros(one, n_u),
        t=zeros(one, 1), obs=zeros(one, n_o), signals=zeros(one, N_SIGNALS), terms=zeros(one, len(REWARDS)),
        reward=zeros(one, 1), cost=zeros(one, 1), status=zeros(one, 1),
    )  # fmt: skip


def make_batch(robot: Robot, n: int) -> Batch:
    """Allocate ``n`` environments of one robot."""
    size, n_u, n_o = n_positions(robot.model), len(robot.actuators.limit), len(robot.bound)
    return Batch(
        tick=np.zeros(n, dtype=np.int64), p=np.zeros((n, size)), v=np.zeros((n, size)),
        reference=np.zeros((n, N_REFERENCE)), joints=np.zeros((n, len(robot.model.link_mass))),
        wrench=np.zeros((n, 3)), level=np.zeros((n, n_o)), key=np.zeros(n, dtype=np.int64),
        delay=np.zeros(n, dtype=np.int64), impulse_tick=np.zeros((n, MOST_IMPULSES), dtype=np.int64),
        impulse=np.zeros((n, MOST_IMPULSES, 3)), obs=np.zeros((n, n_o)), reward=np.zeros(n),
        terms=np.zeros((n, len(REWARDS))), signals=np.zeros((n, N_SIGNALS)), cost=np.zeros(n),
        applied=np.zeros((n, n_u)), clipped=np.zeros(n, dtype=np.int64), status=np.zeros(n, dtype=np.int64),
    )  # fmt: skip


def start_episode(fleet: Fleet, batch: Batch, i: int, episode: Episode) -> None:
    """Put environment ``i`` at the start of an episode, measured, and observed as its sensors do."""
    for array in batch:
        array[i] = 0
    batch.p[i], batch.v[i] = episode.p, episode.v
    batch.reference[i], batch.joints[i] = episode.reference[:-1], episode.reference.joints
    batch.level[i], batch.key[i], batch.delay[i] = episode.sensing
    count = len(episode.impulses.tick)
    batch.impulse_tick[i] = NEVER
    batch.impulse_tick[i, :count], batch.impulse[i, :count] = episode.impulses
    view_one(fleet, batch, i)


@kernel(allocates=True)
def view_one(fleet, batch, i):
    """Observe and measure environment ``i`` at its present time, without a step; late sensors see it as it is."""
    robot = robot_at(fleet, i, np.zeros(2, dtype=np.int64))
    buffers, reference = make_buffers(robot), _reference(batch.reference[i], batch.joints[i])
    view(
        robot, reference, batch.tick[i] * robot.period, batch.p[i], batch.v[i], buffers, batch.obs[i], batch.signals[i]
    )
    sense(
        robot, reference, _sensing(batch, i), batch.tick[i], batch.p[i], batch.v[i], buffers.step.dynamics, batch.obs[i]
    )


def step_batch(fleet: Fleet, batch: Batch, actions: Array, active: np.ndarray) -> None:
    """Advance the active environments of a batch by one control period, in lanes and on as many threads as pay.

    Args:
        fleet: their plants.
        batch: the environments, advanced in place.
        actions: (n, n_u) actions; what lies beyond [-1, 1] is clipped and counted.
        active: (n,) False leaves an environment as it is.
    """
    share_out(fleet, batch, step_range, step_lanes, (fleet, batch, actions, active), SMALLEST_CHUNK)


def share_out(
    fleet: Fleet,
    batch: Batch,
    one_by_one: Callable[..., Any],
    lanes: Callable[..., Any],
    arguments: tuple[Any, ...],
    smallest: int,
) -> None:
    """Call kernels ``kernel(*arguments, first, last)`` for all environments of a batch.

    Args:
        fleet: their plants.
        batch: the environments.
        one_by_one: kernel for any environments.
        lanes: kernel that does the same in lanes, for robots that are alike where they fill them.
        arguments: of the kernels, which release the interpreter's lock.
        smallest: number of environments that pay for a thread.
    """
    n = len(batch.tick)
    filled = n - n % WIDTH if len(fleet.numbers) == 1 else 0
    if filled:
        _in_threads(partial(lanes, *arguments), 0, filled, smallest, WIDTH)
    if filled < n:
        _in_threads(partial(one_by_one, *arguments), filled, n, smallest, 1)


def _in_threads(advance: Callable[[int, int], Any], first: int, last: int, smallest: int, width: int) -> None:
    """Call ``advance`` for the environments from ``first`` up to ``last``, cut at multiples of ``width``."""
    chunks = min(THREADS, (last - first) // smallest)
    if chunks < 2:
        advance(first, last)
        return
    ends = [first + (last - first) * chunk // chunks // width * width for chunk in range(chunks)] + [last]
    jobs = [_pool().submit(advance, *span) for span in itertools.pairwise(ends)]
    for job in jobs:
        job.result()


@kernel(allocates=True, nogil=True)
def step_range(fleet, batch, actions, active, first, last):
    """Advance the active environments from ``first`` up to ``last`` by one control period, one after the other."""
    _step(fleet, batch, actions, active, first, last, ONE)


@kernel(allocates=True, nogil=True)
def step_lanes(fleet, batch, actions, active, first, last):
    """Do the same in lanes, for robots that are alike and as many as fill all lanes."""
    _step(fleet, batch, actions, active, first, last, in_lanes(ONE))


@kernel(allocates=True, inline=True)
def _step(fleet, batch, actions, active, first, last, one):
    """Advance environments by numbers of the kind of ``one``; see :func:`lanes.zeros`."""
    cursor = np.zeros(2, dtype=np.int64)
    robot = robot_at(fleet, first, cursor)
    group, buffers, alone = make_group(robot, one), make_buffers(robot, one), make_buffers(robot)
    width = columns(group.t).shape[1]
    for i in range(first, last, width):
        if len(fleet.numbers) > 1:  # looking at another robot takes a tenth of a period
            robot = robot_at(fleet, i, cursor)
        load(batch, i, group)
        gather(actions, i, group.command)
        for k in range(len(group.command)):
            group.command[k] = min(max(group.command[k], -1.0), 1.0) * robot.scale[k]
        for k in range(i, i + width):
            if active[k]:
                begin(robot, batch, k, group, k - i)
                batch.clipped[k] = clipped(actions[k])
        advance_group(robot, group, buffers)
        for k in range(i, i + width):
            if active[k]:
                sense_lane(robot, batch, k, group, buffers, k - i, alone)
                store(batch, k, group, buffers, k - i)
                batch.reward[k], batch.cost[k] = columns(group.reward)[0, k - i], columns(group.cost)[0, k - i]
                take(group.terms, k - i, batch.terms[k])


@kernel(inline=True)
def clipped(action):
    """How many entries of an action lie beyond [-1, 1]."""
    count = 0
    for k in range(len(action)):
        count += abs(action[k]) > 1.0
    return count


@kernel(inline=True)
def load(batch, i, group):
    """Take the environments from ``i`` on into a group."""
    gather(batch.p, i, group.p)
    gather(batch.v, i, group.v)
    gather(batch.reference, i, group.reference)
    gather(batch.joints, i, group.joints)
    gather(batch.obs, i, group.obs)
    gather(batch.signals, i, group.signals)


@kernel(inline=True)
def begin(robot, batch, i, group, lane):
    """Let the next control period of environment ``i`` begin in a lane of a group, with the blows that fall in it."""
    hit(Impulses(batch.impulse_tick[i], batch.impulse[i]), batch.tick[i], robot.period, batch.wrench[i])
    put(batch.wrench[i], group.wrench, lane)
    batch.tick[i] += 1
    columns(group.t)[0, lane] = batch.tick[i] * robot.period


@kernel(inline=True)
def advance_group(robot, group, buffers):
    """Hold the command of a group for one control period, and judge it."""
    group.status[0] = control_period(
        robot, _reference(group.reference, group.joints), group.t[0], group.p, group.v, group.command, group.wrench,
        buffers, group.obs, group.signals,
    )  # fmt: skip
    group.reward[0] = reward_terms(robot, group.signals, group.terms)
    group.cost[0] = period_cost(group.signals, group.status[0])


@kernel(inline=True)
def sense_lane(robot, batch, i, group, buffers, lane, alone):
    """Turn the true observation of a lane, environment ``i``, into what its sensors see.

    buffers: those of :func:`advance_group`; alone: buffers of a single robot.
    """
    if columns(group.status)[0, lane] == NOT_FINITE or not (batch.key[i] > 0 or batch.delay[i] > 0):
        return
    take(buffers.p, lane, alone.p)
    take(buffers.v, lane, alone.v)
    take(group.obs, lane, alone.obs)
    reference, sensing = _reference(batch.reference[i], batch.joints[i]), _sensing(batch, i)
    sense(robot, reference, sensing, batch.tick[i], alone.p, alone.v, alone.step.dynamics, alone.obs)
    put(alone.obs, group.obs, lane)


@kernel(inline=True)
def store(batch, i, group, buffers, lane):
    """Bring a lane of a group back as environment ``i``."""
    batch.status[i] = int(columns(group.status)[0, lane])
    take(group.p, lane, batch.p[i])
    take(group.v, lane, batch.v[i])
    take(group.obs, lane, batch.obs[i])
    take(group.signals, lane, batch.signals[i])
    take(buffers.applied, lane, batch.applied[i])


@functools.cache
def _pool() -> ThreadPoolExecutor:
    """Threads for the kernels, which release the interpreter's lock."""
    return ThreadPoolExecutor(THREADS, thread_name_prefix="sffr-gym")


if hasattr(os, "register_at_fork"):  # threads do not survive a fork: the child makes its own
    os.register_at_fork(after_in_child=_pool.cache_clear)


@kernel(inline=True, allocates=True)
def _sensing(batch, i):
    return Sensing(batch.level[i], batch.key[i], batch.delay[i])


@kernel(inline=True, allocates=True)
def _reference(r, joints):
    return Reference(r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], r[9], joints)
