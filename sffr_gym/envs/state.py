"""The border that states pass on their way to compiled code, which trusts every size, index and status in them.

Each function raises ValueError for a state of another robot or of a batch of another size, and for a damaged one; the
message names the place, what is there and what must be.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from sffr_gym.config.sections import PANEL_KEYS, Section
from sffr_gym.config.template import conform
from sffr_gym.envs.batch import Batch
from sffr_gym.envs.fleet import N_SIZES, make_fleet, plant_at, same_layout
from sffr_gym.physics.model import Sizes
from sffr_gym.task.disturbances import KEYS, NEVER, Impulses, Sensing
from sffr_gym.task.episode import Episode, Health, Nominal
from sffr_gym.task.reference import flat_reference, path_reference
from sffr_gym.task.scenario import MOST_IMPULSES
from sffr_gym.task.status import REASONS
from sffr_gym.task.task_model import TaskModel, plant_of
from sffr_gym.types import Array

MOST_TICKS = 2**31 - 1  # control periods of an episode
MOST_STEPS = 100_000  # integration steps in a control period
FAR = 1.0e6  # m, rad and their rates: no robot or reference gets so far, and no noise is so large
LARGE = 1.0e100  # whose square is finite; for what was measured
STIFF = Sizes._fields.index("stiff")
DRAWN_ACTUATORS = ("thruster_force", "thruster_torque", "thrusters", "modulator", "lag", "quantisation")
SETTLED = ("period", "limits", "scale", "bound", "weights")  # numbers of a plant that no scenario draws


def check_form(state: Any, template: Mapping[str, Any], same: tuple[str, ...] = ("params",)) -> None:
    """Make sure that a state has the form of a template, and the same values of what tells environments apart.

    Args:
        state: what came from outside.
        template: a state of this environment; None in it accepts anything.
        same: keys whose values must be the template's.
    """
    try:
        conform(state, template, "state")
    except ValueError as error:
        raise ValueError(
            f"this state is of another robot, or of another kind or number of environments: {error}"
        ) from None
    for key in same:
        if state[key] != template[key]:
            raise ValueError(
                f"this state is of another robot or law: state.{key} is {state[key]}, here {template[key]}"
            )


def check_batch(batch: Batch, prior: TaskModel) -> None:
    """Make sure that the numbers of a batch of the right form are such that the kernels can go on from them."""
    check_finite(batch, "state.batch")
    limits = {
        "p": (-FAR, FAR), "v": (-FAR, FAR), "actuation": (-LARGE, LARGE),
        "tick": (0, MOST_TICKS), "key": (0, KEYS - 1), "delay": (0, 1), "quantum": (0.0, FAR), "coarse": (0, 1),
        "impulse_tick": (NEVER, MOST_TICKS),
        "clipped": (0, len(prior.scale)), "status": (0, len(REASONS) - 1), "level": (0.0, FAR),
        "obs": (-prior.bound, prior.bound), "reference": (-FAR, FAR), "signals": (-LARGE, LARGE),
    }  # fmt: skip
    for name, (low, high) in limits.items():
        check_range(getattr(batch, name), low, high, f"state.batch.{name}")


def check_finite(arrays: Any, where: str) -> None:
    """Make sure that the floats of a named tuple of arrays are finite."""
    for name, array in zip(arrays._fields, arrays, strict=True):
        if hasattr(array, "_fields"):
            check_finite(array, f"{where}.{name}")
        elif array.dtype.kind == "f" and not np.isfinite(array).all():
            raise ValueError(f"{where}.{name}: must be finite, has {array[~np.isfinite(array)][0]}")


def check_range(values: Any, low: Any, high: Any, where: str) -> None:
    """Make sure that numbers lie from ``low`` to ``high``."""
    inside = (low <= values) & (values <= high)
    if not np.all(inside):
        first = np.atleast_1d(values)[~np.atleast_1d(inside)][0]
        bounds = f" from {low} to {high}" if np.ndim(low) == 0 else ""
        raise ValueError(f"{where}: must lie in its range{bounds}, has {first}")


def check_episode(episode: Any, known: Nominal, prior: TaskModel) -> TaskModel:
    """Return the plant of an episode, packed.

    Args:
        episode: what came from outside.
        known: what the controllers of this environment believe.
        prior: the plant before anything is drawn, packed.
    """
    form = _episode_form(episode, known, prior)._asdict() | {"drawn": None}
    asked = episode._asdict() if isinstance(episode, Episode) else episode
    check_form({"episode": asked}, {"episode": form}, ())
    here = "state.episode"
    for values, low, high, name in (
        (episode.ticks, 1, MOST_TICKS, "ticks"), (episode.sensing.key, 0, KEYS - 1, "sensing.key"),
        (episode.sensing.delay, 0, 1, "sensing.delay"), (episode.sensing.level, 0.0, FAR, "sensing.level"),
        (episode.sensing.quantum, 0.0, FAR, "sensing.quantum"), (episode.sensing.coarse, 0, 1, "sensing.coarse"),
        (episode.health.piezo, 0.0, 1.0, "health.piezo"), (episode.health.thruster, 0.0, 1.0, "health.thruster"),
        (episode.health.joint, 0.0, 1.0, "health.joint"), (len(episode.impulses.tick), 0, MOST_IMPULSES, "impulses"),
        (episode.impulses.tick, NEVER, MOST_TICKS, "impulses.tick"),
        (flat_reference(episode.reference), -FAR, FAR, "reference"),
    ):  # fmt: skip
        check_range(values, low, high, f"{here}.{name}")
    if not all(np.isfinite(part).all() for part in (episode.p, episode.v, episode.impulses.impulse)):
        raise ValueError(f"{here}: p, v and impulses must be finite")
    drawn = episode.drawn
    if not isinstance(drawn, dict) or not all(isinstance(k, str) and isinstance(v, float) for k, v in drawn.items()):
        raise ValueError(f"{here}.drawn: must map names to numbers")
    try:
        plant = plant_of(prior, known, episode) if _is_of(episode, known) else None
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise ValueError(f"{here}: its parameters are damaged: {error}") from None
    if plant is None or not same_layout(prior, plant):
        raise ValueError(f"{here}: its robot is another one than this environment's")
    check_range(plant.steps, 1, MOST_STEPS, f"{here}: integration steps in a control period")
    if not np.isfinite(make_fleet(plant).numbers).all():
        raise ValueError(f"{here}: its plant must have finite numbers")
    return plant


def _episode_form(episode: Any, known: Nominal, prior: TaskModel) -> Episode:
    """Return an episode of the form that a given one must have; impulses may be as many as it has."""
    count = np.size(getattr(getattr(episode, "impulses", None), "tick", ()))
    return Episode(
        p=known.p, v=known.v, reference=path_reference(known.params, known.model, known.p), plant=known.params,
        prior=known.params, ticks=1, health=Health(np.ones(len(known.model.panel_root)), 1.0, 1.0),
        impulses=Impulses(np.zeros(count, dtype=np.int64), np.zeros((count, 3))),
        sensing=Sensing(np.zeros(len(prior.bound)), 0, 0, np.zeros(len(prior.bound)), 0), drawn={},
    )  # fmt: skip


def _is_of(episode: Episode, known: Nominal) -> bool:
    """Say whether a scenario could have drawn an episode's speed and plant, whatever their numbers, for a robot."""
    plant, speed = episode.plant, episode.prior.path.speed
    believed, prior = (
        each.model_copy(update={"path": each.path.model_copy(update={"speed": speed})})
        for each in (known.params, known.plant)
    )
    if episode.prior != believed:
        return False
    panel = _with(prior.panel, plant.panel, "EI", "mass", "bending_cut", "axial_cut")
    mounts = zip(prior.panel.mounts, plant.panel.mounts, strict=True)
    own = {"mounts": tuple(_with(*pair, *PANEL_KEYS) for pair in mounts)}
    drawn: dict[str, Any] = {"panel": panel.model_copy(update=own)}
    drawn["arms"] = tuple(
        arm.model_copy(
            update={
                "links": tuple(_with(*links, "mass", "inertia") for links in zip(arm.links, its.links, strict=True))
            }
        )
        for arm, its in zip(prior.arms, plant.arms, strict=True)
    )
    drawn["actuators"] = _with(prior.actuators, plant.actuators, *DRAWN_ACTUATORS).model_copy(
        update={"piezo": _with(prior.actuators.piezo, plant.actuators.piezo, "force", "moment")}
    )
    if prior.object is not None:
        drawn["object"] = _with(prior.object, plant.object, "mass", "inertia")
    return plant == prior.model_copy(update=drawn)


