"""Plants as rows of numbers: every environment of a batch has its own, and a kernel gets them all as two arrays.

A :class:`task_model.TaskModel` is some seventy arrays and numbers, whose way from Python into a kernel takes longer
than a control period. Here its numbers stand one after the other in the order of its fields, and a kernel looks at them
through arrays again.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from sffr_gym.compile.jit import inline
from sffr_gym.compile.workspace import Integers, structure
from sffr_gym.physics.model import Sizes
from sffr_gym.task.task_model import TaskModel, TaskSizes, task_shapes, task_sizes
from sffr_gym.types import Array, IntArray

N_SIZES = len(Sizes._fields) + len(TaskSizes._fields) - 1


class Fleet(NamedTuple):
    """Plants of one structure: as many links, modes and channels, coupled alike; their numbers differ."""

    numbers: Array  #: (n, ...) floats of each plant, or a single row if all are alike
    integers: IntArray  #: what they share: sizes, then indices and switches
    staggered: tuple[bool, ...]  #: the coupling; see ``model.Model``


def make_fleet(plant: TaskModel, n: int = 1) -> Fleet:
    """Return ``n`` rows that begin alike and may be replaced, or one row for any number of plants that stay alike."""
    numbers, integers = _flatten(plant)
    return Fleet(np.tile(numbers, (n, 1)), integers, plant.model.staggered)


def put_plant(fleet: Fleet, i: int, plant: TaskModel) -> None:
    """Replace a plant of the fleet.

    Raises:
        ValueError: for a plant of another structure.
    """
    numbers, integers = _flatten(plant)
    if not np.array_equal(integers, fleet.integers) or plant.model.staggered != fleet.staggered:
        raise ValueError(
            "the robots of a batch must have as many links, kept modes, stiff modes, channels and steps in a control "
            "period each; draw parameters that change none of them, or simulate these robots one by one"
        )
    fleet.numbers[i] = numbers


@inline
def plant_at(fleet, i):
    """The plant of environment ``i`` as a :class:`task_model.TaskModel`."""
    numbers, one = fleet.numbers[i if len(fleet.numbers) > 1 else 0], Integers(())
    shapes = TaskSizes(Sizes(one, one, one, one, one, one, one, one), one, one, one, one)
    sizes = structure(numbers, fleet.integers, shapes)
    return structure(numbers, fleet.integers[N_SIZES:], task_shapes(sizes, fleet.staggered))


def _flatten(plant: TaskModel) -> tuple[Array, IntArray]:
    """Numbers and integers of a plant in the order in which :func:`plant_at` takes them."""
    sizes = task_sizes(plant)
    leaves = [np.ravel(leaf) for leaf in _leaves(plant._replace(model=plant.model._replace(staggered=())))]
    numbers = [leaf for leaf in leaves if leaf.dtype.kind == "f"]
    integers = [leaf for leaf in leaves if leaf.dtype.kind != "f"]
    return np.concatenate(numbers), np.concatenate([*map(np.ravel, _leaves(sizes)), *integers]).astype(np.int64)


def _leaves(value: Any) -> list[Any]:
    """Fields of nested tuples, depth first."""
    return [leaf for field in value for leaf in _leaves(field)] if isinstance(value, tuple) else [value]
