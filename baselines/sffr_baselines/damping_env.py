"""``SFFRFlexDamping-v0``: an agent schedules the virtual damping of a law that runs inside, single and batched."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import DTypeLike

from sffr_baselines.control_law import Law
from sffr_baselines.damping_loop import Damping, DampingStepper, make_damping, start_damping
from sffr_baselines.schedule import BOUNDS, decisions_of_panel
from sffr_baselines.scheduled import AGENT_PERIOD, RHO, action_names, observation_names, scheduled_law
from sffr_baselines.suppression import TRANSVERSE
from sffr_gym.envs.arguments import ParamsLike, ScenarioLike, observation_type, step_limit
from sffr_gym.envs.backends import make_on
from sffr_gym.envs.base import RobotEnvironment
from sffr_gym.envs.episodes import NO_LIMIT
from sffr_gym.envs.fleet import plants_of
from sffr_gym.envs.infos import Infos, Mask
from sffr_gym.envs.pictures import RENDER_EVERY, frame_rate, make_renderer, make_renderers
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.state import FAR, MOST_TICKS, check_finite, check_range
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.task.episode import Episode
from sffr_gym.task.scenario import Scenario
from sffr_gym.types import Array, IntArray

DURATION = 30.0  # of an episode [s]
_LAW = dict.fromkeys(
    ("law", "law_name", "obs_names", "action_names"), "make another environment with `law`, `rho` or `agent_period`"
)


class DampingEnvironment(RobotEnvironment):
    """What the single and the vector environment with a law inside have in common: the law, and its part of a state."""

    SETTLED = {**RobotEnvironment.SETTLED, **_LAW, "damping": "an action changes it"}
    _SAME = ("params", "law")

    _stepper: DampingStepper
    law: Law  #: the law inside
    law_name: str  #: one of :data:`scheduled.SCHEDULED`
    _damping: Damping
    _duration: float | None
    _random_phase: bool

    def _told(self) -> dict[str, object]:
        return super()._told() | {"law": self.law_name, "rho": self.law.schedule.rho}

    def _distribution(self, scenario: Scenario) -> Scenario:
        return training_scenario(scenario, self._duration, self._random_phase)

    def _kept(self) -> dict[str, Any]:
        schedule = self.law.schedule
        held = f"hold {schedule.hold}, tolerance {schedule.tolerance!r}, stack {schedule.stack}"
        law = f"{self.law_name}, rho {schedule.rho!r}, {held}"
        return super()._kept() | {"law": law, "damping": self._damping}

    def _check(self, kept: dict[str, Any]) -> Any:
        damping, bound = kept["damping"], np.tile(BOUNDS, len(self.law.allocation) * self.law.schedule.stack)
        check_finite(damping, "state.damping")
        for values, low, high, name in (
            (damping.law.B_hat, 0.0, np.inf, "law.B_hat"), (damping.law.factor, 0.0, np.inf, "law.factor"),
            (damping.law.share, 0.0, 1.0, "law.share"), (damping.law.demand, 0.0, np.inf, "law.demand"),
            (damping.law.late, 0.0, 1.0, "law.late"), (damping.law.age, 0, MOST_TICKS, "law.age"),
            (damping.law.integral, -FAR, FAR, "law.integral"), (damping.law.errors, -FAR, FAR, "law.errors"),
            (damping.law.filters, -FAR, FAR, "law.filters"), (damping.law.plan, -FAR, FAR, "law.plan"),
            (damping.law.wait, -1.0, MOST_TICKS, "law.wait"),
            (damping.law.seen, -bound, bound, "law.seen"), (damping.end, 0, MOST_TICKS, "end"),
        ):  # fmt: skip
            check_range(values, low, high, f"state.damping.{name}")
        return super()._check(kept)

    def _put(self, kept: dict[str, Any], checked: Any) -> None:
        self._damping = kept["damping"]  # first, since pictures show it
        super()._put(kept, checked)


class SFFRFlexDampingEnv(DampingEnvironment, SFFRFlexEnv, gym.Env[np.ndarray, np.ndarray]):  # skrl reads the bases
    """The task of ``SFFRFlex-v0`` with a controller inside: an agent chooses how strongly it damps the panels.

    ## Description
    A law of the benchmark, AHSC if not said otherwise, runs at the control period of 2 ms. Every 0.1 s the agent
    multiplies the virtual damping of each elastic coordinate that the law damps by a factor between 1/10 and 10. The
    damping stays positive whatever the agent does, so it can only take energy out of a panel, and action 0 is the law
    itself, bitwise identical.

    ## Action space
    ``Box(-1, 1, (4,), float32)``: ``B = B_hat rho**action``. At the default period the law damps q5 and q6:

    | index | damping of |
    |---|---|
    | 0, 1 | left panel: transverse displacement (q5) and slope (q6) of the tip |
    | 2, 3 | right panel, the same |

    Over a law that feeds the panels' state back (``lqr``, ``mpc`` and their kin) a panel has one number for the whole
    of its feedback, ``rho**action`` times as strong. Over one that feeds the panels' reaction forward (``-ff``,
    ``-kf``, ``mpc``) another one follows, for the share of the panel's reaction: ``rho**min(action, 0)``, at most all
    of it (``env.unwrapped.action_names``).

    ## Observation space
    ``Box(float32)`` (or float64, see ``dtype``), panel by panel in its own axes, scaled by constants
    (``env.unwrapped.obs_names``). The two bending modes of the law's panel are taken about the quasi-static shape, as
    coordinates whose squares are energies; ``E`` is their sum, a panel's vibration energy as the controller sees it.
    The positive side of a panel is the one to which the path's acceleration points: mirror images are the same.

    | index | of the left panel (the right one's follow) | range |
    |---|---|---|
    | 0-3 | displacement and rate of mode 1, of mode 2, divided by the root of 2 E | [-1, 1] |
    | 4 | log10 of the root of E over the reward's energy scale | [-3, 3] |
    | 5 | path acceleration across the panel, over v^2 / r | [0, 5] |
    | 6 | its rate, over v^3 / r^2 | [-5, 5] |
    | 7-10 | square of displacement less that of rate, and twice their product, of mode 1, of mode 2 | [-1, 1] |
    | 11-14 | twice the products of mode 1's displacement and rate with those of mode 2 | [-1, 1] |
    | 15 | log10 of the piezos' largest command over its limit in the last period, plus 0.01 | [-2, 2] |
    | 16 | the same of thrusters and joints, for both panels alike | [-2, 2] |
    | 17 | log10 of the base's error over 3 mm, plus 0.001; likewise | [-3, 3] |

    Above 0 an actuator was asked for more than it has. A turn of the base counts as the shift of a panel's middle that
    it makes, a rate as the error that it makes in half a second.

    ## Reward
    The reward of ``SFFRFlex-v0`` summed over the control periods of the step, term by term (``info["reward_<name>"]``):
    at most 50 in 0.1 s, never negative, so that no episode gains by its end. ``sffr train`` learns from the score's own
    terms instead, which have no bounds, in a loop that its agent cannot make fail.

    ## Info
    As in ``SFFRFlex-v0``: reward terms and ``cost`` are sums over the step, the measures those of its last control
    period. ``damping`` is the damping that acts now, (panels, 3).

    ## Starting state
    Drawn from the scenario, anywhere on a closed path with ``random_phase``.

    ## Episode end
    As in ``SFFRFlex-v0``; truncates after ``duration``. After that nothing moves, and the reward is 0.

    ## Arguments
    - ``scenario``, ``params``, ``overrides``, ``render_mode``, ``dtype``, ``render_every``, ``texts``: as in
      ``SFFRFlex-v0``.
    - ``law``: what runs inside: ``hsc``, ``ahsc``, ``ahsc-filtered``, ``hsc-tuned``, ``ahsc-ff``, ``lqr``, ``lqr-ff``,
      ``lqr-kf``, ``mpc``.
    - ``rho``: largest factor; 1/rho is the smallest. One with which the sampled loop of a panel would be unstable is
      rejected.
    - ``agent_period``: time between two actions [s], a multiple of the control period.
    - ``duration``: length of an episode [s]; None for the scenario's.
    - ``random_phase``: start anywhere on a closed path.
    - ``base_tolerance``: error of the base [m] at which an action counts half, further off less: the law by itself
      brings the base back. None: actions always count in full.
    - ``stack_size``: a memory: so many observations of each panel are seen at once, the newest first, then the one of
      an action before and so on; zeros stand for those before the start.

    ## Version history
    - v0: first version. Before its release the reward was the unbounded negative cost, as that of ``SFFRFlex-v0``, the
      law was ``hsc`` or ``ahsc``, and an observation had the first seven numbers of each panel.
    """

    def __init__(
        self,
        scenario: ScenarioLike = "excited",
        params: ParamsLike = None,
        overrides: Sequence[str] = (),
        render_mode: str | None = None,
        law: str = "ahsc",
        rho: float = RHO,
        agent_period: float = AGENT_PERIOD,
        duration: float | None = DURATION,
        random_phase: bool = True,
        base_tolerance: float | None = None,
        stack_size: int = 1,
        dtype: DTypeLike = "float32",
        render_every: float = RENDER_EVERY,
        texts: bool = False,
    ) -> None:
        """Build the environment; see the class for the arguments.

        Raises:
            ConfigError: for parameters, a scenario or an argument that are not valid, or a damping that the sampled
                loop cannot run.
        """
        self._duration, self._random_phase = duration, random_phase  # of the episodes that the next line looks at
        super().__init__(scenario, params, overrides, render_mode, render_every=render_every, texts=texts)
        self._renderer = make_renderer(self._nominal_plant, render_mode, render_every, damped=True)
        self.law = scheduled_law(self.params, law, rho, agent_period, base_tolerance, stack_size)
        self.metadata = self.metadata | {"render_fps": frame_rate(agent_period)}
        self.law_name, self.obs_names = law, observation_names(self.params, stack_size)
        self.action_names = action_names(self.params, self.law)
        self.action_space, self.observation_space = damping_spaces(self.law, dtype=dtype)
        self._damping = make_damping(self.law, 1)

    @property
    def damping(self) -> Array:
        """Return the virtual damping that acts now (panels, 3) [N s/m, N s/m, N m s/rad]."""
        return self._damping.law.factor[0] * self._damping.law.B_hat[0]

    def _start(self, episode: Episode) -> None:
        start_damping(self.law, self._damping, 0)
        self._damping.end[0] = episode.ticks
        super()._start(episode)

    def _make_stepper(self) -> DampingStepper:
        return DampingStepper([self._plant_task], self._batch, self.law, self._damping)

    def _observed(self) -> np.ndarray:
        return self._damping.law.seen[0].astype(self.observation_space.dtype)

    def _longest(self) -> int:
        return -(-super()._longest() // self.law.schedule.hold)

    def _acting(self) -> Array:
        return self.damping[None, :, TRANSVERSE]

    def _info(self) -> dict[str, Any]:
        return super()._info() | {"damping": self.damping}


class SFFRFlexDampingVectorEnv(DampingEnvironment, SFFRFlexVectorEnv, VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Many independent ``SFFRFlexDamping-v0`` environments, advanced by one compiled call for each action.

    Spaces, reward and episode as in :class:`SFFRFlexDampingEnv`; seeds, autoreset and infos as in
    :class:`SFFRFlexVectorEnv`.

    Attributes:
        step_prices: (n, panels) what the score takes of the last step, panel by panel: over time, its vibration,
            effort and share of the squared tracking error over their scales, times their weights.

    Args:
        num_envs: number of environments.
        max_episode_steps: episodes are truncated after so many actions, or when ``duration`` is over; None or -1 for no
            limit beside that.
        autoreset_mode: see :class:`SFFRFlexVectorEnv`.
        scenario, params, overrides, render_mode, render_every, texts: as for the single one.
        law, rho, agent_period, duration, random_phase, base_tolerance, stack_size, dtype: likewise.
    """

    OF_ALL: ClassVar[tuple[str, ...]] = (*SFFRFlexVectorEnv.OF_ALL, *_LAW)
    OF_EACH: ClassVar[tuple[str, ...]] = ("damping",)

    def __init__(
        self,
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = None,
        scenario: ScenarioLike = "excited",
        params: ParamsLike = None,
        overrides: Sequence[str] = (),
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        law: str = "ahsc",
        rho: float = RHO,
        agent_period: float = AGENT_PERIOD,
        duration: float | None = DURATION,
        random_phase: bool = True,
        base_tolerance: float | None = None,
        stack_size: int = 1,
        dtype: DTypeLike = "float32",
        render_every: float = RENDER_EVERY,
        texts: bool = False,
    ) -> None:
        """Build the environments; raises as :class:`SFFRFlexDampingEnv` and :class:`SFFRFlexVectorEnv` do."""
        self._duration, self._random_phase = duration, random_phase  # of the episodes that the next line looks at
        super().__init__(
            num_envs, scenario=scenario, params=params, overrides=overrides, render_mode=render_mode,
            render_every=render_every, autoreset_mode=autoreset_mode, texts=texts,
        )  # fmt: skip
        self._renderers = make_renderers(num_envs, self._nominal_plant, render_mode, render_every, damped=True)
        self.law = scheduled_law(self.params, law, rho, agent_period, base_tolerance, stack_size)
        self.metadata = self.metadata | {"render_fps": frame_rate(agent_period)}
        self.law_name, self.obs_names = law, observation_names(self.params, stack_size)
        self.action_names = action_names(self.params, self.law)
        self.single_action_space, self.single_observation_space = damping_spaces(self.law, dtype=dtype)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        actions = step_limit(max_episode_steps)
        self._max_steps = None if actions is None else actions * self.law.schedule.hold
        self._damping = make_damping(self.law, num_envs)
        self.step_prices = self._damping.price.copy()  # kept beyond a reset

    @property
    def damping(self) -> Array:
        """Return the virtual damping that acts now (n, panels, 3) [N s/m, N s/m, N m s/rad]."""
        return self._damping.law.factor * self._damping.law.B_hat

    def _begin(self, chosen: Mask) -> None:
        start_damping(self.law, self._damping, chosen)
        super()._begin(chosen)

    def _clocks(self) -> list[tuple[IntArray, int]]:
        return [*super()._clocks(), (self._damping.end, NO_LIMIT)]

    def _make_stepper(self) -> DampingStepper:
        return DampingStepper(plants_of(self._fleet), self._batch, self.law, self._damping)

    def _arrays(self) -> list[np.ndarray]:
        return [*super()._arrays(), *self._damping.law, *self._damping[1:]]

    def _advance(self, actions: Array, active: Mask) -> None:
        super()._advance(actions, active)
        self.step_prices = self._damping.price.copy()

    def _seen(self) -> Array:
        return self._damping.law.seen

    def _acting(self) -> Array:
        return self.damping[:, :, TRANSVERSE]

    def _infos(self, mask: Mask) -> Infos:
        return super()._infos(mask) | {"damping": self.damping, "_damping": mask.copy()}


def make_damping_envs(num_envs: int = 1, *, backend: str = "cpu", **kwargs: Any) -> gym.vector.VectorEnv[Any, Any, Any]:
    """Return many ``SFFRFlexDamping-v0`` environments; see :func:`sffr_gym.envs.backends.make_on`."""
    return make_on(backend, SFFRFlexDampingVectorEnv, num_envs, **kwargs)


def training_scenario(scenario: Scenario, duration: float | None, random_phase: bool) -> Scenario:
    """Return the scenario with the length [s] and the start of an agent's episodes; raises ConfigError."""
    length = scenario.duration if duration is None else duration
    return scenario.with_changes(random_phase=random_phase or scenario.random_phase, duration=length)


def damping_spaces(
    law: Law, panels: int | None = None, dtype: DTypeLike = "float32"
) -> tuple[gym.spaces.Box, gym.spaces.Box]:
    """Return action and observation space of one environment, or of so many of its panels.

    Raises:
        ValueError: for an unknown type of observations.
    """
    n_p, kind = panels or len(law.allocation), observation_type(dtype)
    bound = np.tile(BOUNDS, n_p * law.schedule.stack).astype(kind)
    n_a = n_p * decisions_of_panel(law)
    return gym.spaces.Box(-1.0, 1.0, (n_a,), np.float32), gym.spaces.Box(-bound, bound, dtype=kind.type)
