"""Scenarios: named distributions of episodes, read from YAML (``configs/scenarios``); ``episode.py`` draws from them.

Every key stands for one drawn quantity or a group of them, in SI units; what a file leaves out is not drawn.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from math import ceil, inf
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from sffr_gym.config.files import canonical_json, short_hash
from sffr_gym.config.params import Params
from sffr_gym.config.sections import NonNegative, Section
from sffr_gym.config.strict_yaml import check_error, config_dir, load

EVALUATION_SEED = 1_000_000  # seeds from here up are for evaluation alone: training rejects them
TASK = "SFFRFlex-v0"  # whose observation, reward and ends an episode has; a part of every hash
MOST_IMPULSES = 8  # of an episode


def _within(least: float, most: float) -> AfterValidator:
    """Return a check that an interval is ordered and lies in a range."""
    allowed = f"{least:g} <= lower <= upper" + (f" <= {most:g}" if most < inf else "")

    def check(ends: tuple[float, float]) -> tuple[float, float]:
        if not least <= ends[0] <= ends[1] <= most:
            raise check_error(f"must be the ends of a uniform distribution, {allowed}")
        return ends

    return AfterValidator(check)


Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Amplitude = Annotated[tuple[float, float], _within(0.0, inf)]
Speed = Annotated[tuple[float, float], _within(0.01, 10.0)]  # m/s
Factor = Annotated[tuple[float, float], _within(0.01, 100.0)]


class PanelMode(Section):
    """Excitation of one bending mode of every panel, drawn for each panel separately."""

    mode: int = Field(ge=1, description="bending mode, 1 is the lowest")
    amplitude: Amplitude = Field(description="transverse tip amplitude [m]")


class PlantFactors(Section):
    """What the plant is, as factors on what the controllers believe."""

    object: Factor | None = Field(default=None, description="mass and inertia of the object, one factor for both [-]")
    EI: Factor | None = Field(default=None, description="bending stiffness of the panels [-]")
    panel_mass: Factor | None = Field(default=None, description="mass of the panels [-]")
    link_mass: Factor | None = Field(default=None, description="mass and inertia of each link, drawn for each [-]")


class Sensors(Section):
    """Errors of the measured fields of the observation: white noise by unit, and a delay of one control period."""

    position: NonNegative = Field(default=0.0, description="noise of positions and displacements, rms [m]")
    angle: NonNegative = Field(default=0.0, description="noise of angles and slopes, rms [rad]")
    velocity: NonNegative = Field(default=0.0, description="noise of velocities, rms [m/s]")
    rate: NonNegative = Field(default=0.0, description="noise of angular rates, rms [rad/s]")
    delay: Probability = Field(default=0.0, description="part of the episodes that measure one period late [-]")


class Fault(Section):
    """Actuators that have lost a part of their limit, unknown to the controllers."""

    actuators: Literal["piezo", "thruster", "joint"] = Field(
        description="piezos of one drawn panel, all thrusters, or all joints [-]"
    )
    remaining: Probability = Field(description="part of the limit that is left; 0 is dead [-]")


class ImpulseDraws(Section):
    """Impulses on the base, each spread over one control period at a random time; base axes."""

    count: int = Field(ge=1, le=MOST_IMPULSES, description="number of impulses in an episode [-]")
    linear: NonNegative = Field(description="largest impulse of the force, any direction [N s]")
    angular: NonNegative = Field(description="largest impulse of the moment, either sign [N m s]")


class Scenario(Section):
    """A distribution of episodes.

    ``offset_position`` and ``offset_angle`` are the largest shift of robot and object as one from the path, uniform
    over a disc and an interval. ``panel_modes`` replaces the configured elastic state by free vibration of any phase.
    With a drawn ``speed`` the robot starts as fast as the path. ``random_phase`` starts anywhere on it, and adds the
    shape that the path's acceleration gives a panel there, so that what is drawn is the motion about it. ``plant`` and
    ``faults`` change the plant alone: the controllers go on with the parameters of the case study.
    """

    name: str = Field(description="name of the scenario")
    description: str = Field(description="what it draws")
    duration: float | None = Field(default=None, gt=0.0, description="length of an episode [s]; null: once around")
    panel_modes: tuple[PanelMode, ...] = Field(default=(), description="excited bending modes")
    offset_position: float = Field(default=0.0, ge=0.0, le=1.0, description="largest shift off the path [m]")
    offset_angle: float = Field(default=0.0, ge=0.0, le=1.0, description="largest turn off the path [rad]")
    speed: Speed | None = Field(default=None, description="speed along the path [m/s]")
    random_phase: bool = Field(default=False, description="start anywhere on the circle")
    plant: PlantFactors = Field(default=PlantFactors(), description="what the controllers are wrong about")
    sensors: Sensors = Field(default=Sensors(), description="errors of the observation")
    faults: tuple[Fault, ...] = Field(default=(), description="faults, of which each episode has one")
    impulses: ImpulseDraws | None = Field(default=None, description="impulses on the base")

    def ticks(self, params: Params) -> int:
        """Return the length in control periods of an episode with these parameters, the drawn speed among them."""
        duration = params.path.period if self.duration is None else self.duration
        return ceil(duration / params.control.period - 1e-9)

    @property
    def changes_model(self) -> bool:
        """Whether the plant is another one than the controllers believe."""
        return self.plant != PlantFactors()

    @property
    def changes_plant(self) -> bool:
        """Whether the plant with its actuators is another one than the controllers believe."""
        return self.changes_model or bool(self.faults)

    def hash(self, params: Params) -> str:
        """Return the hash of what defines the episodes of a seed: task, scenario (without its wording), parameters."""
        return suite_hash([self], params)


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
