"""Plants as rows of numbers: every environment of a batch has its own.

A :class:`task_model.TaskModel` is some seventy arrays and numbers. Here they stand one after the other in the order of
its fields, so that a batch and its states hold its plants as two arrays.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from sffr_gym.compile.workspace import Integers, structure
from sffr_gym.physics.model import Sizes, StiffModes
from sffr_gym.task.task_model import TaskModel, TaskSizes, task_shapes, task_sizes
from sffr_gym.types import Array, IntArray

N_SIZES = len(Sizes._fields) + len(TaskSizes._fields) - 1
N_INDICES = len(StiffModes._fields) - 1  # of each stiff mode, beside its frequency


class Fleet(NamedTuple):
    """Plants of one layout: as many links, kept modes and channels, coupled alike; their numbers differ.

    The modes that are stiff and the integration steps in a control period may differ as well, so that rows are as long
    as the longest that a plant of the layout can need; what is left of a shorter one is 0.
    """

    numbers: Array  #: (n, size) floats of each plant, or a single row if all are alike
    integers: IntArray  #: (n, integers) of each: sizes, then indices and switches


def make_fleet(plant: TaskModel, n: int = 1) -> Fleet:
    """Return ``n`` rows that begin alike and may be replaced, or one row for any number of plants that stay alike."""
    numbers, integers = _row(plant)
    return Fleet(np.tile(numbers, (n, 1)), np.tile(integers, (n, 1)))


def put_plant(fleet: Fleet, i: int, plant: TaskModel) -> None:
    """Replace a plant of the fleet.

    Raises:
        ValueError: for a plant of another layout.
    """
    if not same_layout(plant_at(fleet, i), plant):
        raise ValueError(
            "the robots of a batch must have as many links, kept modes and channels each, and one integrator and "
            "coupling; draw parameters that change none of them, or simulate these robots one by one"
        )
    fleet.numbers[i], fleet.integers[i] = _row(plant)


def same_layout(plant: TaskModel, other: TaskModel) -> bool:
    """Say whether two plants differ in numbers alone, or in which modes are stiff, or in steps per control period."""
    one, two = (_flatten(roomiest(each)._replace(steps=0))[1] for each in (plant, other))
    return np.array_equal(one, two)


def roomiest(plant: TaskModel) -> TaskModel:
    """Return a plant of the same layout all of whose modes are stiff: none needs more memory."""
    count = plant.model.omega2.size
    indices = np.zeros(count, dtype=np.int64)
    return plant._replace(model=plant.model._replace(stiff=StiffModes(indices, indices, indices, np.zeros(count))))


def plant_at(fleet: Fleet, i: int) -> TaskModel:
    """Return the plant of environment ``i``; its arrays are the fleet's."""
    one: Any = Integers(())
    row = i if len(fleet.numbers) > 1 else 0
    numbers, integers = fleet.numbers[row], fleet.integers[row]
    shapes = TaskSizes(Sizes(one, one, one, one, one, one, one, one, one), one, one, one, one)
    sizes = structure(numbers, integers, shapes)
    plant: TaskModel = structure(numbers, integers[N_SIZES:], task_shapes(sizes))
    return plant


def plants_of(fleet: Fleet) -> list[TaskModel]:
    """Return the plants: one for each row."""
    return [plant_at(fleet, i) for i in range(len(fleet.numbers))]


def _flatten(plant: TaskModel) -> tuple[Array, IntArray]:
    """Numbers and integers of a plant in the order in which :func:`plant_at` takes them."""
    sizes = task_sizes(plant)
    leaves = [np.ravel(leaf) for leaf in _leaves(plant)]
    numbers = [leaf for leaf in leaves if leaf.dtype.kind == "f"]
    integers = [leaf for leaf in leaves if leaf.dtype.kind != "f"]
    return np.concatenate(numbers), np.concatenate([*map(np.ravel, _leaves(sizes)), *integers]).astype(np.int64)


def _row(plant: TaskModel) -> tuple[Array, IntArray]:
    """Numbers and integers of a plant, as long as those of the :func:`roomiest` one."""
    numbers, integers = _flatten(plant)
    spare = plant.model.omega2.size - len(plant.model.stiff.omega)
    return np.pad(numbers, (0, spare)), np.pad(integers, (0, spare * N_INDICES))


def _leaves(value: Any) -> list[Any]:
    """Fields of nested tuples, depth first."""
    return [leaf for field in value for leaf in _leaves(field)] if isinstance(value, tuple) else [value]
