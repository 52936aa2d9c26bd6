"""Scenarios: named distributions of episodes, read from YAML (``configs/scenarios``) and drawn with a seed."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from sffr_gym import config
from sffr_gym.beam import N_TIP, Array
from sffr_gym.initial import initial_positions, match_velocities
from sffr_gym.kinematics import rotation
from sffr_gym.model import N_BASE, Model, mode_slice, object_slice
from sffr_gym.params import ConfigError, Params
from sffr_gym.reference import Reference, circle_reference
from sffr_gym.sections import Section

Interval = Annotated[tuple[float, float], Field(description="lower and upper end of a uniform distribution")]


class PanelMode(Section):
    """Excitation of one bending mode of every panel, drawn for each panel alone."""

    mode: int = Field(ge=1, description="bending mode, 1 is the lowest")
    amplitude: Interval = Field(description="transverse tip amplitude [m]")


class Scenario(Section):
    """A distribution of episodes.

    ``offset_position`` and ``offset_angle`` are the largest shift of robot and object as one from the path, uniform
    over a disc and an interval. ``panel_modes`` replaces the configured elastic state by free vibration of any phase.
    """

    name: str = Field(description="name of the scenario")
    description: str = Field(description="what it draws")
    duration: float | None = Field(default=None, gt=0.0, description="length of an episode [s]; null: once around")
    panel_modes: tuple[PanelMode, ...] = Field(default=(), description="excited bending modes")
    offset_position: float = Field(default=0.0, ge=0.0, le=1.0, description="largest shift off the path [m]")
    offset_angle: float = Field(default=0.0, ge=0.0, le=1.0, description="largest turn off the path [rad]")

    @model_validator(mode="after")
    def _ordered(self) -> Scenario:
        for excited in self.panel_modes:
            low, high = excited.amplitude
            if not 0.0 <= low <= high:
                raise ValueError(f"amplitude must be 0 <= lower <= upper [m], got {[low, high]}")
        return self

    def ticks(self, params: Params) -> int:
        """Length of an episode in control periods."""
        duration = params.path.period if self.duration is None else self.duration
        return int(np.ceil(duration / params.control.period - 1e-9))


class Episode(NamedTuple):
    """One draw of a scenario.

    Attributes:
        p, v: (n,) positions and velocities at the start.
        reference: the desired motion.
        drawn: the values that were drawn, by name with unit.
    """

    p: Array
    v: Array
    reference: Reference
    drawn: dict[str, float]


def load_scenario(name: str | os.PathLike[str]) -> Scenario:
    """Load a shipped scenario by its name, or a user's by its path.

    Raises:
        ConfigError: if there is none of that name (with the nearest one), or its content is not valid.
    """
    data, where = config.read_mapping(config.find_config(name, folder="scenarios"))
    return config.build(Scenario, data, where)


def draw(scenario: Scenario, params: Params, model: Model, rng: np.random.Generator) -> Episode:
    """Draw an episode; the same generator state gives the same episode.

    Raises:
        ConfigError: if the scenario excites a mode that the panels do not have.
    """
    p, v = initial_positions(params, model)
    reference = circle_reference(params, model, p)
    drawn: dict[str, float] = {}
    if scenario.panel_modes:
        _excite(scenario, model, p, v, rng, drawn)
    _offset(scenario, model, p, v, rng, drawn)
    return Episode(p, v, reference, drawn)


def _excite(
    scenario: Scenario, model: Model, p: Array, v: Array, rng: np.random.Generator, drawn: dict[str, float]
) -> None:
    """Set every panel to free vibration in the drawn modes, in place."""
    at, shape = mode_slice(model), model.omega2.shape
    amplitudes, rates = np.zeros(shape), np.zeros(shape)
    for panel in range(shape[0]):
        for excited in scenario.panel_modes:
            mode = model.n_axial + excited.mode - 1
            if mode >= shape[1]:
                raise ConfigError(
                    f"{scenario.name}: panel_modes: mode {excited.mode} is not there; the panels have "
                    f"{shape[1] - model.n_axial} bending modes (panel.elements, panel.bending_cut)"
                )
            tip, phase = rng.uniform(*excited.amplitude), rng.uniform(0.0, 2.0 * np.pi)
            amplitude = tip / model.shapes[panel, -N_TIP + 1, mode]
            amplitudes[panel, mode] = amplitude * np.cos(phase)
            rates[panel, mode] = -amplitude * np.sqrt(model.omega2[panel, mode]) * np.sin(phase)
            drawn[f"panel{panel}_mode{excited.mode}_tip_m"] = tip
            drawn[f"panel{panel}_mode{excited.mode}_phase_rad"] = phase
    p[at], v[at] = amplitudes.ravel(), rates.ravel()


def _offset(
    scenario: Scenario, model: Model, p: Array, v: Array, rng: np.random.Generator, drawn: dict[str, float]
) -> None:
    """Shift and turn robot and object as one about the object, in place; the base keeps its velocity."""
    if scenario.offset_position == 0.0 and scenario.offset_angle == 0.0:
        return
    distance = scenario.offset_position * np.sqrt(rng.uniform())
    direction, angle = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-1.0, 1.0) * scenario.offset_angle
    drawn |= {"offset_m": distance, "offset_direction_rad": direction, "offset_angle_rad": angle}
    carried = object_slice(model) if model.object_mass > 0 else slice(0, N_BASE)
    pivot = p[carried][:2].copy()
    shift = distance * np.array([np.cos(direction), np.sin(direction)])
    p[:2] = pivot + shift + rotation(angle) @ (p[:2] - pivot)
    p[2] += angle
    if model.object_mass > 0:
        p[carried] += np.append(shift, angle)
        match_velocities(model, p, v)


def scenario_names() -> list[str]:
    """Names of the shipped scenarios."""
    return sorted(file.stem for file in (config.config_dir() / "scenarios").glob("*.yaml"))


def suite_hash(scenarios: Iterable[Scenario], params: Params) -> str:
    """First 16 hexadecimal digits of the SHA-256 of a suite's values: task, scenarios in any order, parameters.

    Comments, the order of keys and the descriptions are no part of it.
    """
    values = {
        "scenarios": sorted(
            json.dumps(scenario.model_dump(mode="json", exclude={"description"}), sort_keys=True)
            for scenario in scenarios
        ),
        "params": params.to_dict(),
    }
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]
