"""How episodes begin in a batch of environments: all at once where the robots are alike, else one by one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from sffr_gym.envs.base import RobotEnvironment
from sffr_gym.envs.batch import Batch, put_episode
from sffr_gym.envs.batch_draws import BatchDraws
from sffr_gym.envs.fleet import Fleet, make_fleet, plant_at, put_plant
from sffr_gym.envs.infos import Drawn, Mask
from sffr_gym.task.episode import Episode, draw
from sffr_gym.task.scenario import Scenario
from sffr_gym.task.task_model import plant_of
from sffr_gym.types import Array, IntArray

NO_LIMIT = 2**62  # control periods


class BatchEpisodes(RobotEnvironment):
    """Environments of a batch, as far as the starts of their episodes go; see :class:`vector.SFFRFlexVectorEnv`."""

    ONE_BY_ONE: ClassVar[bool] = False  # whether each start is an episode that somebody wants to have

    num_envs: int
    _max_steps: int | None
    _fleet: Fleet
    _batch: Batch
    _rngs: list[np.random.Generator]
    _drawn: Drawn
    _ticks: IntArray
    _done: Mask
    _renderers: list[Any]
    _draws: BatchDraws | None = None
    _always: tuple[Scenario, list[np.ndarray]] | None = None  # start of every episode of a scenario

    def _restart(self, mask: Mask) -> None:
        """Draw and start new episodes."""
        for _, has in self._drawn.values():
            has[mask] = False
        if self.scenario.draws_plant and len(self._fleet.numbers) < self.num_envs:
            self._fleet = make_fleet(self._nominal_plant, self.num_envs)  # until here all were alike
            self._forget_stepper()
        if self._always is not None and self._always[0] is self.scenario:
            for array, start in zip(self._arrays(), self._always[1], strict=True):
                array[mask] = start
        else:
            self._draw(mask)
        self._drawn = {name: drawn for name, drawn in self._drawn.items() if drawn[1].any()}
        self._done[mask] = False

    def _forget_stepper(self) -> None:
        super()._forget_stepper()
        self._draws = None

    def _draw(self, mask: Mask) -> None:
        """Draw and start episodes; keep the start of a scenario that draws nothing for all further ones."""
        rows = np.flatnonzero(mask).tolist()
        each = self.ONE_BY_ONE or bool(self._renderers) or len(self._fleet.numbers) == self.num_envs
        ticks = self._draw_each(rows) if each else self._draw_all(mask)
        for array, most in self._clocks():
            array[mask] = np.minimum(ticks, most)[mask]
        self._begin(mask)
        self._record(rows)
        if self._draws is not None and not (each or self._draws.names) and rows:
            self._always = self.scenario, [array[rows[0]].copy() for array in self._arrays()]

    def _draw_all(self, mask: Mask) -> IntArray:
        """Put environments whose robots are alike at the start of episodes; returns the lengths (n,) of these."""
        if self._draws is None or self._draws.scenario is not self.scenario:
            self._draws = BatchDraws(self.scenario, self._distribution(self.scenario), self._nominal, self._batch)
        self._draws.draw(mask, self._rngs)
        for name, drawn in zip(self._draws.names, self._draws.numbers.T, strict=True):
            values, has = self._drawn_of(name)
            values[mask], has[mask] = drawn[mask], True
        return self._draws.ticks

    def _draw_each(self, rows: Sequence[int]) -> IntArray:
        """Put environments at the start of episodes, one by one; returns the lengths (n,) of these."""
        ticks, scenario = np.zeros(self.num_envs, dtype=np.int64), self._distribution(self.scenario)
        for i in rows:
            episode = draw(scenario, self._nominal, self._rngs[i])
            if len(self._fleet.numbers) == self.num_envs:
                put_plant(self._fleet, i, plant_of(self._nominal_plant, self._nominal, episode))
                self._stepper.put_plant(i, plant_at(self._fleet, i))
            self._start(i, episode)
            for name, value in episode.drawn.items():
                values, has = self._drawn_of(name)
                values[i], has[i] = value, True
            ticks[i] = episode.ticks
        return ticks

    def _start(self, i: int, episode: Episode) -> None:
        """Put environment ``i`` at the start of an episode."""
        put_episode(self._batch, i, episode)
        if self._renderers:
            self._renderers[i].start(episode.plant, episode.reference, self.scenario.name, f"environment {i}")

    def _drawn_of(self, name: str) -> tuple[Array, Mask]:
        """Return what was drawn by a name (n,), and which environments have it."""
        return self._drawn.setdefault(name, (np.zeros(self.num_envs), np.zeros(self.num_envs, np.bool_)))

    def _begin(self, chosen: Mask) -> None:
        """Begin what goes with the episodes that the batch was put to, of the chosen environments."""
        self._stepper.observe(chosen)

    def _clocks(self) -> list[tuple[IntArray, int]]:
        """Arrays (n,) of the lengths of episodes in control periods, and the most of each."""
        return [(self._ticks, NO_LIMIT if self._max_steps is None else self._max_steps)]

    def _arrays(self) -> list[np.ndarray]:
        """What the start of an episode sets, with a row for each environment."""
        return [*self._batch, self._ticks]

    def _record(self, rows: Sequence[int]) -> None:
        """Record what later pictures of these environments show, if there are any pictures."""
        raise NotImplementedError
