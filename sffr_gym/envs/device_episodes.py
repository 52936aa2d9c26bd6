"""How episodes begin on a GPU: drawn there where the robots are alike, else by the batch on the processor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.utils import seeding

from sffr_gym.compile.arguments import Structures
from sffr_gym.compile.cuda.described import FIRST, LAST, Rows, Thread, numbers_of, rows
from sffr_gym.compile.cuda.program import Device, Launch
from sffr_gym.compile.kernels import kernel
from sffr_gym.envs.batch_draws import BatchDraws, draw_range
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.task.pcg64 import state_of

ONE = np.ones(1, dtype=np.bool_)


@kernel
def restart_range(start, whole_start, again, numbers, wholes, first, last):
    """Put the environments from ``first`` up to ``last`` that begin ``again`` to the start of an episode.

    start, whole_start: (k,) floats and whole numbers of it; numbers, wholes: (n, k) of the environments.
    """
    for i in range(first, last):
        if again[i]:
            for k in range(len(start)):
                numbers[i, k] = start[k]
            for k in range(len(whole_start)):
                wholes[i, k] = whole_start[k]


class DeviceEpisodes:
    """Environments on a GPU, as far as the starts of their episodes go; see :class:`device.DeviceVectorEnv`."""

    num_envs: int
    host: SFFRFlexVectorEnv
    device: Device
    views: dict[int, Any]
    _parts: dict[str, list[np.ndarray]]  # the host's arrays, by kind of number
    _columns: dict[str, Any]  # those of the device, (k, n)
    _starts: dict[str, Any]  # (k,) the start of an episode before anything is drawn
    _launch: dict[str, Launch]
    _own_plants: bool
    _fits: tuple[int, list[int]]  # integration steps and stiff modes that the program was compiled for
    _plants: Any  # (n, k) numbers of the plants
    _seeds: list[int | None]
    _rngs: dict[int, np.random.Generator]  # on the processor
    _stated: np.ndarray  # (n,) which generators are on the device
    _states: Any  # (n, STATE) of these
    _again: Any  # (n,) which environments begin an episode
    _lengths: Any  # (n,) of the episodes that were drawn, in control periods
    _numbers: Any  # (n, k) what was drawn
    _done: Any
    _draws: BatchDraws | None = None  # of the scenario whose start the device has
    _drawn: dict[int, dict[str, float]]  # of plants

    def drawn(self, i: int) -> dict[str, float]:
        """Return what the scenario drew for the episode of environment ``i``."""
        if self._own_plants or self._draws is None:
            return self._drawn.get(i, {})
        return dict(zip(self._draws.names, to_host(self._numbers[i]).tolist(), strict=True))

    def _restart(self, mask: Any) -> None:
        """Start new episodes in the environments of a mask, on the device."""
        if self._own_plants:
            self._draw_plants(np.flatnonzero(to_host(mask)).tolist())
        else:
            if self._draws is None or self._draws.scenario is not self.host.scenario:
                self._draws = self._prepare_draws()
            self._again[...] = mask
            self._launch["restart"]()
            if self._draws.names:
                self._draw()
        self._done &= ~mask

    def _prepare_draws(self) -> BatchDraws:
        """Bring to the device what the start of any episode is, and compile what draws the rest."""
        xp, n, host = self.device.xp, self.num_envs, self.host
        host._rngs[0] = np.random.default_rng(0)
        host._restart(ONE)
        for kind, start in self._row().items():
            self._starts[kind][...] = xp.asarray(start)
        draws = BatchDraws(host.scenario, host._distribution(host.scenario), host._nominal, host._batch)
        self._numbers = rows(xp, n, (len(draws.names),), "f")
        if draws.names:
            thread = Thread("draw", draw_range, (
                host._nominal.model, draws.draws, Rows(self._states), Rows(self._numbers), Rows(self._again),
                self._described(host._batch), Rows(self._lengths), FIRST, LAST,
            ))  # fmt: skip
            self._launch |= self.device.launches(n, [thread])
        return draws

    def _draw(self) -> None:
        """Draw an episode for each environment that begins one, and observe its start."""
        xp, new = self.device.xp, np.flatnonzero(~self._stated).tolist()
        if new:
            states = [state_of(seeding.np_random(self._seeds[i])[0]) for i in new]
            self._states[new] = xp.asarray(np.array(states))
            self._stated[:] = True
        self._launch["draw"]()
        for array, most in self.host._clocks():
            xp.copyto(self.views[id(array)], xp.minimum(self._lengths, most), where=self._again)
        for name in ("observe", "see"):
            if name in self._launch:
                self._launch[name]()

    def _draw_plants(self, chosen: Sequence[int]) -> None:
        """Draw an episode with its plant for each of some environments on the processor, and start it on the device."""
        if not chosen:
            return
        xp, drawn, plants = self.device.xp, [], []
        for i in chosen:
            self.host._rngs[0] = self._rng(i)
            self.host._restart(ONE)
            drawn.append(self._row())
            self._drawn[i] = {name: float(values[0]) for name, (values, _) in self.host._drawn.items()}
            plants.append(numbers_of(self._checked_plant()))
        for kind, columns in self._columns.items():
            columns[:, chosen] = xp.asarray(np.array([row[kind] for row in drawn]).T)
        self._plants[chosen] = xp.asarray(np.array(plants))

    def _checked_plant(self) -> Any:
        """Return the plant that was drawn; raises ValueError for one that the compiled code does not fit."""
        plant = self._plant
        size, stiff = self._plants.shape[1], plant.model.stiff.at.tolist()
        if len(numbers_of(plant)) != size or (plant.steps, stiff) != self._fits:
            raise ValueError(
                "the robots of a batch on a GPU must have the same stiff modes and integration steps; draw parameters "
                "that change none of them, or simulate these on the processor"
            )
        return plant

    def _rng(self, i: int) -> np.random.Generator:
        """The generator of an environment, made when it is first needed."""
        if i not in self._rngs:
            self._rngs[i], _ = seeding.np_random(self._seeds[i])
        return self._rngs[i]

    def _row(self) -> dict[str, np.ndarray]:
        """The start that the host has, as numbers of each kind."""
        return {kind: np.concatenate([array[0].ravel() for array in own]) for kind, own in self._parts.items()}

    @property
    def _plant(self) -> Any:
        """The plant of the episode that was drawn last."""
        return self.host._stepper.setup.plants[0]

    def _described(self, value: Any) -> Any:
        """Describe an argument of the step: what each environment has, and constants."""
        if isinstance(value, tuple) and not isinstance(value, Structures):
            return type(value)(*map(self._described, value))
        return Rows(self.views[id(value)]) if id(value) in self.views else value


def to_host(array: Any) -> np.ndarray:
    """Return an array of the device on the processor."""
    return array if isinstance(array, np.ndarray) else np.asarray(array.get())
