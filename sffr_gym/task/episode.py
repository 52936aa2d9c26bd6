"""Episodes: one draw of a scenario, with its plant, start, reference, sensors, faults and impulses.

All random numbers come from one generator, in this order, each only if the scenario draws it: path speed; phase;
what of the plant is drawn (``plants``); each panel's modes (amplitude, phase);
offset (distance, direction, angle); fault, and the panel that has it; impulse by impulse its time, size, direction and
moment; delay; the key of the noise; steps of the sensors by unit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sffr_gym.config.params import Params
from sffr_gym.config.path import Path
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.physics.actuators import Actuators
from sffr_gym.physics.beam import N_TIP
from sffr_gym.physics.initial import initial_positions, match_velocities
from sffr_gym.physics.kinematics import perpendicular, rotation
from sffr_gym.physics.model import N_BASE, Model, mode_slice, object_slice, pack
from sffr_gym.task.disturbances import KEYS, Impulses, Sensing
from sffr_gym.task.observation import Field, observation_fields
from sffr_gym.task.path_range import check_path
from sffr_gym.task.plants import Drawn, at_speed, draw_plant
from sffr_gym.task.quasi_static import quasi_static_amplitudes
from sffr_gym.task.reference import Reference, desired, on_circle, path_reference
from sffr_gym.task.scenario import ImpulseDraws, Scenario, Sensors
from sffr_gym.types import Array

_KINDS = {"m": "position", "rad": "angle", "m/s": "velocity", "rad/s": "rate"}  # key of Sensors by unit
_SUFFIXES = {"position": "m", "angle": "rad", "velocity": "m_s", "rate": "rad_s"}  # of names of what is drawn


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
    p, v = initial_positions(plant, model)
    check_path(params, path_reference(params, model, p))
    return Nominal(params, plant, model, p, v, observation_fields(model, params))


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
    if scenario.random_phase and prior.path.closed:
        drawn["path_phase_rad"] = phase = rng.uniform(0.0, 2.0 * np.pi)
    plant = prior
    if known.plant is not known.params:
        plant = known.plant if scenario.speed is None else at_speed(known.plant, drawn)
    model, p, v = known.model, known.p.copy(), known.v.copy()
    if scenario.draws_model:
        plant = draw_plant(scenario, plant, rng, drawn)
        model = pack(plant)
        if (model.at, model.n_axial) != (known.model.at, known.model.n_axial):  # by rounding, of a cut on a frequency
            raise ConfigError(
                f"{scenario.name}: plant: a drawn plant has other modes; move panel.bending_cut or axial_cut"
            )
        p, v = initial_positions(plant, model)
    reference = path_reference(prior, model, p, phase=phase)
    _match_path(known.params.path, prior.path, reference, model, p, v)
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


def noise_level(sensors: Sensors, fields: dict[str, Field]) -> Array:
    """Return the standard deviation (n_o,) of each number of the observation by its unit; the reference has none."""
    return _by_unit({kind: getattr(sensors, kind) for kind in _KINDS.values()}, fields)


def _by_unit(values: dict[str, float], fields: dict[str, Field]) -> Array:
    """Return a value (n_o,) for each measured number of the observation, by the kind of its unit; 0 for the others."""
    if not any(values.values()):  # most scenarios, and looking at every number would take half of a draw
        return np.zeros(sum(field.size for field in fields.values()))
    level = {unit: values[kind] for unit, kind in _KINDS.items()}
    return np.array([level[unit] if each.measured else 0.0 for each in fields.values() for unit in each.units])


def _draw_speed(scenario: Scenario, params: Params, rng: np.random.Generator, drawn: Drawn) -> Params:
    """Return the parameters with the drawn path speed."""
    if scenario.speed is None:
        return params
    if params.path.arrival is not None:
        raise ConfigError(
            f"{scenario.name}: speed: a {params.path.kind} has path.time, which `robot` can set, no speed"
        )
    drawn["path_speed_m_s"] = rng.uniform(*scenario.speed)
    return at_speed(params, drawn)


def _match_path(before: Path, after: Path, reference: Reference, model: Model, p: Array, v: Array) -> None:
    """Turn the velocity with which a path begins into that of another speed and phase, in place.

    Robot and object move as one, with the path's heading.
    """
    if before.speed == after.speed and reference.phase == 0.0:
        return
    start, from_object = before.start, np.array([reference.base_x, reference.base_y])
    if on_circle(reference):
        turn = reference.turning * (after.speed - before.speed) / reference.radius
        along = after.speed * np.array([np.cos(reference.phase), np.sin(reference.phase)])
    else:
        motion = desired(reference, 0.0)
        turn, along = motion.turn - start[2], np.array([motion.xd, motion.yd])
    change = along - np.array(start[:2])
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
    at = mode_slice(model)
    shape, rate = quasi_static_amplitudes(model, reference, np.zeros(1))
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
    """Draw whether an episode measures late, the key of its noise, and the steps of its sensors."""
    delay, key, level = 0, 0, noise_level(sensors, fields)
    if sensors.delay > 0.0:
        delay = int(rng.uniform() < sensors.delay)
        drawn["delay_periods"] = float(delay)
    if level.any():
        key = int(rng.integers(1, KEYS))
        drawn["noise_key"] = float(key)
    steps = dict.fromkeys(_KINDS.values(), 0.0)
    for kind, ends in sensors.quantisation.drawn().items():
        steps[kind] = drawn[f"{kind}_step_{_SUFFIXES[kind]}"] = rng.uniform(*ends)
    return Sensing(level, key, delay, _by_unit(steps, fields), int(any(steps.values())))
