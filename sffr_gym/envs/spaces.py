"""Action and observation space of an environment, and the border that actions pass on their way to compiled code."""

from __future__ import annotations

from math import isnan
from typing import Any

import gymnasium as gym
import numpy as np

from sffr_gym.task.task_model import TaskModel
from sffr_gym.types import Array

REAL = "fiu"  # kinds of numbers that an action may consist of
FEW = 1000  # numbers of an action


def make_spaces(prior: TaskModel, dtype: np.dtype[Any]) -> tuple[gym.spaces.Box, gym.spaces.Box]:
    """Return action and observation space of one environment.

    Rounded to ``dtype``, an observation within its bounds lies within the rounded bounds: rounding keeps the order.
    """
    action, bound = gym.spaces.Box(-1.0, 1.0, (len(prior.scale),), np.float32), prior.bound.astype(dtype)
    return action, gym.spaces.Box(-bound, bound, dtype=dtype.type)


def check_action(action: Any, shape: tuple[int, ...] | None) -> Array:
    """Return an action as float64.

    Real numbers of any type are taken as they are, whole and infinite ones among them; what lies beyond [-1, 1] is
    clipped, and counted, by who applies it.

    Raises:
        ValueError: for what is no array of real numbers (complex ones, texts, objects, truth values, a masked array),
            a wrong shape, or NaN.
    """
    array = action if type(action) is np.ndarray else np.asarray(action)
    if array.dtype.kind not in REAL or isinstance(action, np.ma.MaskedArray):
        kind = "a masked array" if isinstance(action, np.ma.MaskedArray) else f"an array of {array.dtype}"
        raise ValueError(f"action must be an array of real numbers, got {kind}")
    if array.shape != shape:
        raise ValueError(f"action must have shape {shape}, got {array.shape}")
    array = array.astype(np.float64, copy=False)
    # The sum of squares is NaN if and only if an entry is, infinities included; of a few numbers it comes far sooner,
    # of many NumPy hands it to threads.
    if isnan(np.vdot(array, array)) if array.size <= FEW else np.isnan(array).any():
        places = np.argwhere(np.isnan(array))
        raise ValueError(f"action has NaN at {(places.ravel() if array.ndim == 1 else places).tolist()}")
    return array
