"""Plants that differ, side by side in lanes: what is a number of one plant is a number in lanes of eight."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from sffr_gym.compile.arguments import LaneArray, Structures
from sffr_gym.compile.lanes import WIDTH
from sffr_gym.task.task_model import TaskModel

PARTS = ("model", "actuators")  # of a TaskModel, whose numbers differ; all else is the same for the plants of a batch


class LanePlants:
    """Groups of ``WIDTH`` plants of one layout.

    Args:
        groups: the plants of each group.

    Attributes:
        structures: a :class:`task_model.TaskModel` for each group, whose robot's numbers are in lanes.
    """

    def __init__(self, groups: Iterable[Sequence[TaskModel]]) -> None:
        self._plants = [list(group) for group in groups]
        self.structures = Structures(_in_lanes(group) for group in self._plants)
        self._fits = [_alike(group) for group in self._plants]
        self._unfit = self._fits.count(False)

    @property
    def fit(self) -> bool:
        """Whether the plants of each group have the same whole numbers, such as which modes are stiff."""
        return self._unfit == 0

    def put(self, i: int, plant: TaskModel) -> None:
        """Replace a plant, counted over all groups; what is beyond the last group is none."""
        group, lane = divmod(i, WIDTH)
        if group >= len(self._plants):
            return
        plants = self._plants[group]
        plants[lane] = plant
        for part in PARTS:
            _put(getattr(self.structures[group], part), getattr(plant, part), lane)
        fits = _alike(plants)
        self._unfit += self._fits[group] - fits
        self._fits[group] = fits


def _in_lanes(plants: Sequence[TaskModel]) -> TaskModel:
    """Return plants as one."""
    parts = {part: _joined([getattr(plant, part) for plant in plants]) for part in PARTS}
    return plants[0]._replace(steps=plants[0].steps, **parts)


def _joined(values: Sequence[Any]) -> Any:
    """Return named tuples of floats and arrays as one of lanes; whole numbers are those of the first."""
    first = values[0]
    if isinstance(first, tuple):
        return type(first)(*(_joined(parts) for parts in zip(*values, strict=True)))
    if isinstance(first, float) or (isinstance(first, np.ndarray) and first.dtype == np.float64):
        shape = np.shape(first)
        joined = np.zeros((*shape, WIDTH)).view(LaneArray)
        for lane, value in enumerate(values):
            if np.shape(value) == shape:
                joined[..., lane] = value
        return joined
    return first


def _put(joined: Any, value: Any, lane: int) -> None:
    """Write a plant's numbers into a lane."""
    if isinstance(joined, tuple):
        for part, own in zip(joined, value, strict=True):
            _put(part, own, lane)
    elif isinstance(joined, LaneArray) and joined.shape[:-1] == np.shape(value):
        joined[..., lane] = value


def _alike(plants: Sequence[TaskModel]) -> bool:
    """Say whether plants have the same whole numbers and shapes."""
    first = _wholes(plants[0])
    return all(_wholes(plant) == first for plant in plants[1:])


def _wholes(plant: TaskModel) -> list[Any]:
    """Return what plants of a group must have in common."""
    stiff = plant.model.stiff
    return [plant.steps, stiff.panel.tolist(), stiff.mode.tolist(), stiff.at.tolist()]
