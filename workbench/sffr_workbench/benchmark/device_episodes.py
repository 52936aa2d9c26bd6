"""Episodes of a benchmark on a GPU: those of one law in one scenario beside each other, measured where they run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sffr_baselines.device_law import DeviceLaw
from sffr_gym.envs.device import DeviceVectorEnv
from sffr_gym.task.metrics import SETTLED, Totals, instability_of, last_ticks, measures_of
from sffr_gym.task.score import Result
from sffr_gym.task.signals import N_SIGNALS, VIBRATION
from sffr_gym.task.status import NOT_FINITE, REASONS

MOST_NUMBERS = 2**31  # of the vibration of all episodes that run beside each other: 16 GiB


def run_on_device(envs: DeviceVectorEnv, policy: Any, seeds: Sequence[int]) -> list[Result]:
    """Run an episode of a law for each of as many seeds as there are environments, and measure it.

    Args:
        envs: the environments; their autoreset mode does not matter.
        policy: the law, a :class:`sffr_baselines.laws.LawPolicy`.
        seeds: of the episodes.
    """
    envs.reset(seed=list(seeds))
    law, sums = DeviceLaw(policy.law, envs), _Sums(envs)
    while not bool(envs.done.all()):
        for _ in range(sums.piece):
            envs.go_on(law())
            sums.add()
    return [
        Result(envs.host.scenario.name, policy.name, seed, *sums.measures(i), envs.drawn(i))
        for i, seed in enumerate(seeds)
    ]


def most_episodes(ticks: int) -> int:
    """Return how many episodes of so many control periods run beside each other at most."""
    return max(MOST_NUMBERS // ticks, 1)


class _Sums:
    """What the measures of each episode are made of, summed up as they go on; see :class:`metrics.Totals`.

    Attributes:
        piece: control periods between two looks at whether all are over.
    """

    piece = 100

    def __init__(self, envs: DeviceVectorEnv) -> None:
        xp, n = envs.device.xp, envs.num_envs
        self._xp, self._envs, self._period = xp, envs, envs.host.prior_task.period
        ticks = envs.ticks.tolist()
        self._last = [last_ticks(each) for each in ticks]
        self._late = envs.ticks - xp.asarray(np.array(self._last))  # control period at which the last part begins
        self._sums, self._squares, self._largest, self._at_end = xp.zeros((4, n, N_SIGNALS))
        self._energy = xp.zeros((max(ticks), n))
        self._tick, self._counted = 0, xp.zeros(n, dtype=np.int64)
        self._found: Any = None

    def add(self) -> None:
        """Add the control period that ended, of the episodes that ran in it."""
        xp, batch = self._xp, self._envs.batch
        if self._tick == len(self._energy):
            return
        runs = ((batch.tick > self._counted) & (batch.status != NOT_FINITE))[:, None]  # no signals of what diverged
        signals = xp.where(runs, batch.signals, 0.0)
        self._sums += signals
        self._squares += signals * signals
        xp.maximum(self._largest, signals, out=self._largest)  # none is negative
        self._at_end += xp.where((batch.tick > self._late)[:, None], signals, 0.0)
        self._energy[self._tick] = signals[:, VIBRATION]
        self._counted[...] = batch.tick
        self._tick += 1

    def measures(self, i: int) -> tuple[dict[str, float], str]:
        """Return the measures of episode ``i``, and why it failed."""
        if self._found is None:
            self._found = self._collect()
        sums, squares, largest, at_end, settled, ticks, status = (each[i] for each in self._found)
        failure = REASONS[float(status)]
        if not failure:
            failure = instability_of(at_end / self._last[i], self._last[i], largest[VIBRATION], self._period)
        totals = Totals(int(ticks), sums, squares, largest, int(settled))
        return measures_of(totals, self._period, failure), failure

    def _collect(self) -> list[np.ndarray]:
        """Return what was summed up, on the processor."""
        xp, batch = self._xp, self._envs.batch
        above = self._energy > SETTLED * self._largest[:, VIBRATION]
        ever, last = above.any(axis=0), len(above) - xp.argmax(above[::-1], axis=0)
        arrays = (
            self._sums, self._squares, self._largest, self._at_end, xp.where(ever, last, 0), batch.tick, batch.status,
        )  # fmt: skip
        return [array if isinstance(array, np.ndarray) else array.get() for array in arrays]