def _with(section: Section, other: Any, *names: str) -> Section:
    """Return a section of the parameters with some values of another one."""
    return section.model_copy(update={name: getattr(other, name) for name in names})


def check_fleet(fleet: Any, prior: TaskModel, n: int) -> None:
    """Make sure that every row of a fleet is a plant of the prior's layout, whose indices the kernels can follow.

    Args:
        fleet: what came from outside.
        prior: the robot of this environment.
        n: number of environments; a fleet has a row for each, or one for all.
    """
    own = make_fleet(prior, 1 if np.shape(getattr(fleet, "numbers", ()))[:1] == (1,) else n)
    check_form({"fleet": fleet}, {"fleet": own}, ())
    if not np.isfinite(fleet.numbers).all():
        raise ValueError("state.fleet.numbers: must be finite")
    for i in range(len(fleet.numbers)):
        sizes = fleet.integers[i, :N_SIZES].copy()
        check_range(sizes[STIFF], 0, prior.model.omega2.size, "state.fleet.integers: number of stiff modes")
        sizes[STIFF] = own.integers[i, STIFF]
        if not np.array_equal(sizes, own.integers[i, :N_SIZES]):
            raise ValueError(f"state.fleet: row {i} is of another robot than this environment's")
        _check_plant(plant_at(fleet, i), prior, f"state.fleet: row {i}")


