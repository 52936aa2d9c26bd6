"""``SFFRFlex-v0``: the robot with its actuators as a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import DTypeLike

from sffr_gym.config.params import Params
from sffr_gym.envs.arguments import (
    ParamsLike,
    ScenarioLike,
    check_options,
    check_seed,
    observation_type,
)
from sffr_gym.envs.base import RobotEnvironment
from sffr_gym.envs.batch import Stepper, group_shapes, make_batch, put_episode, step_range, visible
from sffr_gym.envs.member import Present
from sffr_gym.envs.pictures import RENDER_EVERY, frame_rate, make_renderer
from sffr_gym.envs.spaces import check_action, make_spaces
from sffr_gym.envs.state import check_batch, check_episode
from sffr_gym.task.episode import Episode, draw
from sffr_gym.task.reference import Reference
from sffr_gym.task.reward import REWARDS
from sffr_gym.task.signals import SIGNALS
from sffr_gym.task.status import RUNNING, failure_text
from sffr_gym.task.task_model import TaskModel, plant_of
from sffr_gym.types import Array

MEASURED = (*SIGNALS, *(f"reward_{name}" for name in REWARDS))  # keys of an info


class SFFRFlexEnv(RobotEnvironment, Present, gym.Env[np.ndarray, np.ndarray]):
    """A free-flying robot with two arms carries an object around a circle while its long, soft solar panels swing.

    ## Description
    The plant is the rigid-flexible interactive model of the paper: a 50 kg base with thrusters, two arms that hold an
    object between them, an antenna, a camera, and two 4 m panels that bend. The object's centre has to follow a circle
    of 15 m radius at 0.85 m/s, its orientation and the base's heading constant, while the panels' vibration dies out.
    One step is one control period of 2 ms under held actuator forces; once around is 55,440 steps. The parameters
    ``path`` put a figure-eight, a line, a slew with a turn, or a curve through waypoints in the circle's place.

    ## Action space
    ``Box(-1, 1, (15,), float32)``; an action times the actuator's limit is its command. Values beyond, infinite ones
    among them, are clipped, which ``info["clipped"]`` counts. Float64 actions are taken as they are; what is no real
    number is refused.

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
    ``Box(float64)`` (or float32, see ``dtype``), SI units, vectors in the reference axes (the inertial ones for the
    fixed heading); errors are desired minus actual. ``env.unwrapped.fields`` has name, place, unit and bound of each:

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

    On other paths than the circle four more follow: the reference's jerk, angular acceleration and angular jerk.

    ## Reward
    The sum of three terms in (0, w], each in ``info`` as ``reward_<name>``, for the state after the step, with the
    weights ``w`` and scales ``s`` of the parameters: w / (1 + log(1 + x)), where x is (object position error / s)^2 for
    ``tracking``, (bending energy about the quasi-static shape) / s for ``vibration``, (sum of squared voltages) / s^2
    for ``effort``. The weights add up to 1. A period that ends in a failure earns 0. So the reward lies in [0, 1], and
    whatever a policy did before, going on earns more than failing.

    ## Info
    Numbers and arrays of numbers, with the same keys and types at every reset and step of a scenario: each measure of
    ``task.SIGNALS`` (of the true state; the saturated fractions of piezos, thrusters and joints among them),
    ``reward_<name>``, ``time`` [s], ``clipped``, ``failure`` (0 for none; ``task.status.Failure(number)`` is its name,
    ``failure_text`` beside it the reason in words), ``applied`` (the command after the limits), ``drawn_<name>`` (each
    number that the scenario drew, its unit at the end of its name) and ``cost``, for safe reinforcement learning: 1 in
    a period in which an actuator is at its limit or that ends the episode in a failure, else 0. With ``texts`` there is
    ``failure_text`` too.

    ## Starting state
    Drawn from the scenario, as is what happens afterwards: ``nominal`` is Table IV, ``excited`` has swinging panels,
    ``offset`` starts off the path, ``fast`` draws the path's speed; in ``payload`` and ``mismatch`` the plant is not
    the robot of ``params``, which is all that controllers know; ``degraded`` has a fault, ``impulse`` hits the base.
    In ``noise``, and with a scenario of your own, what is measured is noisy and may lag a control period behind: the
    robot of a period ago is compared with what is desired now. Noise reaches the observation alone; reward, measures
    and the episode's end know the truth. The reference's motion is known, not measured. A scenario whose starts lie
    outside of the observation space is refused; a single one that does nevertheless is shown on its bound.

    ## Episode end
    Terminates, with the reason in ``info["failure"]``, when a panel's tip moves beyond a quarter of its length, a
    grasping arm gets singular, a grasp is lost, an observation leaves its bound, or the state is not finite. A state
    that is not finite is never returned: the last finite one stays. Truncates when the scenario's time is over, after
    ``env.spec.max_episode_steps`` at the latest. Who steps on without a reset goes on simulating.

    ## Arguments
    - ``scenario``: a shipped scenario's name, the path of a YAML file, a ``Scenario``, or a mapping of its keys.
    - ``params``: a ``Params`` object, a path, a mapping with what differs from the case study, or None for that; the
      robot as controllers know it.
    - ``overrides``: assignments such as ``["panel.EI=25"]`` on top of them.
    - ``render_mode``: None; ``rgb_array``, pictures of 600 x 600 pixels without any display; or ``human``, a window
      that follows the simulation in real time. Needs the extra ``render``.
    - ``dtype``: of the observation, ``float64`` or ``float32``. The state is float64 in any case.
    - ``render_every``: time between two pictures [s]; 0 for one of every step, such as for observations of pixels.
    - ``texts``: let infos hold texts too, which many tools for arrays cannot take.

    What is given can be neither set nor changed afterwards, but the scenario by ``reset(options={"scenario": ...})``.

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
    - v0: first version. Before its release the reward was the unbounded negative cost, which paid for crashing early.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 500}

    def __init__(
        self,
        scenario: ScenarioLike = "nominal",
        params: ParamsLike = None,
        overrides: Sequence[str] = (),
        render_mode: str | None = None,
        dtype: DTypeLike = "float64",
        render_every: float = RENDER_EVERY,
        texts: bool = False,
    ) -> None:
        """Build the environment; see the class for the arguments.

        Raises:
            ConfigError: for parameters, a scenario or a time between pictures that are not valid, or a scenario whose
                episodes would begin outside of the observation space.
            ValueError: for an unknown render mode or type of observations.
            gymnasium.error.DependencyNotInstalled: for a render mode without Pillow.
        """
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(
                f"render_mode must be one of {[None, *self.metadata['render_modes']]}, got {render_mode!r}"
            )
        self.render_mode, self._texts = render_mode, texts
        self._settle(scenario, params, overrides)
        self._plant_task = self._nominal_plant
        self.action_space, self.observation_space = make_spaces(self.prior_task, observation_type(dtype))
        self._batch = make_batch(self._nominal_plant, 1)
        self._episode: Episode | None = None
        self.metadata = self.metadata | {"render_fps": frame_rate(self.prior_task.period)}
        self._renderer = make_renderer(self._nominal_plant, render_mode, render_every)

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Draw an episode. ``options={"scenario": ...}`` changes the scenario from now on.

        Raises:
            ValueError: for an unknown option.
            ConfigError: for a scenario that is not valid, or whose episodes would begin outside of the space.
            gymnasium.error.Error: for a seed that is no whole number from 0 on.
        """
        asked, seed = check_options(options, ("scenario",)), check_seed(seed)
        scenario = self._checked_scenario(asked["scenario"]) if asked else self.scenario
        super().reset(seed=seed)
        self._scenario = scenario
        episode = draw(self._distribution(scenario), self._nominal, self.np_random)
        self._take(episode, plant_of(self._nominal_plant, self._nominal, episode))
        self._start(episode)
        self._note()
        return self._observed(), self._info()

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Hold an action for one control period.

        Raises:
            ValueError: for an action that is no array of real numbers, of the wrong shape, or with NaN.
            gymnasium.error.ResetNeeded: before the first reset.
        """
        ticks = self.ticks
        action = check_action(action, self.action_space.shape)
        batch = self._batch
        self._stepper.actions[0] = action
        self._stepper.step()
        self._note()
        terminated, truncated = int(batch.status[0]) != RUNNING, int(batch.tick[0]) >= ticks
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
    def plant_task(self) -> TaskModel:
        """The robot of this episode as it is, packed; :attr:`prior_task` is what the controllers believe."""
        return self._plant_task

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

    def _kept(self) -> dict[str, Any]:
        return super()._kept() | {
            "batch": self._batch, "episode": self._episode, "rng": self.np_random, "seed": self.np_random_seed,
            "trace": None if self._renderer is None or self._episode is None else self._renderer.past(),
        }  # fmt: skip

    def _form(self) -> dict[str, Any]:
        return super()._form() | {"episode": None, "trace": None}

    def _check(self, kept: dict[str, Any]) -> TaskModel:
        """Return the plant of a state; see the base class."""
        check_batch(kept["batch"], self._nominal_plant)
        if kept["episode"] is None:
            return self._nominal_plant
        if self._renderer is not None and kept["trace"] is not None:
            self._renderer.check(kept["trace"], visible(kept["batch"], 0))
        return check_episode(kept["episode"], self._nominal, self._nominal_plant)

    def _put(self, kept: dict[str, Any], checked: TaskModel) -> None:
        self._batch, self._scenario = kept["batch"], kept["scenario"]
        self._np_random, self._np_random_seed = kept["rng"], kept["seed"]
        self._take(kept["episode"], checked)
        self._forget_stepper()
        if self._renderer is not None and kept["episode"] is not None:
            self._renderer.restore(kept["trace"], visible(self._batch, 0))
            self._note()  # which begins a trace where there is none

    def _start(self, episode: Episode) -> None:
        """Put the plant at the start of an episode."""
        put_episode(self._batch, 0, episode)
        self._stepper.observe()

    def _told(self) -> dict[str, object]:
        time = None if self._episode is None else round(self.time, 6)
        return super()._told() | {"time": time, "render_mode": self.render_mode}

    def _longest(self) -> int:
        return self._distribution(self.scenario).longest(self.params)

    def _make_stepper(self) -> Stepper:
        """Return what advances the batch of this one environment."""
        n_u = len(self.prior_task.scale)
        return Stepper(step_range, [self._plant_task], self._batch, n_u, group_shapes(self._nominal_plant))

    def _observed(self) -> np.ndarray:
        """A copy of what an agent sees now."""
        return self._batch.obs[0].astype(self.observation_space.dtype)

    def _take(self, episode: Episode | None, plant: TaskModel) -> None:
        """Make an episode and its plant this one's."""
        self._episode = episode
        if plant is not self._plant_task:  # packing one takes as long as all the rest of a reset
            self._plant_task = plant
            self._stepper.put_plant(0, plant)
        if self._renderer is not None and episode is not None:
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
        batch, drawn = self._batch, self.episode.drawn
        info: dict[str, Any] = dict(zip(MEASURED, [*batch.signals[0].tolist(), *batch.terms[0].tolist()], strict=True))
        info["time"], info["clipped"] = self.time, int(batch.clipped[0])
        info["failure"], info["cost"] = int(batch.status[0]), float(batch.cost[0])
        info["applied"] = batch.applied[0].copy()
        for name, value in drawn.items():
            info[f"drawn_{name}"] = value
        if self._texts:
            info["failure_text"] = failure_text(info["failure"])
        return info
