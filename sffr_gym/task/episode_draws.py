"""What a scenario draws beside the plant, as numbers: how they are distributed, and drawn in order.

An episode takes its random numbers in this order, each only if the scenario draws it: path speed; phase; each panel's
modes (amplitude, phase); offset (distance, direction, angle); impulse by impulse its time, size, direction and moment;
delay; the key of the noise; steps of the sensors by unit. The plant is drawn after the phase and a fault after the
offset, in :mod:`episode`, since they change the robot; :mod:`episode_start` makes an episode of the numbers.
"""

from __future__ import annotations

from math import pi
from typing import NamedTuple

import numpy as np

from sffr_gym.compile.kernels import kernel
from sffr_gym.config.params import Params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.physics.model import Model
from sffr_gym.task.disturbances import KEYS
from sffr_gym.task.observation import Field
from sffr_gym.task.pcg64 import below, uniform
from sffr_gym.task.reference import flat_reference, path_reference
from sffr_gym.task.scenario import Scenario, whole_periods
from sffr_gym.types import Array, IntArray

UNIFORM, TICK, KEY = 0, 1, 2  # kinds of numbers: in an interval, a control period of the episode, a key
UNIT, SIGNED, TURN, WHOLE = (0.0, 1.0), (-1.0, 1.0), (0.0, 2.0 * pi), (0.0, 0.0)  # intervals; none for whole numbers
N_IMPULSE = 4  # numbers drawn for each
KINDS = {"m": "position", "rad": "angle", "m/s": "velocity", "rad/s": "rate"}  # key of Sensors by unit
SUFFIXES = {"position": "m", "angle": "rad", "velocity": "m_s", "rate": "rad_s"}  # of names of what is drawn


class EpisodeDraws(NamedTuple):
    """What all episodes of a scenario have, and how what differs is distributed."""

    kinds: IntArray  #: (k,) of the numbers of an episode, in order
    ends: Array  #: (k, 2) intervals of those that lie in one
    parts: IntArray  #: (2,) places before which the plant is drawn, and a fault
    p: Array  #: (n,) positions and velocities of the undisturbed start
    v: Array  #: (n,)
    reference: Array  #: numbers of its :class:`Reference`, see :func:`reference.flat_reference`
    start: Array  #: (3,) velocity of the path there [m/s, m/s, rad/s]
    speed: float  #: of the path there [m/s]
    reach: float  #: speed of a closed path over the rate of its angle [m]; 0 for another one
    lap: float  #: speed times length of an episode, where that follows a drawn speed [m]; else 0
    ticks: int  #: length of an episode in control periods at the speed there
    period: float  #: control period [s]
    draws_speed: int  #: 1 if that is drawn, else 0
    draws_phase: int  #: likewise
    bends: int  #: 1 if the panels begin with their quasi-static shape, else 0
    modes: IntArray  #: (m,) modes of each panel that are excited
    offset: Array  #: (2,) largest shift and turn off the path [m, rad]; empty if there is none
    moment: Array  #: (i,) largest moment of each impulse [N m s]
    delay: float  #: probability that measurements are late [-]
    level: Array  #: (n_o,) standard deviation of the noise
    noisy: int  #: 1 if any is not 0, else 0
    steps: IntArray  #: (n_o,) which of the drawn steps of sensors each number has; negative for none


def episode_draws(
    scenario: Scenario, params: Params, model: Model, p: Array, v: Array, fields: dict[str, Field]
) -> EpisodeDraws:
    """Return what a scenario draws for a plant.

    Args:
        scenario: what is drawn.
        params: what the controllers believe.
        model: the plant.
        p: (n,) positions of its undisturbed start.
        v: (n,) velocities there.
        fields: layout of the observation.

    Raises:
        ConfigError: for the speed of a path that has none, modes that the panels do not have, or endless episodes.
    """
    path, sensors, steps = params.path, scenario.sensors, scenario.sensors.quantisation.drawn()
    if scenario.speed is not None and path.arrival is not None:
        raise ConfigError(f"{scenario.name}: speed: a {path.kind} has path.time, which `robot` can set, no speed")
    scenario.longest(params)
    noise = {kind: getattr(sensors, kind) for kind in KINDS.values()}
    asked, off = scenario.impulses, scenario.offset_position > 0.0 or scenario.offset_angle > 0.0
    draws = EpisodeDraws(
        kinds=np.zeros(0, dtype=np.int64), ends=np.zeros((0, 2)), parts=np.zeros(2, dtype=np.int64), p=p, v=v,
        reference=flat_reference(path_reference(params, model, p)), start=np.array(path.start), speed=path.speed,
        reach=path.reach if path.closed else 0.0, lap=path.lap if scenario.duration is None else 0.0,
        ticks=scenario.ticks(params), period=params.control.period, draws_speed=int(scenario.speed is not None),
        draws_phase=int(scenario.random_phase and path.closed), bends=int(scenario.random_phase),
        modes=_excited_modes(scenario, model),
        offset=np.array([scenario.offset_position, scenario.offset_angle] if off else []),
        moment=np.full(asked.count, asked.angular) if asked else np.zeros(0), delay=sensors.delay,
        level=_by_unit(noise, fields, 0.0), noisy=int(any(noise.values())),
        steps=_by_unit({kind: float(k) for k, kind in enumerate(steps)}, fields, -1.0).astype(np.int64),
    )  # fmt: skip
    return _with_numbers(draws, scenario, len(model.panel_root))