def check_drawn(drawn: Any, n: int) -> dict[str, tuple[Array, np.ndarray]]:
    """Return what was drawn: a number and a truth value for each environment, by name; files make lists of pairs."""
    if not isinstance(drawn, Mapping):
        raise ValueError(f"state.drawn: must be a mapping, is {type(drawn).__name__}")
    pairs = {name: tuple(pair) if isinstance(pair, list) else pair for name, pair in drawn.items()}
    pair = (np.zeros(n), np.zeros(n, dtype=np.bool_))
    check_form({"drawn": pairs}, {"drawn": dict.fromkeys(map(str, pairs), pair)}, ())
    return pairs


def _check_plant(plant: TaskModel, prior: TaskModel, where: str) -> None:
    """Make sure that a plant of the prior's sizes is one that a scenario could have drawn."""
    stiff, (panels, modes) = plant.model.stiff, prior.model.omega2.shape
    check_range(stiff.panel, 0, panels - 1, f"{where}, panels of stiff modes")
    check_range(stiff.mode, 0, modes - 1, f"{where}, stiff modes")
    check_range(plant.steps, 1, MOST_STEPS, f"{where}, integration steps in a control period")
    same = same_layout(plant, prior) and np.array_equal(
        stiff.at, prior.model.at.modes + stiff.panel * modes + stiff.mode
    )
    if not same or any(_numbers(plant, name) != _numbers(prior, name) for name in SETTLED):
        raise ValueError(f"{where} is of another robot than this environment's")


def _numbers(plant: TaskModel, name: str) -> list[float]:
    """Return a part of a plant as numbers that can be compared."""
    values: Array = np.ravel(getattr(plant, name))
    return values.tolist()
