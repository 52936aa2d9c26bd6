"""Episodes: one draw of a scenario, with its plant, start, reference, sensors, faults and impulses.

All random numbers come from one generator, in this order, each only if the scenario draws it: path speed; phase;
factors of object, EI, panel mass, the links one by one, piezos and thrusters; each panel's modes (amplitude, phase);
offset (distance, direction, angle); fault, and the panel that has it; impulse by impulse its time, size, direction and
moment; delay; the key of the noise.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from sffr_gym.config.params import Params
from sffr_gym.config.ranges import LARGEST_CUT
from sffr_gym.config.sections import Actuators as ActuatorSection
from sffr_gym.config.sections import Arm, Panel
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.physics.actuators import Actuators
from sffr_gym.physics.beam import N_TIP
from sffr_gym.physics.initial import initial_positions, match_velocities
from sffr_gym.physics.kinematics import perpendicular, rotation
from sffr_gym.physics.model import N_BASE, Model, mode_slice, object_slice, pack
from sffr_gym.task.disturbances import KEYS, Impulses, Sensing
from sffr_gym.task.observation import Field, observation_fields
from sffr_gym.task.quasi_static import quasi_static_amplitudes
from sffr_gym.task.reference import Reference, circle_reference, desired
from sffr_gym.task.scenario import ImpulseDraws, Scenario, Sensors
from sffr_gym.types import Array

Drawn = dict[str, float]
_KINDS = {"m": "position", "rad": "angle", "m/s": "velocity", "rad/s": "rate"}  # key of Sensors by unit


class Health(NamedTuple):
    """Parts of their limits that faults leave to each panel's piezos (n_p,), the thrusters and the joints [-]."""

    piezo: Array
    thruster: float
    joint: float

    def left(self, actuators: Actuators) -> Array:
        """Return the part (n_u,) of each actuator's limit that is left, laid out as a command is."""
        n_p, _, n_c = actuators.K_PZ.shape
        n_joints = len(actuators.limit) - n_p * n_c - N_BASE
        return np.concatenate([np.repeat(self.piezo, n_c), [self.thruster] * N_BASE, [self.joint] * n_joints])


class Episode(NamedTuple):
    """One draw of a scenario."""

    p: Array  #: (n,) positions and velocities of the plant at the start
    v: Array  #: (n,)
    reference: Reference  #: the desired motion, which all know
    plant: Params  #: the robot as it is
    prior: Params  #: the robot as the controllers believe it to be, with the drawn path speed
    ticks: int  #: length in control periods
    health: Health  #: what is left of the actuators' limits
    impulses: Impulses  #: on the base
    sensing: Sensing  #: errors of the observation
    drawn: Drawn  #: the values that were drawn, by name with unit; the same names in every draw of a scenario


class Nominal(NamedTuple):
    """What every draw begins from, computed once since it would take the longest part of a draw."""

    params: Params  #: what the controllers believe
    plant: Params  #: the robot as it is, before anything is drawn; the same object if that is what they believe
    model: Model  #: the plant, packed
    p: Array  #: (n,) its positions and velocities at the undisturbed start
    v: Array  #: (n,)
    fields: dict[str, Field]  #: layout of the observation


def nominal(params: Params, scenario: Scenario | None = None) -> Nominal:
    """Return the robot that the controllers believe in and the scenario's plant, at its start.

    Raises:
        ConfigError: if the end-effectors cannot reach the grasp points from the given joint angles, or for settings of
            the plant that are not valid.
    """
    plant = params if scenario is None else scenario.plant_of(params)
    model = pack(plant)
    return Nominal(params, plant, model, *initial_positions(plant, model), observation_fields(model, params))


def draw(scenario: Scenario, known: Nominal, rng: np.random.Generator) -> Episode:
    """Draw an episode; the same generator state gives the same episode.

    Args:
        scenario: what to draw.
        known: what the controllers believe.
        rng: the only source of random numbers.

    Raises:
        ConfigError: if the scenario asks for a mode, an object or a panel that the robot does not have.
        ValueError: for a scenario whose plant is not that of ``known``.
    """
    if scenario.plant.settings and known.plant is known.params:
        raise ValueError(f"scenario {scenario.name}: has a plant of its own: draw from nominal(params, scenario)")
    drawn: Drawn = {}
    prior = _draw_speed(scenario, known.params, rng, drawn)
    phase = 0.0  # angle on the circle at the start [rad]
    if scenario.random_phase:
        drawn["path_phase_rad"] = phase = rng.uniform(0.0, 2.0 * np.pi)
    plant = _draw_plant(scenario, prior, known, rng, drawn)
    model, p, v = known.model, known.p.copy(), known.v.copy()
    if scenario.draws_model:
        model = pack(plant)
        if (model.at, model.n_axial) != (known.model.at, known.model.n_axial):  # by rounding, of a cut on a frequency
            raise ConfigError(
                f"{scenario.name}: plant: a drawn plant has other modes; move panel.bending_cut or axial_cut"
            )
        p, v = initial_positions(plant, model)
    reference = circle_reference(prior, model, p, phase=phase)
    _match_path_speed(known.params.path.speed, prior.path.speed, reference, model, p, v)
    if scenario.panel_modes:
        _excite(scenario, model, p, v, rng, drawn)
    if scenario.random_phase:
        _add_quasi_static_shape(reference, model, p, v)
    _offset(scenario, model, p, v, rng, drawn)
    ticks = scenario.ticks(prior)
    health = _draw_fault(scenario, len(model.panel_root), rng, drawn)
    impulses = _draw_impulses(scenario.impulses, ticks, prior.control.period, rng, drawn)
    sensing = _draw_sensing(scenario.sensors, known.fields, rng, drawn)
    return Episode(p, v, reference, plant, prior, ticks, health, impulses, sensing, drawn)


