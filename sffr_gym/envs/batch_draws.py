"""Episodes of many environments at once: all but the random numbers by one compiled call."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sffr_gym.compile.kernels import entry, kernel
from sffr_gym.envs.batch import Batch
from sffr_gym.task.episode import Nominal, draws_of
from sffr_gym.task.episode_draws import episode_ticks, sample, sample_pcg64
from sffr_gym.task.episode_start import start_episode
from sffr_gym.task.scenario import Scenario


class BatchDraws:
    """Draws episodes of a scenario that leaves the plant as it is, for the environments of a batch.

    Args:
        scenario: of the environments.
        distribution: what is drawn from; the same, or with another length or start of episodes.
        known: what the controllers believe, and the plant.
        batch: the environments; changed in place, observations and measures excepted.

    Attributes:
        scenario: of the environments.
        draws: its :class:`sffr_gym.task.episode_draws.EpisodeDraws`.
        names: of what is drawn, in order.
        numbers: (n, k) what was drawn for the present episodes.
        ticks: (n,) their length in control periods.
    """

    def __init__(self, scenario: Scenario, distribution: Scenario, known: Nominal, batch: Batch) -> None:
        n = len(batch.tick)
        self.scenario = scenario
        self.draws, self.names = draws_of(distribution, known)
        self.numbers, self.ticks = np.zeros((n, len(self.names))), np.zeros(n, dtype=np.int64)
        self._chosen, self._batch = np.zeros(n, dtype=np.bool_), batch
        self._start = start_range.bind(known.model, self.draws, self.numbers, self._chosen, batch, self.ticks, 0, n)

    def draw(self, chosen: np.ndarray, rngs: Sequence[np.random.Generator]) -> None:
        """Put the chosen environments (n,) at the start of an episode, each drawn by its own generator."""
        for i in np.flatnonzero(chosen).tolist() if self.names else ():
            sample(self.draws, rngs[i], self.numbers[i], 0, len(self.names))
        for array in self._batch:
            array[chosen] = 0
        self._chosen[:] = chosen
        self._start()


@entry
def start_range(model, draws, numbers, chosen, batch, ticks, first, last):
    """Put the chosen environments from ``first`` up to ``last`` at the start of episodes; ticks (n,) get their lengths.

    model: of the plant; draws: an :class:`sffr_gym.task.episode_draws.EpisodeDraws`; numbers: (n, k) that were drawn,
    which become what they came to be; chosen: (n,); batch: a :class:`Batch`.
    """
    for i in range(first, last):
        if chosen[i]:
            ticks[i] = episode_ticks(draws, numbers[i])
            start_episode(model, draws, numbers[i], batch, i)


@kernel
def draw_range(model, draws, states, numbers, chosen, batch, ticks, first, last):
    """Draw episodes as :func:`start_range` starts them; states: (n, k) of a generator each, see :mod:`task.pcg64`."""
    for i in range(first, last):
        if chosen[i]:
            sample_pcg64(draws, states[i], numbers[i])
            ticks[i] = episode_ticks(draws, numbers[i])
            start_episode(model, draws, numbers[i], batch, i)
