"""Many closed loops whose virtual damping is chosen from outside, advanced by one compiled call for each decision."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from baselines.closed_loop import Law, control
from baselines.mic import mic_workspace
from baselines.schedule import N_FEATURES, look, stretch
from sffr_gym._jit import kernel
from sffr_gym.batch import Batch, advance_one, spread
from sffr_gym.beam import Array
from sffr_gym.fleet import Fleet, robot_at
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
    spread(len(batch.tick), partial(damping_range, fleet, batch, law, damping, actions, active), smallest=1)


@kernel(allocates=True, nogil=True)
def damping_range(fleet, batch, law, damping, actions, active, first, last):
    """Advance the active environments from ``first`` up to ``last`` by one decision."""
    cursor = np.zeros(2, dtype=np.int64)
    robot = robot_at(fleet, first, cursor)
    buffers, work = make_buffers(robot), mic_workspace(law.prior)
    command, terms = np.zeros(len(law.scale)), np.zeros(batch.terms.shape[1])
    n_c = law.allocation.shape[1]
    for i in range(first, last):
        if not active[i]:
            continue
        if len(fleet.numbers) > 1:
            robot = robot_at(fleet, i, cursor)
        clipped, reward, cost = 0, 0.0, 0.0
        for k in range(actions.shape[1]):
            clipped += abs(actions[i, k]) > 1.0
        stretch(law, law.schedule.rho, actions[i], damping.factor[i])
        damping.reward[i] = 0.0
        terms[:] = 0.0
        for _ in range(min(law.schedule.hold, damping.end[i] - batch.tick[i])):
            control(law, batch.obs[i], damping.B_hat[i], damping.factor[i], work, command)
            for k in range(len(command)):  # an action's bounds, as in the environment
                command[k] = min(max(command[k] / law.scale[k], -1.0), 1.0) * robot.scale[k]
            advance_one(robot, batch, i, command, buffers)
            reward += batch.reward[i]
            cost += batch.cost[i]
            terms += batch.terms[i]
            for k in range(len(buffers.energy)):
                damping.reward[i, k] -= robot.period * robot.weight[1] * buffers.energy[k]
                for c in range(k * n_c, (k + 1) * n_c):
                    damping.reward[i, k] -= robot.period * robot.weight[2] * buffers.applied[c] * buffers.applied[c]
            if batch.status[i] != RUNNING:
                break
        batch.reward[i], batch.cost[i], batch.clipped[i] = reward, cost, clipped
        batch.terms[i] = terms
        look(law, batch.obs[i], damping.seen[i])