def drawn_plant(params: Params, drawn: Drawn) -> Params:
    """Return the plant of an episode, made again of what it is before anything is drawn, and what was drawn.

    Raises:
        ValueError: for a factor or speed that no scenario draws.
    """
    for name, value in drawn.items():
        if name.endswith(("_factor", "_speed_m_s")) and not 1.0e-3 < value < 1.0e3:
            raise ValueError(f"drawn: {name} = {value}: no scenario draws that")
    return _scaled(_at_speed(params, drawn), drawn)


def noise_level(sensors: Sensors, fields: dict[str, Field]) -> Array:
    """Return the standard deviation (n_o,) of each number of the observation by its unit; the reference has none."""
    level = {unit: getattr(sensors, kind) for unit, kind in _KINDS.items()}
    if not any(level.values()):  # most scenarios, and looking at every number would take half of a draw
        return np.zeros(sum(field.size for field in fields.values()))
    return np.array([level[unit] if each.measured else 0.0 for each in fields.values() for unit in each.units])


def _draw_speed(scenario: Scenario, params: Params, rng: np.random.Generator, drawn: Drawn) -> Params:
    """Return the parameters with the drawn path speed."""
    if scenario.speed is None:
        return params
    drawn["path_speed_m_s"] = rng.uniform(*scenario.speed)
    return _at_speed(params, drawn)


def _at_speed(params: Params, drawn: Drawn) -> Params:
    """Return the parameters with the path speed that was drawn."""
    speed = drawn.get("path_speed_m_s", params.path.speed)
    return params.model_copy(update={"path": params.path.model_copy(update={"speed": speed})})


def _draw_plant(scenario: Scenario, prior: Params, known: Nominal, rng: np.random.Generator, drawn: Drawn) -> Params:
    """Return the plant that drawn factors make of the scenario's; the very object if none is drawn."""
    plant = prior
    if known.plant is not known.params:
        plant = known.plant if scenario.speed is None else _at_speed(known.plant, drawn)
    if not scenario.draws_model:
        return plant
    factors = scenario.plant
    if factors.object is not None:
        if prior.object is None:
            raise ConfigError(f"{scenario.name}: plant.object: the robot carries no object")
        drawn["object_factor"] = rng.uniform(*factors.object)
    if factors.EI is not None:
        drawn["EI_factor"] = rng.uniform(*factors.EI)
    if factors.panel_mass is not None:
        drawn["panel_mass_factor"] = rng.uniform(*factors.panel_mass)
    if factors.link_mass is not None:
        for arm in prior.arms:
            drawn |= {_link_factor(arm, k): rng.uniform(*factors.link_mass) for k in range(len(arm.links))}
    if factors.piezo is not None:
        drawn["piezo_factor"] = rng.uniform(*factors.piezo)
    if factors.thruster is not None:
        drawn["thruster_factor"] = rng.uniform(*factors.thruster)
    return _scaled(plant, drawn)


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
    return panel.model_copy(update={name: float(value) for name, value in scaled.items()})


def _scaled_actuators(actuators: ActuatorSection, drawn: Drawn) -> ActuatorSection:
    """Return the actuators with drawn authority of the piezos and limits of the thrusters."""
    force, thrust = drawn.get("piezo_factor", 1.0), drawn.get("thruster_factor", 1.0)
    piezo = {"force": force * actuators.piezo.force, "moment": force * actuators.piezo.moment}
    limits = {
        "thruster_force": thrust * actuators.thruster_force,
        "thruster_torque": thrust * actuators.thruster_torque,
    }
    return actuators.model_copy(update={"piezo": actuators.piezo.model_copy(update=piezo), **limits})