def _with_numbers(draws: EpisodeDraws, scenario: Scenario, n_p: int) -> EpisodeDraws:
    """Return draws with the kinds and intervals of their numbers."""
    route = [scenario.speed or UNIT] * draws.draws_speed + [TURN] * draws.draws_phase
    state = [ends for mode in scenario.panel_modes for ends in (mode.amplitude, TURN)] * n_p
    state += [UNIT, TURN, SIGNED] * (len(draws.offset) > 0)
    impulses = [] if scenario.impulses is None else [WHOLE, (0.0, scenario.impulses.linear), TURN, SIGNED]
    course = impulses * len(draws.moment) + [UNIT] * (draws.delay > 0.0)
    kinds = np.zeros(len(route) + len(state) + len(course), dtype=np.int64)
    kinds[len(route) + len(state) :][: N_IMPULSE * len(draws.moment) : N_IMPULSE] = TICK
    steps = list(scenario.sensors.quantisation.drawn().values())
    return draws._replace(
        kinds=np.array([*kinds, *[KEY] * draws.noisy, *[UNIFORM] * len(steps)], dtype=np.int64),
        ends=np.array([*route, *state, *course, *[WHOLE] * draws.noisy, *steps]).reshape(-1, 2),
        parts=np.array([len(route), len(route) + len(state)]),
    )


def drawn_names(scenario: Scenario, draws: EpisodeDraws, n_p: int) -> list[str]:
    """Return the names of what an episode's numbers become, in order; see :func:`episode_start.start_episode`."""
    names = ["path_speed_m_s"] * draws.draws_speed + ["path_phase_rad"] * draws.draws_phase
    modes = [f"mode{each.mode}_{name}" for each in scenario.panel_modes for name in ("tip_m", "phase_rad")]
    names += [f"panel{panel}_{name}" for panel in range(n_p) for name in modes]
    names += ["offset_m", "offset_direction_rad", "offset_angle_rad"] * (len(draws.offset) > 0)
    impulse = "time_s", "x_N_s", "y_N_s", "moment_N_m_s"
    names += [f"impulse{k}_{name}" for k in range(len(draws.moment)) for name in impulse]
    names += ["delay_periods"] * (draws.delay > 0.0) + ["noise_key"] * draws.noisy
    return names + [f"{kind}_step_{SUFFIXES[kind]}" for kind in scenario.sensors.quantisation.drawn()]


def sample(draws: EpisodeDraws, rng: np.random.Generator, numbers: Array, first: int, last: int) -> None:
    """Draw the numbers (k,) of an episode from ``first`` up to ``last``; those before are there."""
    if first == last:
        return
    for k in (np.flatnonzero(draws.kinds[first:last]) + first).tolist():
        _sample_uniform(draws, rng, numbers, first, k)
        is_tick = draws.kinds[k] == TICK
        numbers[k] = rng.integers(episode_ticks(draws, numbers)) if is_tick else rng.integers(1, KEYS)
        first = k + 1
    _sample_uniform(draws, rng, numbers, first, last)


def _sample_uniform(draws: EpisodeDraws, rng: np.random.Generator, numbers: Array, first: int, last: int) -> None:
    """Draw numbers that lie in intervals, as ``rng.uniform`` would one by one."""
    low, high = draws.ends[first:last, 0], draws.ends[first:last, 1]
    numbers[first:last] = low + (high - low) * rng.random(last - first)


@kernel
def sample_pcg64(draws, state, numbers):
    """Draw the numbers (k,) of an episode as :func:`sample` does, from the state of a generator; see :mod:`pcg64`."""
    for k in range(len(draws.kinds)):
        if draws.kinds[k] == UNIFORM:
            numbers[k] = uniform(state, draws.ends[k, 0], draws.ends[k, 1])
        elif draws.kinds[k] == TICK:
            numbers[k] = below(state, episode_ticks(draws, numbers))
        else:
            numbers[k] = 1 + below(state, KEYS - 1)


@kernel
def episode_ticks(draws, numbers):
    """Return the length in control periods of an episode of these numbers, its speed among them."""
    if draws.draws_speed == 0 or draws.lap == 0.0:
        return draws.ticks
    return whole_periods(draws.lap / numbers[0], draws.period)


def _excited_modes(scenario: Scenario, model: Model) -> IntArray:
    """Return the places of excited modes among those of a panel."""
    n_m = model.omega2.shape[1]
    modes = np.array([model.n_axial + each.mode - 1 for each in scenario.panel_modes], dtype=np.int64)
    for each in scenario.panel_modes:
        if len(model.panel_root) and model.n_axial + each.mode > n_m:
            raise ConfigError(
                f"{scenario.name}: panel_modes: mode {each.mode} is not there; the panels have {n_m - model.n_axial} "
                "bending modes (panel.elements, panel.bending_cut)"
            )
    return modes


def _by_unit(values: dict[str, float], fields: dict[str, Field], otherwise: float) -> Array:
    """Return a value (n_o,) for each measured number of the observation by the kind of its unit; otherwise another."""
    units = [unit if each.measured else "" for each in fields.values() for unit in each.units]
    return np.array([values.get(KINDS.get(unit, ""), otherwise) for unit in units])
