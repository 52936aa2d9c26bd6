"""The vector environments on a GPU: one thread for each environment, and no array that leaves the device.

The kernels, the episodes and the random numbers are those of the vector environments on the processor. A batch of one
there says what they are. Where a scenario draws plants, it draws every episode, whose start is copied to the device.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import prod
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from sffr_gym.compile.arguments import KINDS
from sffr_gym.compile.cuda.described import (
    FIRST,
    LAST,
    Fixed,
    Memory,
    Own,
    Rows,
    Thread,
    across,
    numbers_of,
    rows,
)
from sffr_gym.compile.cuda.program import Device
from sffr_gym.envs.arguments import check_options, check_seeds, is_whole
from sffr_gym.envs.batch import observe_range
from sffr_gym.envs.device_episodes import DeviceEpisodes, restart_range, to_host
from sffr_gym.envs.infos import Infos
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.task.pcg64 import STATE
from sffr_gym.task.reward import REWARDS
from sffr_gym.task.signals import SIGNALS
from sffr_gym.task.status import RUNNING

MOST_ENVS = 2**24  # of a batch: some 40 GB
CUDA = 2  # DLPack's number of the kind of device


class DeviceVectorEnv(DeviceEpisodes, VectorEnv[Any, Any, Any]):
    """Many environments on a GPU, as ``gym.make_vec(..., backend="cuda")`` makes them.

    Environment ``i`` reset with seed ``s`` goes through the same episodes as on the processor, to rounding. What
    :meth:`reset` and :meth:`step` return are CuPy's arrays on the device, which other libraries take without a copy
    (``torch.from_dlpack(obs)``, ``jax.dlpack.from_dlpack(obs)``); ``dtype`` is theirs. They are the environments' own,
    written anew by the next step: copy what must last. Actions may be any array with ``__dlpack__`` or
    ``__cuda_array_interface__``, or NumPy's; they are taken in stream order, and not searched for NaN.

    Episodes are drawn on the device, where the robots are alike. Plants and faults are drawn on the processor when
    episodes end, for which each step waits; a plant that is drawn must have the stiff modes of the others.

    Args:
        host: a batch of one environment, on the processor.
        num_envs: number of environments.
        autoreset_mode: as on the processor. With ``SAME_STEP`` ``infos["final_obs"]`` has the last observations of the
            environments of the mask ``infos["_final_obs"]``, and those before the step of all others.
        device: where threads run.

    Attributes:
        host: the batch that draws episodes.
        device: where threads run.
        batch: the environments' :class:`sffr_gym.envs.batch.Batch`, on the device.
        views: its arrays on the device: of each a view with ``num_envs`` rows, by the array's ``id``.
    """

    def __init__(
        self, host: SFFRFlexVectorEnv, num_envs: int, autoreset_mode: AutoresetMode | str, device: Device
    ) -> None:
        if not is_whole(num_envs) or not 1 <= num_envs <= MOST_ENVS:
            raise ValueError(f"num_envs must be at least 1 and at most {MOST_ENVS}, got {num_envs!r}")
        self.host, self.num_envs, self.device = host, int(num_envs), device
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = host.metadata | {"render_modes": [], "autoreset_mode": self.autoreset_mode}
        self.single_action_space = host.single_action_space
        self.single_observation_space = host.single_observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._seeds: list[int | None] = [None] * num_envs
        self._rngs: dict[int, np.random.Generator] = {}
        self._drawn: dict[int, dict[str, float]] = {}
        self._stated = np.zeros(num_envs, dtype=np.bool_)
        self._ready = False
        host.reset()
        self._own_plants = host.scenario.draws_plant
        self._fits = self._plant.steps, self._plant.model.stiff.at.tolist()
        self._allocate()
        self._prepare()

    def _allocate(self) -> None:
        """Make the arrays of all environments, views of one matrix for each kind of number."""
        xp, n, host = self.device.xp, self.num_envs, self.host
        arrays = host._arrays()
        self._parts = {kind: [each for each in arrays if KINDS[each.dtype] == kind] for kind in "fi"}
        self._columns, self.views = {}, {}
        for kind, own in self._parts.items():
            sizes = [prod(array.shape[1:]) for array in own]
            self._columns[kind] = columns = rows(xp, n, (sum(sizes),), kind).T
            for array, size, end in zip(own, sizes, np.cumsum(sizes).tolist(), strict=True):
                self.views[id(array)] = across(columns[end - size : end], array.shape[1:])
        self._starts = {kind: xp.zeros(len(columns), dtype=columns.dtype) for kind, columns in self._columns.items()}
        self._active, self._done, self._again = (xp.zeros(n, dtype=np.bool_) for _ in range(3))
        self._states, self._lengths = rows(xp, n, (STATE,), "i"), xp.zeros(n, dtype=np.int64)
        self._all = xp.ones(n, dtype=np.bool_)
        self._actions = rows(xp, n, host._stepper.actions.shape[1:], "f")
        self._obs = xp.zeros(self.observation_space.shape, dtype=self.observation_space.dtype)
        self._plants = rows(xp, n if self._own_plants else 1, (len(numbers_of(self._plant)),), "f")

    def _prepare(self) -> None:
        """Compile what runs on the device, and prepare its calls."""
        kernel, plants, _, more, shapes, seeing = self.host._stepper.setup
        seen: Any = Own(self._plant, self._plants) if self._own_plants else plants
        self.batch = self._on_device(self.host._batch)
        step = Thread("step", kernel, (
            seen, seen, self._described(self.host._batch), *map(self._described, more), Rows(self._actions),
            Rows(self._active), Memory(shapes), Memory(shapes.period), FIRST, LAST,
        ))  # fmt: skip
        restart = Thread("restart", restart_range, (
            *map(Fixed, self._starts.values()), Rows(self._again),
            *(Rows(columns.T) for columns in self._columns.values()), FIRST, LAST,
        ))  # fmt: skip
        observe = Thread("observe", observe_range, (
            seen, self._described(self.host._batch), Rows(self._again), Memory(shapes.period), FIRST, LAST,
        ))  # fmt: skip
        threads = [step, restart, observe]
        if seeing is not None:
            obs = Rows(self.batch.obs)
            threads.append(Thread("see", seeing, (*map(self._described, more), obs, Rows(self._again), FIRST, LAST)))
        self._launch = self.device.launches(self.num_envs, threads)

    def _on_device(self, value: Any) -> Any:
        """Return a structure of the host's arrays with those of the device in their place."""
        if isinstance(value, tuple):
            return type(value)(*map(self._on_device, value))
        return self.views.get(id(value), value)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, Infos]:
        """Reset all environments, or those of ``options["reset_mask"]``; see :class:`SFFRFlexVectorEnv`.

        The mask may be an array on the device. Arguments and errors as there.
        """
        asked = check_options(options, ("scenario", "reset_mask"))
        xp, mask = self.device.xp, asked.get("reset_mask")
        mask = self._all if mask is None else xp.asarray(mask)
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            raise ValueError(f"options['reset_mask'] must be a bool array of shape ({self.num_envs},), got {mask!r}")
        seeds = check_seeds(seed, self.num_envs)
        if "scenario" in asked:
            changed = self.host._checked_scenario(asked["scenario"])
            if changed.draws_plant and not self._own_plants:
                raise ValueError(
                    f"scenario {changed.name}: draws plants; make another environment for it, in which each has its own"
                )
            self.host._scenario = changed
        if seed is not None:
            chosen = np.flatnonzero(to_host(mask)).tolist()
            for i in chosen:
                if seeds[i] is not None:
                    self._seeds[i], self._stated[i] = seeds[i], False
                    self._rngs.pop(i, None)
        self._restart(mask)
        self._ready = self._ready or bool(mask.all())
        return self._observed(), self._infos(mask)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, Infos]:
        """Hold one action for each environment for one control period, or one decision.

        Raises:
            ValueError: for actions of the wrong shape.
            gymnasium.error.ResetNeeded: before the first reset, or with DISABLED autoreset for a finished environment.
        """
        if not self._ready:
            raise gym.error.ResetNeeded("call reset for every environment before step")
        self._take(actions)
        next_step = self.autoreset_mode == AutoresetMode.NEXT_STEP
        if self.autoreset_mode == AutoresetMode.DISABLED and bool(self._done.any()):
            raise gym.error.ResetNeeded("environments are done: reset them with options['reset_mask']")
        self._advance()
        if next_step:
            self._restart(self._done)
        terminated, truncated = self._ends()
        reward = self.batch.reward
        if self.autoreset_mode != AutoresetMode.SAME_STEP:
            return self._observed(), reward, terminated, truncated, self._infos(self._all)
        last, obs, reward = self._done.copy(), self._observed().copy(), reward.copy()
        self._restart(last)
        infos = self._infos(self._all) | {"final_obs": obs, "_final_obs": last}
        return self._observed(), reward, terminated, truncated, infos

    def go_on(self, actions: Any) -> None:
        """Hold one action for each environment whose episode is not over; the others stay as they are.

        Ends that come of it are in :attr:`done`. For whoever measures whole episodes; arguments as for :meth:`step`.
        """
        self._take(actions)
        self._advance()
        self._ends()

    @property
    def done(self) -> Any:
        """Return (n,) which episodes are over; the environments' own."""
        return self._done

    @property
    def ticks(self) -> Any:
        """Return (n,) the lengths of the episodes in control periods; the environments' own."""
        return self.views[id(self.host._ticks)]

    def _advance(self) -> None:
        self.device.xp.logical_not(self._done, out=self._active)
        self._launch["step"]()

    def _ends(self) -> tuple[Any, Any]:
        """Return which episodes have failed, and which are at their end."""
        terminated, truncated = self.batch.status != RUNNING, self.batch.tick >= self.ticks
        self.device.xp.logical_or(terminated, truncated, out=self._done)
        return terminated, truncated

    def _take(self, actions: Any) -> None:
        """Bring actions where the kernel reads them."""
        xp, place = self.device.xp, getattr(actions, "__dlpack_device__", lambda: (None,))()[0]
        given = xp.from_dlpack(actions) if place == CUDA else xp.asarray(np.asarray(actions))
        if given.shape != self.action_space.shape or given.dtype.kind not in "fiu":
            raise ValueError(
                f"actions must be real numbers of the shape {self.action_space.shape}, got {given.dtype} {given.shape}"
            )
        self._actions[...] = given

    def _observed(self) -> Any:
        """What agents see now."""
        seen = self.views[id(self.host._seen())]
        if seen.dtype == self._obs.dtype:
            return seen
        self._obs[...] = seen
        return self._obs

    def _infos(self, mask: Any) -> Infos:
        """What the processor's environments tell, as views; one mask for all."""
        batch = self.batch
        found = {name: batch.signals[:, k] for k, name in enumerate(SIGNALS)}
        found |= {f"reward_{name}": batch.terms[:, k] for k, name in enumerate(REWARDS)}
        found |= {"failure": batch.status, "cost": batch.cost, "applied": batch.applied, "clipped": batch.clipped}
        return found | {f"_{name}": mask for name in found}
