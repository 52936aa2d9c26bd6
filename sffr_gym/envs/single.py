"""``SFFRFlex-v0``: the robot with its actuators as a Gymnasium environment."""

from __future__ import annotations

import copy
import os
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np

from sffr_gym.config.params import Params, load_params
from sffr_gym.envs.batch import batch_memory, make_batch, start_episode, step_batch, visible
from sffr_gym.envs.fleet import make_fleet
from sffr_gym.envs.pictures import RENDER_EVERY, frame_rate, make_renderer
from sffr_gym.physics.simulator import State, unflatten
from sffr_gym.task.episode import Episode, draw, nominal
from sffr_gym.task.reference import Reference
from sffr_gym.task.reward import REWARDS
from sffr_gym.task.scenario import Scenario, load_scenario
from sffr_gym.task.signals import SIGNALS
from sffr_gym.task.status import REASONS, RUNNING
from sffr_gym.task.task_model import TaskModel, make_task_model, plant_of
from sffr_gym.types import Array

ParamsLike = Params | str | os.PathLike[str] | None

ONE = np.ones(1, dtype=np.bool_)  # the single environment of its batch is active


class SFFRFlexEnv(gym.Env[np.ndarray, np.ndarray]):
    """A free-flying robot with two arms carries an object around a circle while its long, soft solar panels swing.

    ## Description
    The plant is the rigid-flexible interactive model of the paper: a 50 kg base with thrusters, two arms that hold an
    object between them, an antenna, a camera, and two 4 m panels that bend. The object's centre has to follow a circle
    of 15 m radius at 0.85 m/s, its orientation and the base's heading constant, while the panels' vibration dies out.
    One step is one control period of 2 ms under held actuator forces; once around is 55,440 steps.

    ## Action space
    ``Box(-1, 1, (15,), float32)``; an action times the actuator's limit is its command. Values beyond are clipped,
    which ``info["clipped"]`` counts. Float64 actions are taken as they are.

    | index | actuator | limit |
    |---|---|---|
    | 0-2 | left panel's piezo channels on axial, transverse and slope coordinate of the tip | 200 V (47.5 N, N, N m) |
    | 3-5 | right panel's | 200 V |
    | 6, 7 | thrust along the base's x and y axis | 100 N |
    | 8 | thruster torque | 100 N m |
    | 9-12 | joints of arm 1 and arm 2 | 7 N m |
    | 13, 14 | antenna and camera joint | 7 N m |

    That is for the ``generalized`` piezo array; ``patches`` has 8 channels for each panel and ``tip`` has 2, of every
    pair the upper face first.

    ## Observation space
    ``Box(float64)``, SI units, vectors in the reference axes (the inertial ones for the fixed heading); errors are
    desired minus actual. ``env.unwrapped.fields`` has name, place, unit and bound of each field:

    | index | field | unit |
    |---|---|---|
    | 0-5 | base position and yaw error, their rates | m, rad, m/s, rad/s |
    | 6-13 | gripper position errors (arm 1, arm 2), their rates | m, m/s |
    | 14-19 | object position and orientation error, their rates | m, rad, m/s, rad/s |
    | 20, 21 | antenna and camera angle error | rad |
    | 22-27 | joint angles in [-pi, pi) | rad |
    | 28-33 | joint rates | rad/s |
    | 34 | yaw rate of the base | rad/s |
    | 35-40 | tip coordinates of left and right panel: axial, transverse, slope | m, m, rad |
    | 41-46 | their rates | m/s, m/s, rad/s |
    | 47-49 | velocity of the reference and its turn | m/s, rad/s |
    | 50, 51 | acceleration of the reference | m/s2 |

    ## Reward
    The sum of three terms, each in ``info`` as ``reward_<name>``, for the state after the step, with the weights ``w``
    and scales ``s`` of the parameters: ``tracking`` = -w T (object position error / s)^2, ``vibration`` = -w T
    (bending energy about the quasi-static shape) / s, ``effort`` = -w T (sum of squared voltages) / s^2, T the control
    period.

    ## Info
    The same keys with the same types at every reset and step: each measure of ``task.SIGNALS`` (of the true state; the
    saturated fractions of piezos, thrusters and joints among them), ``reward_<name>``, ``time`` [s], ``clipped``,
    ``failure``, ``applied`` (the command after the limits), ``drawn`` (what the scenario drew, by name with unit) and
    ``cost``, for safe reinforcement learning: 1 in a period in which an actuator is at its limit or that ends the
    episode in a failure, else 0.

    ## Starting state
    Drawn from the scenario, as is what happens afterwards: ``nominal`` is Table IV, ``excited`` has swinging panels,
    ``offset`` starts off the path, ``fast`` draws the path's speed; in ``payload`` and ``mismatch`` the plant is not
    the robot of ``params``, which is all that controllers know; ``degraded`` has a fault, ``impulse`` hits the base.
    In ``noise``, and with a scenario of your own, what is measured is noisy and may lag a control period behind: the
    robot of a period ago is compared with what is desired now. Noise reaches the observation alone; reward, measures
    and the episode's end know the truth. The reference's motion is known, not measured.

    ## Episode end
    Terminates, with the text in ``info["failure"]``, when a panel's tip moves beyond a quarter of its length, a
    grasping arm gets singular, a grasp is lost, an observation leaves its bound, or the state is not finite. A state
    that is not finite is never returned: the last finite one stays. Truncates when the scenario's time is over.

    ## Arguments
    - ``scenario``: a shipped scenario's name or the path of a YAML file.
    - ``params``: a ``Params`` object, a path, or None for the case study; the robot as controllers know it.
    - ``overrides``: assignments such as ``["panel.EI=25"]`` on top of them.
    - ``render_mode``: None; ``rgb_array``, pictures of 600 x 600 pixels without any display; or ``human``, a window
      that follows the simulation in real time. Needs the extra ``render``.
    - ``render_every``: time between two pictures [s], 25 of them in a second; 0 for one of every step.

    ## Pictures
    ``render()`` shows the last moment that was due, every ``render_every`` seconds and at the episode's end, and
    returns the same read-only array until the next one: Gymnasium's ``RecordVideo``, which keeps a picture of each
    step, needs 27 MB for a simulated second instead of 540. ``metadata["render_fps"]`` is the number of steps in a
    second, so that its videos play in real time; it needs the extra ``record``, and ``sffr animate`` writes lighter
    ones. ``render()`` only reads: the same state gives the same pixels. That moment, and the last 20 s for the small
    plots, are a part of the state that :meth:`get_state` returns; one of an environment without a render mode can be
    drawn, too, but without its past.

    Closing the window ends the pictures, not the program. A copy of the environment (``copy.deepcopy``, ``pickle``)
    opens no window before its next ``reset`` or ``render()``, so that planners can look ahead at full speed.

    ## Version history
    - v0: first version.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 500}

    def __init__(
        self,
        scenario: str | os.PathLike[str] = "nominal",
        params: ParamsLike = None,
        overrides: tuple[str, ...] | list[str] = (),
        render_mode: str | None = None,
        render_every: float = RENDER_EVERY,
    ) -> None:
        """Build the environment; see the class for the arguments.

        Raises:
            ConfigError: for parameters, a scenario or a time between pictures that are not valid.
            ValueError: for an unknown render mode.
            gymnasium.error.DependencyNotInstalled: for a render mode without Pillow.
        """
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(
                f"render_mode must be one of {[None, *self.metadata['render_modes']]}, got {render_mode!r}"
            )
        self.render_mode = render_mode
        self.params = resolve_params(params, overrides)
        self.scenario = load_scenario(scenario)
        self.prior_task = self.plant_task = make_task_model(self.params)
        self._nominal = nominal(self.params)
        self.fields = self._nominal.fields
        self.action_space, self.observation_space = make_spaces(self.prior_task)
        self._fleet, self._batch = make_fleet(self.prior_task), make_batch(self.prior_task, 1)
        self._memory = batch_memory(self.prior_task, 1)
        self._episode: Episode | None = None
        self.metadata = self.metadata | {"render_fps": frame_rate(self.prior_task.period)}
        self._renderer = make_renderer(self.prior_task, render_mode, render_every)

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Draw an episode. ``options={"scenario": ...}`` changes the scenario from now on.

        Raises:
            ValueError: for an unknown option.
            ConfigError: for a scenario that is not valid.
        """
        super().reset(seed=seed)
        self.scenario = scenario_option(self.scenario, options)
        episode = draw(self._distribution(), self._nominal, self.np_random)
        self._take(episode)
        self._start(episode)
        self._note()
        return self._observed(), self._info()

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Hold an action for one control period.

        Raises:
            ValueError: for an action of the wrong shape or with NaN.
            gymnasium.error.ResetNeeded: before the first reset.
        """
        ticks = self.ticks
        action = check_action(action, self.action_space.shape)
        batch = self._batch
        self._advance(action[None])
        self._note()
        terminated = bool(batch.status[0] != RUNNING)
        truncated = bool(batch.tick[0] >= ticks)
        return self._observed(), float(batch.reward[0]), terminated, truncated, self._info()

    def render(self) -> np.ndarray | None:
        """The picture (600, 600, 3), uint8, read-only; with ``human`` it is shown, and None returned. See the class.

        Raises:
            gymnasium.error.ResetNeeded: before the first reset.
            gymnasium.error.Error: if there is no display, with ``human``.
        """
        if self._renderer is None:
            gym.logger.warn(
                "render() shows nothing without a render_mode, such as gym.make(..., render_mode='rgb_array')"
            )
            return None
        _ = self.episode
        return self._renderer.render()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()

    @property
    def episode(self) -> Episode:
        """What the scenario drew for this episode; raises gymnasium.error.ResetNeeded before the first reset."""
        if self._episode is None:
            raise gym.error.ResetNeeded("call reset before step")
        return self._episode

    @property
    def reference(self) -> Reference:
        """The desired motion of this episode."""
        return self.episode.reference

    @property
    def plant(self) -> Params:
        """The robot of this episode as it is; ``params`` is what the controllers believe."""
        return self.episode.plant

    @property
    def ticks(self) -> int:
        """Length of this episode in control periods."""
        return self.episode.ticks

    @property
    def time(self) -> float:
        """Time since the start of the episode [s]."""
        return float(self._batch.tick[0] * self.prior_task.period)

    @property
    def positions(self) -> Array:
        """A copy of the plant's positions ``p`` (n,), laid out as ``sffr_gym.physics.model`` says."""
        return self._batch.p[0].copy()

    @property
    def velocities(self) -> Array:
        """A copy of the plant's velocities ``v`` (n,)."""
        return self._batch.v[0].copy()

    def state(self) -> State:
        """The plant's state in the paper's coordinates, for :class:`Simulator` and plots."""
        return unflatten(self.plant_task.model, self.time, self._batch.p[0], self._batch.v[0])

    def get_state(self) -> dict[str, Any]:
        """Everything that the future depends on; a copy that :meth:`set_state` restores bit for bit."""
        kept = {"batch": self._batch, "rng": self.np_random, "scenario": self.scenario, "episode": self._episode}
        kept["trace"] = None if self._renderer is None or self._episode is None else self._renderer.past()
        return copy.deepcopy(kept)

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore what :meth:`get_state` returned."""
        state = copy.deepcopy(dict(state))
        self._batch, self.np_random, self.scenario = state["batch"], state["rng"], state["scenario"]
        if state["episode"] is not None:
            self._take(state["episode"])
            if self._renderer is None or state["trace"] is None:
                self._note()
            else:
                self._renderer.restore(state["trace"], visible(self._batch, 0))

    def _distribution(self) -> Scenario:
        """What episodes are drawn from."""
        return self.scenario

    def _start(self, episode: Episode) -> None:
        """Put the plant at the start of an episode."""
        start_episode(self._fleet, self._batch, self._memory, 0, episode)

    def _advance(self, actions: Array) -> None:
        """Hold an action (1, n_u)."""
        step_batch(self._fleet, self._batch, self._memory, actions, ONE)

    def _observed(self) -> Array:
        """A copy of what an agent sees now."""
        return self._batch.obs[0].copy()

    def _take(self, episode: Episode) -> None:
        """Make an episode and its plant this one's."""
        self._episode = episode
        plant = plant_of(self.prior_task, episode)
        if plant is not self.plant_task:  # packing one takes as long as all the rest of a reset
            self.plant_task, self._fleet = plant, make_fleet(plant)
        if self._renderer is not None:
            self._renderer.start(episode.plant, episode.reference, self.scenario.name)

    def _note(self) -> None:
        """Keep what later pictures show, if there are any, and show one in the window if it is due."""
        if self._renderer is not None:
            self._renderer.record(visible(self._batch, 0), self._batch.signals[0], self._acting()[0])

    def _acting(self) -> Array:
        """Return the virtual damping (1, n_p) of the panels' tip displacements; empty without a law inside."""
        return np.zeros((1, 0))

    def _info(self) -> dict[str, Any]:
        """The same keys at every step and reset."""
        batch = self._batch
        info: dict[str, Any] = dict(zip(SIGNALS, batch.signals[0].tolist(), strict=True))
        info |= {f"reward_{name}": value for name, value in zip(REWARDS, batch.terms[0].tolist(), strict=True)}
        info |= {"time": self.time, "clipped": int(batch.clipped[0]), "failure": REASONS[int(batch.status[0])]}
        cost, applied = float(batch.cost[0]), batch.applied[0].copy()
        return info | {"cost": cost, "applied": applied, "drawn": dict(self.episode.drawn)}


