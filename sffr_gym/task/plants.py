"""Plants of episodes: what a scenario's draws make of the robot that its controllers believe in.

Drawn in this order, each only if the scenario draws it: factors of object, EI, panel mass, each panel, each link,
piezos and thrusters; whether thrusters are on or off, and how long at least; lags of piezos, thrusters and joints;
steps of piezos, thrust, thruster torque and joints. What was drawn makes the same plant again.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sffr_gym.config.actuator_sections import Actuators
from sffr_gym.config.params import Params
from sffr_gym.config.ranges import LARGEST_CUT
from sffr_gym.config.sections import Arm, Panel, PanelMount
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.task.scenario import Scenario

Drawn = dict[str, float]
_UNITS = {"piezo": "V", "thruster_force": "N", "thruster_torque": "N_m", "joint": "N_m"}  # of steps


def draw_plant(scenario: Scenario, plant: Params, rng: np.random.Generator, drawn: Drawn) -> Params:
    """Return the plant that a scenario's draws, added to ``drawn``, make of one before them.

    Raises:
        ConfigError: if the scenario draws an object that the robot does not have.
    """
    factors = scenario.plant
    if factors.object is not None:
        if plant.object is None:
            raise ConfigError(f"{scenario.name}: plant.object: the robot carries no object")
        drawn["object_factor"] = rng.uniform(*factors.object)
    if factors.EI is not None:
        drawn["EI_factor"] = rng.uniform(*factors.EI)
    if factors.panel_mass is not None:
        drawn["panel_mass_factor"] = rng.uniform(*factors.panel_mass)
    for mount in plant.panel.mounts:
        for key, ends in factors.each_panel.drawn().items():
            drawn[_panel_factor(mount, key)] = rng.uniform(*ends)
    if factors.link_mass is not None:
        for arm in plant.arms:
            drawn |= {_link_factor(arm, k): rng.uniform(*factors.link_mass) for k in range(len(arm.links))}
    if factors.piezo is not None:
        drawn["piezo_factor"] = rng.uniform(*factors.piezo)
    if factors.thruster is not None:
        drawn["thruster_factor"] = rng.uniform(*factors.thruster)
    if factors.on_off is not None:
        drawn["thrusters_on_off"] = float(rng.uniform() < factors.on_off)
    if factors.minimum_on_time is not None:
        drawn["minimum_on_time_s"] = rng.uniform(*factors.minimum_on_time)
    drawn |= {f"{name}_lag_s": rng.uniform(*ends) for name, ends in factors.lag.drawn().items()}
    for name, ends in factors.quantisation.drawn().items():
        drawn[f"{name}_step_{_UNITS[name]}"] = rng.uniform(*ends)
    return _scaled(plant, drawn)


class _End(np.random.Generator):
    """Random numbers that lie at one end of their interval: the lower at 0, the upper at 1."""

    end = 0

    def uniform(self, low: Any = 0.0, high: Any = 1.0, size: Any = None) -> Any:
        """Return the end."""
        return high if self.end else low


def extreme_plants(scenario: Scenario, plant: Params) -> list[Params]:
    """Return the plants that a scenario draws if all that is drawn lies at its lower end, or all at its upper one."""
    plants = []
    for end in (0, 1):
        rng = _End(np.random.PCG64(0))
        rng.end = end
        plants.append(draw_plant(scenario, plant, rng, {}))
    return plants


def drawn_plant(params: Params, drawn: Drawn) -> Params:
    """Return the plant of an episode, made again of what it is before anything is drawn, and what was drawn.

    Raises:
        ValueError: for a factor or speed that no scenario draws.
    """
    for name, value in drawn.items():
        if name.endswith(("_factor", "_speed_m_s")) and not 1.0e-3 < value < 1.0e3:
            raise ValueError(f"drawn: {name} = {value}: no scenario draws that")
    return _scaled(at_speed(params, drawn), drawn)


def at_speed(params: Params, drawn: Drawn) -> Params:
    """Return the parameters with the path speed that was drawn."""
    speed = drawn.get("path_speed_m_s", params.path.speed)
    return params.model_copy(update={"path": params.path.model_copy(update={"speed": speed})})


def _scaled(prior: Params, drawn: Drawn) -> Params:
    """Return the plant that drawn factors make of one before them."""
    changes: dict[str, Any] = {"panel": _scaled_panel(prior.panel, drawn)}
    changes["actuators"] = _scaled_actuators(prior.actuators, drawn)
    changes["arms"] = tuple(_scaled_arm(arm, drawn) for arm in prior.arms)
    if prior.object is not None:
        factor = drawn.get("object_factor", 1.0)
        scaled = {"mass": factor * prior.object.mass, "inertia": factor * prior.object.inertia}
        changes["object"] = prior.object.model_copy(update=scaled)
    return prior.model_copy(update=changes)


def _scaled_panel(panel: Panel, drawn: Drawn) -> Panel:
    """Return the panels with drawn stiffness and mass.

    What was drawn of a panel by itself becomes its mount's.

    The mode cuts go with the clamped frequencies, bending ones by ``sqrt(EI / mass)`` and axial ones by
    ``sqrt(1 / mass)``, so that every plant has the modes of the prior.
    """
    stiffness, mass = drawn.get("EI_factor", 1.0), drawn.get("panel_mass_factor", 1.0)
    scaled = {
        "EI": stiffness * panel.EI,
        "mass": mass * panel.mass,
        "bending_cut": min(np.sqrt(stiffness / mass) * panel.bending_cut, LARGEST_CUT),
        "axial_cut": min(np.sqrt(1.0 / mass) * panel.axial_cut, LARGEST_CUT),
    }
    changes: dict[str, Any] = {name: float(value) for name, value in scaled.items()}
    common = {"EI": stiffness, "mass": mass, "length": 1.0}
    changes["mounts"] = tuple(_scaled_mount(panel, mount, common, drawn) for mount in panel.mounts)
    return panel.model_copy(update=changes)


def _scaled_mount(panel: Panel, mount: PanelMount, common: dict[str, float], drawn: Drawn) -> PanelMount:
    """Return a mount with what its panel has of its own, once common factors and those drawn for it have acted."""
    own = {}
    for key, factor in common.items():
        drawn_factor = drawn.get(_panel_factor(mount, key))
        if drawn_factor is not None:
            before = mount.own.get(key, getattr(panel, key))
            own[key] = factor * drawn_factor * before
        elif key in mount.own:
            own[key] = factor * mount.own[key]
    return mount.model_copy(update=own) if own else mount


def _scaled_actuators(actuators: Actuators, drawn: Drawn) -> Actuators:
    """Return the actuators with what was drawn of their authority, limits, kind, lags and steps."""
    force, thrust = drawn.get("piezo_factor", 1.0), drawn.get("thruster_factor", 1.0)
    piezo = {"force": force * actuators.piezo.force, "moment": force * actuators.piezo.moment}
    limits = {
        "thruster_force": thrust * actuators.thruster_force,
        "thruster_torque": thrust * actuators.thruster_torque,
    }
    modulator, lag, steps = actuators.modulator, actuators.lag, actuators.quantisation
    kind = {1.0: "on-off", 0.0: "continuous"}.get(drawn.get("thrusters_on_off", np.nan), actuators.thrusters)
    on_time = {"minimum_on_time": drawn.get("minimum_on_time_s", modulator.minimum_on_time)}
    lags = {name: drawn.get(f"{name}_lag_s", getattr(lag, name)) for name in type(lag).model_fields}
    quanta = {name: drawn.get(f"{name}_step_{unit}", getattr(steps, name)) for name, unit in _UNITS.items()}
    return actuators.model_copy(
        update={
            "piezo": actuators.piezo.model_copy(update=piezo), **limits, "thrusters": kind,
            "modulator": modulator.model_copy(update=on_time), "lag": lag.model_copy(update=lags),
            "quantisation": steps.model_copy(update=quanta),
        }
    )  # fmt: skip


def _scaled_arm(arm: Arm, drawn: Drawn) -> Arm:
    """Return an arm whose links have drawn masses, and inertias to match."""
    links = []
    for k, link in enumerate(arm.links):
        factor = drawn.get(_link_factor(arm, k), 1.0)
        links.append(link.model_copy(update={"mass": factor * link.mass, "inertia": factor * link.inertia}))
    return arm.model_copy(update={"links": tuple(links)})


def _panel_factor(mount: PanelMount, key: str) -> str:
    """Return the name of the factor that is drawn of a panel's mass, length or EI."""
    return f"{mount.name}_panel_{key}_factor"


def _link_factor(arm: Arm, k: int) -> str:
    """Return the name of the factor that is drawn of a link's mass."""
    return f"{arm.name}_link{k + 1}_mass_factor"
