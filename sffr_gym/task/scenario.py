"""Scenarios: named distributions of episodes, read from YAML (``configs/scenarios``); ``episode.py`` draws from them.

Every key stands for one drawn quantity or a group of them, in SI units; what a file leaves out is not drawn.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from math import ceil
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from sffr_gym.compile.kernels import kernel
from sffr_gym.config.files import canonical_json, short_hash
from sffr_gym.config.params import Params
from sffr_gym.config.ranges import LARGEST_SEED, EpisodeLength, Name, Text, at_most
from sffr_gym.config.sections import MOST_ELEMENTS, Section
from sffr_gym.config.strict_yaml import ConfigError, build, check_error, config_dir, load

EVALUATION_SEED = 1_000_000  # seeds from here up are for evaluation alone: training rejects them
TASK = "SFFRFlex-v0"  # whose observation, reward and ends an episode has; a part of every hash
MOST_IMPULSES = 8  # of an episode
MOST_MODES = 2 * MOST_ELEMENTS  # bending modes that the finest panel has
MOST_CHANGES = 32  # assignments
MOST_FAULTS = 100  # of which each episode has one
MOST_PERIODS = 10**9  # control periods of an episode: an hour of computing
SLACK = 1.0e-9  # control periods that rounding may add to an episode
MOST_EPISODES = 100_000  # of each policy: ten hours of computing at the case study's length


def _within(least: float, most: float) -> AfterValidator:
    """Return a check that an interval is ordered and lies in a range."""
    allowed = f"{least:g} <= lower <= upper <= {most:g}"

    def check(ends: tuple[float, float]) -> tuple[float, float]:
        if not least <= ends[0] <= ends[1] <= most:
            raise check_error(f"must be the ends of a uniform distribution, {allowed}")
        return ends

    return AfterValidator(check)


Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Amplitude = Annotated[tuple[float, float], _within(0.0, 1000.0)]  # m, the longest panel
Speed = Annotated[tuple[float, float], _within(0.01, 10.0)]  # m/s
Factor = Annotated[tuple[float, float], _within(0.01, 100.0)]
# Noise beyond these shows nothing of a robot any more; an angle's is taken for degrees.
Noise = Annotated[float, Field(ge=0.0, le=100.0)]  # m, m/s, rad/s
AngleNoise = Annotated[float, Field(ge=0.0, le=1.0)]  # rad
Impulse = Annotated[float, Field(ge=0.0, le=1.0e6)]  # N s, N m s: that of a rocket stage


class PanelMode(Section):
    """Excitation of one bending mode of every panel, drawn for each panel separately."""

    mode: int = Field(ge=1, le=MOST_MODES, description="bending mode, 1 is the lowest")
    amplitude: Amplitude = Field(description="transverse tip amplitude [m]")


LagTime = Annotated[tuple[float, float], _within(0.0, 100.0)]  # s
Step = Annotated[tuple[float, float], _within(0.0, 1.0e6)]  # V, N, N m, m, m/s, rad/s
AngleStep = Annotated[tuple[float, float], _within(0.0, 1.0)]  # rad

Changes = Annotated[tuple[Text, ...], at_most(MOST_CHANGES, "each is an assignment of one key")]


class Draws(Section):
    """Ends of uniform distributions by name; None is not drawn."""

    def drawn(self) -> dict[str, tuple[float, float]]:
        """Return the ends of what is drawn, in order."""
        return {name: ends for name in type(self).model_fields if (ends := getattr(self, name)) is not None}


class PanelDraws(Draws):
    """Factors on what a panel has, drawn for each panel."""

    mass: Factor | None = Field(default=None, description="mass of a panel [-]")
    length: Factor | None = Field(default=None, description="length of a panel [-]")
    EI: Factor | None = Field(default=None, description="bending stiffness of a panel [-]")


class LagDraws(Draws):
    """Time constants of actuators that lag behind, one for each group."""

    piezo: LagTime | None = Field(default=None, description="of the piezos [s]")
    thruster: LagTime | None = Field(default=None, description="of the thrusters [s]")
    joint: LagTime | None = Field(default=None, description="of the joints [s]")


class QuantisationDraws(Draws):
    """Steps in which actuators can be commanded."""

    piezo: Step | None = Field(default=None, description="of the piezos' voltage [V]")
    thruster_force: Step | None = Field(default=None, description="of the force on each body axis [N]")
    thruster_torque: Step | None = Field(default=None, description="of the torque on the base [N m]")
    joint: Step | None = Field(default=None, description="of the joints' torque [N m]")


class PlantFactors(Section):
    """What the plant is beside what the controllers believe: other settings, and factors on what is drawn."""

    settings: Changes = Field(default=(), description="assignments such as panel.elements=8, unknown to controllers")
    object: Factor | None = Field(default=None, description="mass and inertia of the object, one factor for both [-]")
    EI: Factor | None = Field(default=None, description="bending stiffness of all panels [-]")
    panel_mass: Factor | None = Field(default=None, description="mass of all panels [-]")
    each_panel: PanelDraws = Field(default=PanelDraws(), description="what each panel has of its own")
    link_mass: Factor | None = Field(default=None, description="mass and inertia of each link, drawn for each [-]")
    piezo: Factor | None = Field(default=None, description="force and moment of the piezos at full voltage [-]")
    thruster: Factor | None = Field(default=None, description="limits of the thrusters [-]")
    on_off: Probability | None = Field(default=None, description="part of the episodes with thrusters on or off [-]")
    minimum_on_time: LagTime | None = Field(default=None, description="of thrusters that are on or off [s]")
    lag: LagDraws = Field(default=LagDraws(), description="how the actuators lag behind")
    quantisation: QuantisationDraws = Field(default=QuantisationDraws(), description="in which steps actuators act")


class SensorSteps(Draws):
    """Steps in which sensors give what they measure, drawn once an episode for each unit."""

    position: Step | None = Field(default=None, description="of positions and displacements [m]")
    angle: AngleStep | None = Field(default=None, description="of angles and slopes [rad]")
    velocity: Step | None = Field(default=None, description="of velocities [m/s]")
    rate: Step | None = Field(default=None, description="of angular rates [rad/s]")


class Sensors(Section):
    """Errors of the measured fields of the observation: white noise by unit, a delay of one control period, steps."""

    position: Noise = Field(default=0.0, description="noise of positions and displacements, rms [m]")
    angle: AngleNoise = Field(default=0.0, description="noise of angles and slopes, rms [rad]")
    velocity: Noise = Field(default=0.0, description="noise of velocities, rms [m/s]")
    rate: Noise = Field(default=0.0, description="noise of angular rates, rms [rad/s]")
    delay: Probability = Field(default=0.0, description="part of the episodes that measure one period late [-]")
    quantisation: SensorSteps = Field(default=SensorSteps(), description="steps of what is measured")


class Fault(Section):
    """Actuators that have lost a part of their limit, unknown to the controllers."""

    actuators: Literal["piezo", "thruster", "joint"] = Field(
        description="piezos of one drawn panel, all thrusters, or all joints [-]"
    )
    remaining: Probability = Field(description="part of the limit that is left; 0 is dead [-]")


class ImpulseDraws(Section):
    """Impulses on the base, each spread over one control period at a random time; base axes."""

    count: int = Field(ge=1, le=MOST_IMPULSES, description="number of impulses in an episode [-]")
    linear: Impulse = Field(description="largest impulse of the force, any direction [N s]")
    angular: Impulse = Field(description="largest impulse of the moment, either sign [N m s]")


class Scenario(Section):
    """A distribution of episodes.

    ``offset_position`` and ``offset_angle`` are the largest shift of robot and object as one from the path, uniform
    over a disc and an interval. ``panel_modes`` replaces the configured elastic state by free vibration of any phase.
    With a drawn ``speed`` the robot starts as fast as the path. ``random_phase`` starts anywhere on it, and adds the
    shape that the path's acceleration gives a panel there, so that what is drawn is the motion about it. ``robot``
    changes parameters for plant and controllers alike. ``plant`` and ``faults`` change the plant alone: the controllers
    go on with the parameters that they believe in.
    """

    name: Name = Field(description="name of the scenario")
    description: Text = Field(description="what it draws")
    duration: EpisodeLength | None = Field(
        default=None, description="length of an episode [s]; null: once along the path"
    )
    panel_modes: Annotated[tuple[PanelMode, ...], at_most(MOST_MODES, "so many modes has the finest panel")] = Field(
        default=(), description="excited bending modes"
    )
    offset_position: float = Field(default=0.0, ge=0.0, le=1.0, description="largest shift off the path [m]")
    offset_angle: float = Field(default=0.0, ge=0.0, le=1.0, description="largest turn off the path [rad]")
    speed: Speed | None = Field(default=None, description="speed along the path [m/s]")
    random_phase: bool = Field(default=False, description="start anywhere on a closed path")
    robot: Changes = Field(default=(), description="assignments such as path.speed=0.5, known to the controllers")
    plant: PlantFactors = Field(default=PlantFactors(), description="what the controllers are wrong about")
    sensors: Sensors = Field(default=Sensors(), description="errors of the observation")
    faults: Annotated[tuple[Fault, ...], at_most(MOST_FAULTS, "each episode has one")] = Field(
        default=(), description="faults, of which each episode has one"
    )
    impulses: ImpulseDraws | None = Field(default=None, description="impulses on the base")

    def robot_of(self, params: Params, overrides: Sequence[str] = ()) -> Params:
        """Return parameters with what the scenario changes for all.

        Args:
            params: otherwise.
            overrides: assignments that were asked for and are among them.

        Raises:
            ConfigError: for an assignment that is not valid, or that undoes one of the overrides.
        """
        changed = self._changed(params, self.robot, "robot")
        for override in overrides if changed != params else ():
            if changed.with_overrides(override) != changed:
                raise ConfigError(
                    f"override {override!r}: scenario {self.name} sets it otherwise ({', '.join(self.robot)}); leave "
                    "it out, or write a scenario of your own"
                )
        return changed

    def plant_of(self, prior: Params) -> Params:
        """Return the plant, before anything is drawn, of a robot that is believed; raises ConfigError."""
        return self._changed(prior, self.plant.settings, "plant.settings")

    def _changed(self, params: Params, changes: tuple[str, ...], key: str) -> Params:
        try:
            return params.with_overrides(*changes) if changes else params
        except ConfigError as error:
            raise ConfigError(f"scenario {self.name}: {key}: {error}") from None

    def ticks(self, params: Params) -> int:
        """Return the length in control periods of an episode with these parameters, the drawn speed among them.

        Raises:
            ConfigError: if it is too long to be computed.
        """
        duration = params.path.period if self.duration is None else self.duration
        periods = duration / params.control.period
        if periods > MOST_PERIODS:
            once = "" if self.duration else f", once along a {params.path.kind}"
            raise ConfigError(
                f"{self.name}: duration: an episode of {duration:.3g} s{once}, would take about {periods:.1g} control "
                f"periods, at most {MOST_PERIODS:.0e}: give the scenario a duration, or lengthen control.period"
            )
        return whole_periods(duration, params.control.period)

    def longest(self, params: Params) -> int:
        """Return the length in control periods of the longest episode: that of the slowest path."""
        speed = min(self.speed) if self.speed is not None else params.path.speed
        return self.ticks(params.model_copy(update={"path": params.path.model_copy(update={"speed": speed})}))

    def with_changes(self, **changes: Any) -> Scenario:
        """Return the scenario with other values, which are checked; raises ConfigError."""
        return build(Scenario, self.model_dump() | changes, lambda key: f"scenario {self.name}")

    @property
    def changes_model(self) -> bool:
        """Whether the plant is another one than the controllers believe."""
        return self.plant != PlantFactors()

    @property
    def draws_model(self) -> bool:
        """Whether the plant differs from one episode to the next."""
        return self.plant != PlantFactors(settings=self.plant.settings)

    @property
    def draws_plant(self) -> bool:
        """Whether the plant with its actuators differs from one episode to the next."""
        return self.draws_model or bool(self.faults)

    def hash(self, params: Params) -> str:
        """Return the hash of what defines the episodes of a seed: task, scenario (without its wording), parameters."""
        return suite_hash([self], params)


@kernel
def whole_periods(duration, period):
    """Return how many control periods a time takes, but for rounding."""
    return ceil(duration / period - SLACK)


class EpisodeRange(Section):
    """Which episodes of a scenario are run."""

    episodes: int | None = Field(default=None, ge=1, le=MOST_EPISODES, description="number of episodes of each policy")
    seed: int = Field(default=0, ge=0, le=LARGEST_SEED, description="seed of the first one; the next ones count up")


def load_scenario(name: str | os.PathLike[str]) -> Scenario:
    """Return a shipped scenario by its name, or a user's by its path.

    Raises:
        ConfigError: if there is none of that name (with the nearest one), or its content is not valid.
    """
    return load(Scenario, name, folder="scenarios")


def scenario_names() -> list[str]:
    """Return the names of the shipped scenarios."""
    return sorted(file.stem for file in (config_dir() / "scenarios").glob("*.yaml"))


def suite_hash(scenarios: Iterable[Scenario], params: Params) -> str:
    """Return the :func:`short_hash` of a suite's values: task, scenarios in any order, parameters.

    Comments, the order of keys and the descriptions are no part of it.
    """
    dumped = (scenario.model_dump(mode="json", exclude={"description"}) for scenario in scenarios)
    return short_hash({"task": TASK, "scenarios": sorted(map(canonical_json, dumped)), "params": params.to_dict()})
