"""``SFFRFlex-v0`` as a natively batched Gymnasium vector environment: one compiled call steps all."""

from __future__ import annotations

import copy
import os
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from sffr_gym.envs.batch import N_REFERENCE, batch_memory, make_batch, start_episode, step_batch, visible
from sffr_gym.envs.fleet import make_fleet, put_plant
from sffr_gym.envs.pictures import RENDER_EVERY, frame_rate, make_renderers
from sffr_gym.envs.single import (
    ParamsLike,
    check_action,
    make_spaces,
    resolve_params,
    scenario_option,
)
from sffr_gym.render.trace import Past
from sffr_gym.task.episode import Episode, draw, drawn_plant, nominal
from sffr_gym.task.reference import Reference
from sffr_gym.task.reward import REWARDS
from sffr_gym.task.scenario import Scenario, load_scenario
from sffr_gym.task.signals import SIGNALS
from sffr_gym.task.status import REASONS, RUNNING
from sffr_gym.task.task_model import make_task_model, plant_of
from sffr_gym.types import Array

Mask = np.ndarray
Infos = dict[str, Any]
STATE = ("scenario", "_fleet", "_batch", "_rngs", "_drawn", "_ticks", "_done", "_seeded")


class SFFRFlexVectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Many independent ``SFFRFlex-v0`` environments; spaces, reward and episode as in :class:`SFFRFlexEnv`.

    Environment ``i`` reset with seed ``s`` (or ``seed=s - i`` for all) goes through the same states as a single
    environment reset with seed ``s``, whatever the number of environments and threads.

    Args:
        num_envs: number of environments.
        max_episode_steps: episodes are truncated after so many steps, or when the scenario's time is over.
        scenario, params, overrides, render_every: as for the single environment.
        render_mode: None or ``rgb_array``, see :meth:`render`.
        autoreset_mode: what happens after the end of an episode, see ``gymnasium.vector.AutoresetMode``: ``NEXT_STEP``
            (the next step resets and ignores its action), ``SAME_STEP`` (the observation returned is that of the new
            episode; ``infos["final_obs"]`` and ``infos["final_info"]`` have the last ones) or ``DISABLED`` (call
            ``reset(options={"reset_mask": mask})``).

    ``infos`` has the keys of the single environment, each an array over environments with its mask ``_key``.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = None,
        scenario: str | os.PathLike[str] = "nominal",
        params: ParamsLike = None,
        overrides: tuple[str, ...] | list[str] = (),
        render_mode: str | None = None,
        render_every: float = RENDER_EVERY,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        """Build the environments.

        Raises:
            ConfigError: for parameters, a scenario or a time between pictures that are not valid.
            ValueError: for a number of environments below 1, an unknown autoreset or render mode.
            gymnasium.error.DependencyNotInstalled: for a render mode without Pillow.
        """
        if num_envs < 1:
            raise ValueError(f"num_envs must be at least 1, got {num_envs}")
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode must be None or 'rgb_array', got {render_mode!r}")
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.params = resolve_params(params, overrides)
        self.scenario = load_scenario(scenario)
        self.prior_task = make_task_model(self.params)
        self._nominal = nominal(self.params)
        self.fields = self._nominal.fields
        self.single_action_space, self.single_observation_space = make_spaces(self.prior_task)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._max_steps = max_episode_steps
        self._fleet, self._batch = make_fleet(self.prior_task), make_batch(self.prior_task, num_envs)
        self._memory = batch_memory(self.prior_task, num_envs)
        self._rngs: list[np.random.Generator] = [np.random.default_rng()] * num_envs
        self._drawn: dict[str, tuple[Array, Mask]] = {}  # values, and which environments drew one
        self._ticks = np.zeros(num_envs, dtype=np.int64)
        self._done = np.zeros(num_envs, dtype=np.bool_)
        self._seeded = False
        self._all = np.ones(num_envs, dtype=np.bool_)
        self._renderers = make_renderers(num_envs, self.prior_task, render_mode, render_every)
        self.metadata = {
            "render_modes": ["rgb_array"],
            "render_fps": frame_rate(self.prior_task.period),
            "autoreset_mode": self.autoreset_mode,
        }

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Array, Infos]:
        """Reset all environments, or those of ``options["reset_mask"]`` (bool array).

        An integer seed gives environment i the seed ``seed + i``. ``options["scenario"]`` changes the scenario.

        Raises:
            ValueError: for a mask or list of seeds of the wrong length or type, or an unknown option.
        """
        options = dict(options or {})
        mask = self._reset_mask(options.pop("reset_mask", None))
        self.scenario = scenario_option(self.scenario, options)
        self._seed(seed, mask)
        self._restart(mask)
        return self._observed(), self._infos(mask)

    def step(self, actions: Any) -> tuple[Array, Array, Mask, Mask, Infos]:
        """Hold one action (n, 15) for each environment for one control period.

        Raises:
            ValueError: for actions of the wrong shape or with NaN.
            gymnasium.error.ResetNeeded: before the first reset, or with DISABLED autoreset for a finished environment.
        """
        if not self._ticks.all():
            raise gym.error.ResetNeeded("call reset for every environment before step")
        actions = check_action(actions, self.action_space.shape)
        again = self._done & (self.autoreset_mode == AutoresetMode.NEXT_STEP)
        if (self._done & ~again).any():
            finished = np.flatnonzero(self._done).tolist()
            raise gym.error.ResetNeeded(f"environments {finished} are done: reset them with options['reset_mask']")
        self._advance(actions, ~again)
        self._record(range(self.num_envs))
        if again.any():
            self._restart(again)
        terminated = self._batch.status != RUNNING
        truncated = self._batch.tick >= self._ticks
        infos = self._infos(self._all)
        obs, reward = self._observed(), self._batch.reward.copy()
        self._done = terminated | truncated
        if self.autoreset_mode == AutoresetMode.SAME_STEP and self._done.any():
            last, final = self._done.copy(), infos
            self._restart(last)
            infos = self._infos(self._all)
            infos |= {
                "final_obs": obs,
                "_final_obs": last,
                "final_info": _masked(final, last),
                "_final_info": last.copy(),
            }
            obs = self._observed()
        return obs, reward, terminated, truncated, infos

    def render(self) -> tuple[np.ndarray, ...] | None:
        """The picture (600, 600, 3) of each environment, uint8, read-only, as :meth:`SFFRFlexEnv.render` draws it.

        Gymnasium's ``RecordVideo`` for vector environments joins them anew at every step, 1.08 MB for each environment
        and step: bound it with its ``video_length``.

        Raises:
            gymnasium.error.ResetNeeded: before the first reset.
        """
        if not self._renderers:
            gym.logger.warn("render() shows nothing without render_mode='rgb_array'")
            return None
        if not self._ticks.all():
            raise gym.error.ResetNeeded("call reset for every environment before render")
        return tuple(picture for renderer in self._renderers if (picture := renderer.render()) is not None)

    def get_state(self) -> dict[str, Any]:
        """Everything that the future depends on; a copy that :meth:`set_state` restores bit for bit."""
        begun = zip(self._renderers, self._ticks, strict=False)
        pasts = [renderer.past() if ticks else None for renderer, ticks in begun] or None
        return copy.deepcopy({name: getattr(self, name) for name in STATE} | {"trace": pasts})

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore what :meth:`get_state` returned."""
        for name in STATE:
            setattr(self, name, copy.deepcopy(state[name]))
        for i in np.flatnonzero(self._ticks[: len(self._renderers)]).tolist():
            self._restore_picture(i, state["trace"] and state["trace"][i])

    def _distribution(self) -> Scenario:
        """What episodes are drawn from."""
        return self.scenario

    def _start(self, i: int, episode: Episode) -> None:
        """Put environment ``i`` at the start of an episode."""
        start_episode(self._fleet, self._batch, self._memory, i, episode)

    def _advance(self, actions: Array, active: Mask) -> None:
        """Hold the actions (n, n_u) in the active environments."""
        step_batch(self._fleet, self._batch, self._memory, actions, active)

    def _acting(self) -> Array:
        """Return the virtual damping (n, n_p) of the panels' tip displacements; empty without a law inside."""
        return np.zeros((self.num_envs, 0))

    def _record(self, rows: Sequence[int]) -> None:
        """Record what later pictures of these environments show, if there are any pictures."""
        if self._renderers:
            batch, damping = self._batch, self._acting()
            for i in rows:
                self._renderers[i].record(visible(batch, i), batch.signals[i], damping[i])

    def _restore_picture(self, i: int, past: Past | None) -> None:
        """Let environment ``i`` be drawn as it was; without a past, its trace begins at the present state."""
        renderer, numbers = self._renderers[i], self._batch.reference[i]
        reference = Reference._make([*numbers[:N_REFERENCE].tolist(), numbers[N_REFERENCE:].copy()])
        drawn = {name: float(values[i]) for name, (values, has) in self._drawn.items() if has[i]}
        title = self.scenario.name if past is None else past.title
        renderer.start(drawn_plant(self.params, drawn), reference, title, f"environment {i}")
        if past is None:
            self._record([i])
        else:
            renderer.restore(past, visible(self._batch, i))

    def _observed(self) -> Array:
        """A copy of what agents see now."""
        return self._batch.obs.copy()

    def _restart(self, mask: Mask) -> None:
        """Draw and start new episodes."""
        for _, has in self._drawn.values():
            has[mask] = False
        scenario = self._distribution()
        if scenario.changes_plant and len(self._fleet.numbers) < self.num_envs:
            self._fleet = make_fleet(self.prior_task, self.num_envs)  # until here all were alike
        for i in np.flatnonzero(mask):
            episode = draw(scenario, self._nominal, self._rngs[i])
            if len(self._fleet.numbers) == self.num_envs:
                put_plant(self._fleet, int(i), plant_of(self.prior_task, episode))
            self._start(int(i), episode)
            if self._renderers:
                self._renderers[i].start(episode.plant, episode.reference, self.scenario.name, f"environment {i}")
                self._record([int(i)])
            for name, value in episode.drawn.items():
                values, has = self._drawn.setdefault(name, (np.zeros(self.num_envs), np.zeros(self.num_envs, np.bool_)))
                values[i], has[i] = value, True
            self._ticks[i] = episode.ticks if self._max_steps is None else min(episode.ticks, self._max_steps)
        self._drawn = {name: drawn for name, drawn in self._drawn.items() if drawn[1].any()}
        self._done[mask] = False

    def _seed(self, seed: int | Sequence[int | None] | None, mask: Mask) -> None:
        """Give the masked environments new generators where seeds say so, all of them at the first reset."""
        seeds = [seed] * self.num_envs if seed is None else seed
        if isinstance(seeds, int | np.integer):
            seeds = [int(seeds) + i for i in range(self.num_envs)]
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed must be an integer or {self.num_envs} of them, got {len(seeds)}")
        for i in np.flatnonzero(mask).tolist():
            if seeds[i] is not None or not self._seeded:
                self._rngs[i], _ = seeding.np_random(seeds[i])
        self._seeded = True

    def _reset_mask(self, mask: Any) -> Mask:
        """The environments to reset."""
        if mask is None:
            return np.ones(self.num_envs, dtype=np.bool_)
        if not isinstance(mask, np.ndarray) or mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            raise ValueError(f"options['reset_mask'] must be a bool array of shape ({self.num_envs},), got {mask!r}")
        if not mask.any():
            raise ValueError("options['reset_mask'] must ask for at least one environment")
        return mask

    def _infos(self, mask: Mask) -> Infos:
        """The single environment's info, an array and a mask for each key."""
        batch = self._batch
        infos: Infos = dict(zip(SIGNALS, batch.signals.T.copy(), strict=True))
        infos |= {f"reward_{name}": column for name, column in zip(REWARDS, batch.terms.T.copy(), strict=True)}
        infos |= {
            "time": batch.tick * self.prior_task.period,
            "clipped": batch.clipped.copy(),
            "failure": _TEXTS[batch.status],
        }
        infos |= {"cost": batch.cost.copy(), "applied": batch.applied.copy()}
        infos = _masked(infos, mask)
        drawn: Infos = {}
        for name, (values, has) in self._drawn.items():
            if (has & mask).any():
                drawn |= {name: values.copy(), f"_{name}": has & mask}
        return infos | {"drawn": drawn, "_drawn": mask.copy()}


_TEXTS = np.array([REASONS[code] for code in sorted(REASONS)], dtype=object)


def _masked(infos: Infos, mask: Mask) -> Infos:
    """The infos with a mask beside each key, which leaves no more than it did."""
    masked: Infos = {}
    for key, value in infos.items():
        if key.startswith("_"):
            continue
        masked[key] = _masked(value, mask) if isinstance(value, dict) else value
        masked[f"_{key}"] = infos.get(f"_{key}", mask) & mask
    return masked