def _scaled_arm(arm: Arm, drawn: Drawn) -> Arm:
    """Return an arm whose links have drawn masses, and inertias to match."""
    links = []
    for k, link in enumerate(arm.links):
        factor = drawn.get(_link_factor(arm, k), 1.0)
        links.append(link.model_copy(update={"mass": factor * link.mass, "inertia": factor * link.inertia}))
    return arm.model_copy(update={"links": tuple(links)})


def _link_factor(arm: Arm, k: int) -> str:
    """Return the name of the factor that is drawn of a link's mass."""
    return f"{arm.name}_link{k + 1}_mass_factor"


def _match_path_speed(before: float, after: float, reference: Reference, model: Model, p: Array, v: Array) -> None:
    """Turn the velocity along x, of speed ``before`` [m/s], into that along the path, ``after`` [m/s], in place.

    Robot and object move as one, with the path's heading.
    """
    if before == after and reference.phase == 0.0:
        return
    turn = reference.turning * (after - before) / reference.radius
    from_object = np.array([reference.base_x, reference.base_y])
    change = after * np.array([np.cos(reference.phase), np.sin(reference.phase)]) - np.array([before, 0.0])
    v[:2] += change + turn * perpendicular(from_object)
    v[2] += turn
    if model.object_mass > 0:
        match_velocities(model, p, v)


def _excite(scenario: Scenario, model: Model, p: Array, v: Array, rng: np.random.Generator, drawn: Drawn) -> None:
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


def _add_quasi_static_shape(reference: Reference, model: Model, p: Array, v: Array) -> None:
    """Add to every panel its quasi-static shape under the path's acceleration, and the rate of it, in place."""
    start, at = desired(reference, 0.0), mode_slice(model)
    shape, rate = quasi_static_amplitudes(model, reference, np.array([[start.xdd, start.ydd]]))
    p[at] += shape.ravel()
    v[at] += rate.ravel()


def _offset(scenario: Scenario, model: Model, p: Array, v: Array, rng: np.random.Generator, drawn: Drawn) -> None:
    """Shift and turn robot and object as one about the object, in place; the base keeps its velocity."""
    if scenario.offset_position == 0.0 and scenario.offset_angle == 0.0:
        return
    distance = float(scenario.offset_position * np.sqrt(rng.uniform()))
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


def _draw_fault(scenario: Scenario, n_panels: int, rng: np.random.Generator, drawn: Drawn) -> Health:
    """Draw one of the scenario's faults, and return what it leaves."""
    piezo, others = np.ones(n_panels), {"thruster": 1.0, "joint": 1.0}
    if scenario.faults:
        fault = scenario.faults[rng.integers(len(scenario.faults))]
        if fault.actuators == "piezo":
            if n_panels == 0:
                raise ConfigError(f"{scenario.name}: faults: the robot has no panel whose piezos could fail")
            piezo[rng.integers(n_panels)] = fault.remaining
        else:
            others[fault.actuators] = fault.remaining
        drawn |= {f"panel{i}_piezo_left": left for i, left in enumerate(piezo.tolist())}
        drawn |= {f"{name}_left": left for name, left in others.items()}
    return Health(piezo, **others)


def _draw_impulses(
    asked: ImpulseDraws | None, ticks: int, period: float, rng: np.random.Generator, drawn: Drawn
) -> Impulses:
    """Draw time, size, direction and moment of each impulse."""
    count = asked.count if asked else 0
    drawn_at, impulse = np.zeros(count, dtype=np.int64), np.zeros((count, 3))
    if asked is None:
        return Impulses(drawn_at, impulse)
    for k in range(count):
        drawn_at[k] = rng.integers(ticks)
        size, direction = rng.uniform(0.0, asked.linear), rng.uniform(0.0, 2.0 * np.pi)
        impulse[k] = size * np.cos(direction), size * np.sin(direction), rng.uniform(-1.0, 1.0) * asked.angular
        values = (float(drawn_at[k] * period), *impulse[k].tolist())
        names = ("time_s", "x_N_s", "y_N_s", "moment_N_m_s")
        drawn |= {f"impulse{k}_{name}": value for name, value in zip(names, values, strict=True)}
    return Impulses(drawn_at, impulse)


def _draw_sensing(sensors: Sensors, fields: dict[str, Field], rng: np.random.Generator, drawn: Drawn) -> Sensing:
    """Draw whether an episode measures late, and the key of its noise."""
    delay, key, level = 0, 0, noise_level(sensors, fields)
    if sensors.delay > 0.0:
        delay = int(rng.uniform() < sensors.delay)
        drawn["delay_periods"] = float(delay)
    if level.any():
        key = int(rng.integers(1, KEYS))
        drawn["noise_key"] = float(key)
    return Sensing(level, key, delay)
