"""Episodes: one draw of a scenario, with its plant, start, reference, sensors, faults and impulses.

All random numbers come from one generator; :mod:`sffr_gym.task.episode_draws` has their order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sffr_gym.config.params import Params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.physics.actuators import Actuators
from sffr_gym.physics.initial import initial_positions
from sffr_gym.physics.model import N_BASE, Model, pack
from sffr_gym.task.disturbances import Impulses, Sensing
from sffr_gym.task.episode_draws import EpisodeDraws, drawn_names, episode_draws, episode_ticks, sample
from sffr_gym.task.episode_start import new_starts, start_episode
from sffr_gym.task.observation import Field, observation_fields
from sffr_gym.task.path_range import check_path
from sffr_gym.task.plants import Drawn, at_speed, draw_plant
from sffr_gym.task.reference import Reference, flat_reference, path_reference, read_reference
from sffr_gym.task.scenario import Scenario
from sffr_gym.types import Array


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
    draws: dict[Scenario, tuple[EpisodeDraws, list[str]]]  #: what :func:`draws_of` has returned


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
    return Nominal(params, plant, model, p, v, observation_fields(model, params), {})


def draws_of(scenario: Scenario, known: Nominal) -> tuple[EpisodeDraws, list[str]]:
    """Return what a scenario draws beside the plant, and the names of it; kept, as that takes longer than a draw.

    Raises:
        ConfigError: see :func:`sffr_gym.task.episode_draws.episode_draws`.
    """
    if scenario not in known.draws:
        draws = episode_draws(scenario, known.params, known.model, known.p, known.v, known.fields)
        known.draws[scenario] = draws, drawn_names(scenario, draws, len(known.model.panel_root))
    return known.draws[scenario]


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
    prior, plant, model, n_p = known.params, known.plant, known.model, len(known.model.panel_root)
    draws, names = draws_of(scenario, known)
    numbers, (to_plant, to_fault) = np.zeros(len(names)), draws.parts.tolist()

    def drawn_from(first: int, last: int | None) -> Drawn:
        return dict(zip(names[first:last], numbers[first:last].tolist(), strict=True))

    sample(draws, rng, numbers, 0, to_plant)
    drawn = drawn_from(0, to_plant)
    if draws.draws_speed:
        prior, plant = at_speed(prior, drawn), at_speed(plant, drawn)
    if scenario.draws_model:
        plant = draw_plant(scenario, plant, rng, drawn)
        model = pack(plant)
        if (model.at, model.n_axial) != (known.model.at, known.model.n_axial):  # by rounding, of a cut on a frequency
            raise ConfigError(
                f"{scenario.name}: plant: a drawn plant has other modes; move panel.bending_cut or axial_cut"
            )
        draws = _for_plant(draws, known, plant, model)
    sample(draws, rng, numbers, to_plant, to_fault)
    faults: Drawn = {}
    health = _draw_fault(scenario, n_p, rng, faults)
    sample(draws, rng, numbers, to_fault, len(numbers))
    ticks, starts = episode_ticks(draws, numbers), new_starts(draws)
    start_episode(model, draws, numbers, starts, 0)
    drawn |= drawn_from(to_plant, to_fault) | faults | drawn_from(to_fault, None)
    p, v, reference, level, key, delay, quantum, coarse, tick, impulse = (rows[0] for rows in starts)
    sensing, wanted = Sensing(level, int(key), int(delay), quantum, int(coarse)), read_reference(reference, model)
    return Episode(p, v, wanted, plant, prior, ticks, health, Impulses(tick, impulse), sensing, drawn)


def _for_plant(draws: EpisodeDraws, known: Nominal, plant: Params, model: Model) -> EpisodeDraws:
    """Return draws for another plant, whose start leaves the path at its own speed."""
    p, v = initial_positions(plant.model_copy(update={"path": known.params.path}), model)
    return draws._replace(p=p, v=v, reference=flat_reference(path_reference(known.params, model, p)))


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
