"""``SFFRFlex-v0`` as a natively batched Gymnasium vector environment: one compiled call steps all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import DTypeLike

from sffr_gym.config.params import Params
from sffr_gym.config.ranges import MOST_ENVS
from sffr_gym.envs.arguments import (
    ParamsLike,
    ScenarioLike,
    check_options,
    check_seeds,
    is_whole,
    observation_type,
    step_limit,
)
from sffr_gym.envs.batch import Stepper, group_shapes, make_batch, step_range, visible
from sffr_gym.envs.episodes import BatchEpisodes
from sffr_gym.envs.fleet import make_fleet, plants_of
from sffr_gym.envs.infos import Drawn, Infos, Mask, batch_infos, masked, objects
from sffr_gym.envs.member import Member
from sffr_gym.envs.pictures import RENDER_EVERY, check_pictures, frame_rate, make_renderers
from sffr_gym.envs.spaces import check_action, make_spaces
from sffr_gym.envs.state import MOST_TICKS, check_batch, check_drawn, check_fleet, check_range
from sffr_gym.render.trace import Past
from sffr_gym.task.status import RUNNING
from sffr_gym.types import Array


class SFFRFlexVectorEnv(BatchEpisodes, VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Many independent ``SFFRFlex-v0`` environments; spaces, reward and episode as in :class:`SFFRFlexEnv`.

    Environment ``i`` reset with seed ``s`` (or ``seed=s - i`` for all) goes through the same states as a single
    environment reset with seed ``s``, whatever the number of environments and threads.

    Args:
        num_envs: number of environments.
        max_episode_steps: episodes are truncated after so many steps, or when the scenario's time is over; None or -1
            for no limit beside that.
        scenario, params, overrides, dtype, render_every, texts: as for the single environment.
        render_mode: None or ``rgb_array``, see :meth:`render`.
        autoreset_mode: what happens after the end of an episode, see ``gymnasium.vector.AutoresetMode``: ``NEXT_STEP``
            (the next step resets and ignores its action), ``SAME_STEP`` (the observation returned is that of the new
            episode; ``infos["final_obs"]`` and ``infos["final_info"]`` have the last ones) or ``DISABLED`` (call
            ``reset(options={"reset_mask": mask})``).

    ``infos`` has the keys of the single environment, each an array over environments with its mask ``_key``;
    ``infos["failure"]`` has the numbers of ``task.status.Failure``. The wrappers of Gymnasium for vector environments
    work, and ``get_attr`` and ``call`` read what each environment has of its own, such as ``call("state")``.
    """

    OF_ALL: ClassVar[tuple[str, ...]] = ("params", "scenario", "fields", "prior_task", "render_mode")
    OF_EACH: ClassVar[tuple[str, ...]] = ()  # attributes with a row for each environment

    def __init__(
        self,
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = None,
        scenario: ScenarioLike = "nominal",
        params: ParamsLike = None,
        overrides: Sequence[str] = (),
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        dtype: DTypeLike = "float64",
        render_every: float = RENDER_EVERY,
        texts: bool = False,
    ) -> None:
        """Build the environments.

        Raises:
            ConfigError: for parameters, a scenario or a time between pictures that are not valid, or a scenario whose
                episodes would begin outside of the observation space.
            ValueError: for a number of environments or steps below 1, an unknown autoreset or render mode or type of
                observations.
            gymnasium.error.DependencyNotInstalled: for a render mode without Pillow.
        """
        if not is_whole(num_envs) or not 1 <= num_envs <= MOST_ENVS:
            raise ValueError(f"num_envs must be at least 1 and at most {MOST_ENVS}, got {num_envs!r}")
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode must be None or 'rgb_array', got {render_mode!r}")
        self.num_envs = num_envs = int(num_envs)
        self.render_mode, self._texts = render_mode, texts
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self._settle(scenario, params, overrides)
        spaces = make_spaces(self.prior_task, observation_type(dtype))
        self.single_action_space, self.single_observation_space = spaces
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._max_steps = step_limit(max_episode_steps)
        self._fleet, self._batch = make_fleet(self._nominal_plant), make_batch(self._nominal_plant, num_envs)
        seeded = [seeding.np_random() for _ in range(num_envs)]
        self._rngs, self._seeds = [rng for rng, _ in seeded], [seed for _, seed in seeded]
        self._drawn: Drawn = {}
        self._ticks = np.zeros(num_envs, dtype=np.int64)
        self._done = np.zeros(num_envs, dtype=np.bool_)
        self._all = np.ones(num_envs, dtype=np.bool_)
        self._renderers = make_renderers(num_envs, self._nominal_plant, render_mode, render_every)
        self.metadata = {
            "render_modes": ["rgb_array"],
            "render_fps": frame_rate(self.prior_task.period),
            "autoreset_mode": self.autoreset_mode,
        }

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Array, Infos]:
        """Reset all environments, or those of ``options["reset_mask"]`` (bool array).

        An integer seed gives environment i the seed ``seed + i``. ``options["scenario"]`` changes the scenario. When it
        raises, everything stays as it was.

        Raises:
            ValueError: for a mask or list of seeds of the wrong length or type, or an unknown option.
            ConfigError: for a scenario that is not valid, or whose episodes would begin outside of the space.
            gymnasium.error.Error: for a seed that is no whole number from 0 on.
        """
        asked = check_options(options, ("scenario", "reset_mask"))
        mask, seeds = self._reset_mask(asked.get("reset_mask")), check_seeds(seed, self.num_envs)
        if "scenario" in asked:
            self._scenario = self._checked_scenario(asked["scenario"])
        for i in np.flatnonzero(mask).tolist():
            if seeds[i] is not None:
                self._rngs[i], self._seeds[i] = seeding.np_random(seeds[i])
        self._restart(mask)
        return self._observed(), self._infos(mask)

    def step(self, actions: Any) -> tuple[Array, Array, Mask, Mask, Infos]:
        """Hold one action (n, 15) for each environment for one control period.

        Raises:
            ValueError: for what is no array of real numbers, actions of the wrong shape, or with NaN.
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
            infos |= {"final_info": masked(final, last), "_final_info": last.copy()}
            infos |= {"final_obs": objects(obs, last), "_final_obs": last}
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

    @property  # type: ignore[override]  # a tuple, as SyncVectorEnv has it
    def np_random(self) -> tuple[np.random.Generator, ...]:
        """What the episodes of each environment are drawn with."""
        return tuple(self._rngs)

    @np_random.setter  # type: ignore[override]
    def np_random(self, generators: Sequence[np.random.Generator]) -> None:
        if len(generators) != self.num_envs or not all(isinstance(each, np.random.Generator) for each in generators):
            raise ValueError(f"np_random must be {self.num_envs} of numpy's generators, got {generators!r}")
        self._rngs, self._seeds = list(generators), [-1] * self.num_envs

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed of each environment's generator; -1 if that is not known."""
        return tuple(self._seeds)

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Call a method of each environment, such as ``state``, or read an attribute; see :class:`member.Member`.

        Raises:
            AttributeError: for what single environments of a batch do not have; the message says what to use instead.
        """
        found = [Member(self, i).read(name) for i in range(self.num_envs)]
        return tuple(each(*args, **kwargs) if callable(each) else each for each in found)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of each environment, such as ``time``; see :meth:`call`."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Raise AttributeError, which says what to do instead: environments of a batch have no attributes to set.

        Only ``np_random`` can be set, to a generator for each environment.
        """
        if name != "np_random":
            known = self.SETTLED.get(name, "what the environments of a batch have is settled when it is built")
            raise AttributeError(f"{name} cannot be set for the environments of a batch: {known}")
        self.np_random = values

    def _told(self) -> dict[str, object]:
        return super()._told() | {"num_envs": self.num_envs, "autoreset_mode": self.autoreset_mode.value}

    def _kept(self) -> dict[str, Any]:
        return super()._kept() | {
            "fleet": self._fleet, "batch": self._batch, "rngs": self._rngs, "seeds": self._seeds, "drawn": self._drawn,
            "ticks": self._ticks, "done": self._done, "trace": self._pasts(),
        }  # fmt: skip

    def _pasts(self) -> list[Past | None] | None:
        """What pictures show of each environment that was reset; None without pictures."""
        begun = zip(self._renderers, self._ticks, strict=False)
        return [renderer.past() if ticks else None for renderer, ticks in begun] or None

    def _form(self) -> dict[str, Any]:
        return super()._form() | {"fleet": None, "drawn": None, "trace": None}

    def _check(self, kept: dict[str, Any]) -> dict[int, Params]:
        """Return the plants to draw, by environment; see the base class."""
        check_batch(kept["batch"], self._nominal_plant)
        check_fleet(kept["fleet"], self._nominal_plant, self.num_envs)
        kept["drawn"] = check_drawn(kept["drawn"], self.num_envs)
        check_range(kept["ticks"], 0, MOST_TICKS, "state.ticks")
        return check_pictures(self._renderers, kept, self._nominal.plant)

    def _put(self, kept: dict[str, Any], checked: dict[int, Params]) -> None:
        for name in ("scenario", "fleet", "batch", "rngs", "seeds", "drawn", "ticks", "done"):
            setattr(self, f"_{name}", kept[name])
        self._forget_stepper()
        for i, plant in checked.items():
            past = kept["trace"] and kept["trace"][i]
            title = self.scenario.name if past is None else past.title
            self._renderers[i].start(plant, Member(self, i).reference, title, f"environment {i}")
            self._renderers[i].restore(past, visible(self._batch, i))
            self._record([i])  # which begins a trace where there is none

    def _advance(self, actions: Array, active: Mask) -> None:
        """Hold the actions (n, n_u) in the active environments."""
        self._stepper.actions[:], self._stepper.active[:] = actions, active
        self._stepper.step()

    def _make_stepper(self) -> Stepper:
        """Return what advances the batch."""
        plants, n_u = plants_of(self._fleet), len(self.prior_task.scale)
        return Stepper(step_range, plants, self._batch, n_u, group_shapes(self._nominal_plant))

    def _acting(self) -> Array:
        """Return the virtual damping (n, n_p) of the panels' tip displacements; empty without a law inside."""
        return np.zeros((self.num_envs, 0))

    def _record(self, rows: Sequence[int]) -> None:
        """Record what later pictures of these environments show, if there are any pictures."""
        if self._renderers:
            batch, damping = self._batch, self._acting()
            for i in rows:
                self._renderers[i].record(visible(batch, i), batch.signals[i], damping[i])

    def _observed(self) -> np.ndarray:
        """A copy of what agents see now."""
        return self._seen().astype(self.observation_space.dtype)

    def _seen(self) -> Array:
        """What agents see now."""
        return self._batch.obs

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
        return batch_infos(self._batch, self.prior_task.period, self._drawn, mask, self._texts)
