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

from sffr_gym._jit import assign, kernel
from sffr_gym.beam import Array
from sffr_gym.disturbances import Impulses, Sensing, hit, sense
from sffr_gym.episode import Episode
from sffr_gym.fleet import Fleet, robot_at
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


def make_batch(robot: Robot, n: int) -> Batch:
    """Allocate ``n`` environments of one robot."""
    size, n_u, n_o = n_positions(robot.model), len(robot.actuators.limit), len(robot.bound)
    return Batch(
        tick=np.zeros(n, dtype=np.int64), p=np.zeros((n, size)), v=np.zeros((n, size)),
        reference=np.zeros((n, len(Reference._fields) - 1)), joints=np.zeros((n, len(robot.model.link_mass))),
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
    buffers, reference = make_buffers(robot), _reference(batch, i)
    view(
        robot, reference, batch.tick[i] * robot.period, batch.p[i], batch.v[i], buffers, batch.obs[i], batch.signals[i]
    )
    sense(
        robot, reference, _sensing(batch, i), batch.tick[i], batch.p[i], batch.v[i], buffers.step.dynamics, batch.obs[i]
    )


def step_batch(fleet: Fleet, batch: Batch, actions: Array, active: np.ndarray) -> None:
    """Advance the active environments of a batch by one control period, on as many threads as pay.

    Args:
        fleet: their plants.
        batch: the environments, advanced in place.
        actions: (n, n_u) actions; what lies beyond [-1, 1] is clipped and counted.
        active: (n,) False leaves an environment as it is.
    """
    spread(len(batch.tick), partial(step_range, fleet, batch, actions, active), SMALLEST_CHUNK)


def spread(n: int, advance: Callable[[int, int], Any], smallest: int) -> None:
    """Call ``advance(first, last)`` for all of ``n`` environments, on as many threads as pay.

    Args:
        n: number of environments.
        advance: a kernel that releases the interpreter's lock.
        smallest: number of environments that pay for a thread.
    """
    chunks = min(THREADS, n // smallest)
    if chunks < 2:
        advance(0, n)
        return
    ends = [n * chunk // chunks for chunk in range(chunks + 1)]
    jobs = [_pool().submit(advance, *span) for span in itertools.pairwise(ends)]
    for job in jobs:
        job.result()


@kernel(allocates=True, nogil=True)
def step_range(fleet, batch, actions, active, first, last):
    """Advance the active environments from ``first`` up to ``last`` by one control period."""
    cursor = np.zeros(2, dtype=np.int64)
    robot = robot_at(fleet, first, cursor)
    buffers = make_buffers(robot)
    command = np.zeros(actions.shape[1])
    for i in range(first, last):
        if not active[i]:
            continue
        if len(fleet.numbers) > 1:  # looking at another robot takes a tenth of a period
            robot = robot_at(fleet, i, cursor)
        batch.clipped[i] = 0
        for k in range(len(command)):
            action = min(max(actions[i, k], -1.0), 1.0)
            batch.clipped[i] += action != actions[i, k]
            command[k] = action * robot.scale[k]
        advance_one(robot, batch, i, command, buffers)


@kernel(inline=True, allocates=True)
def advance_one(robot, batch, i, command, buffers):
    """Hold a command (n_u,) in environment ``i``, whose plant is ``robot``, for one control period."""
    reference = _reference(batch, i)
    hit(Impulses(batch.impulse_tick[i], batch.impulse[i]), batch.tick[i], robot.period, batch.wrench[i])
    batch.tick[i] += 1
    batch.status[i] = control_period(
        robot, reference, batch.tick[i] * robot.period, batch.p[i], batch.v[i], command,
        batch.wrench[i], buffers, batch.obs[i], batch.signals[i],
    )  # fmt: skip
    if batch.status[i] != NOT_FINITE:  # else the last observation stays
        sense(
            robot, reference, _sensing(batch, i), batch.tick[i], buffers.p, buffers.v, buffers.step.dynamics,
            batch.obs[i],
        )  # fmt: skip
    assign(batch.applied[i], buffers.applied)
    batch.reward[i] = reward_terms(robot, batch.signals[i], batch.terms[i])
    batch.cost[i] = period_cost(batch.signals[i], batch.status[i])


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
def _reference(batch, i):
    r = batch.reference[i]
    return Reference(r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], r[9], batch.joints[i])