def resolve_params(params: ParamsLike, overrides: tuple[str, ...] | list[str]) -> Params:
    """Parameters from an object, a path or None, with overrides on top; raises ConfigError."""
    resolved = params if isinstance(params, Params) else load_params(params)
    return resolved.with_overrides(*overrides)


def make_spaces(prior: TaskModel) -> tuple[gym.spaces.Box, gym.spaces.Box]:
    """Action and observation space of one environment."""
    action = gym.spaces.Box(-1.0, 1.0, (len(prior.scale),), np.float32)
    return action, gym.spaces.Box(-prior.bound, prior.bound, dtype=np.float64)


def scenario_option(scenario: Any, options: Mapping[str, Any] | None) -> Any:
    """The scenario that ``reset`` options ask for; raises ValueError for an unknown option."""
    unknown = set(options or {}) - {"scenario"}
    if unknown:
        raise ValueError(f"unknown reset option {sorted(unknown)}; known: ['scenario']")
    return load_scenario(options["scenario"]) if options and "scenario" in options else scenario


def check_action(action: Any, shape: tuple[int, ...] | None) -> Array:
    """An action as float64; raises ValueError for a wrong shape or NaN."""
    array = np.asarray(action, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"action must have shape {shape}, got {array.shape}")
    if np.isnan(array).any():
        raise ValueError(f"action has NaN at {np.argwhere(np.isnan(array)).ravel().tolist()}")
    return array
