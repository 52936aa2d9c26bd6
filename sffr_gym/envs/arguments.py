"""What constructors and resets of the environments are given: checked, and turned into what they work with."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import DTypeLike
from pydantic import BaseModel

from sffr_gym.config.params import Params, change_shipped, load_params
from sffr_gym.config.strict_yaml import ConfigError, build
from sffr_gym.task.scenario import Scenario, load_scenario

ParamsLike = Params | Mapping[str, Any] | str | os.PathLike[str] | None
ScenarioLike = Scenario | Mapping[str, Any] | str | os.PathLike[str]

NO_LIMIT = -1  # steps of an episode, as gymnasium.make has it
DTYPES = ("float32", "float64")  # of observations


def resolve_params(params: ParamsLike, overrides: Sequence[str] = ()) -> Params:
    """Return parameters with overrides on top.

    Args:
        params: an object, a file, a mapping with what differs from the case study, or None for that.
        overrides: assignments such as ``panel.EI=25``.

    Raises:
        ConfigError: for what is none of these, or not valid.
    """
    if isinstance(overrides, str) or not all(isinstance(each, str) for each in overrides):
        raise ConfigError(f"overrides = {overrides!r}: must be a list of assignments such as ['panel.EI=25']")
    if isinstance(params, Mapping):
        params = change_shipped(plain(params), lambda _: "params")
    elif not isinstance(params, Params):
        if not isinstance(params, str | os.PathLike | None):
            raise ConfigError(f"params = {params!r}: must be Params, a file, a mapping of keys to values, or None")
        params = load_params(params)
    return params.with_overrides(*overrides)


def resolve_robot(scenario: Scenario, params: ParamsLike, overrides: Sequence[str] = ()) -> Params:
    """Return parameters as in :func:`resolve_params`, with what a scenario changes for plant and controllers alike.

    Raises:
        ConfigError: as there, and for an override of what the scenario sets otherwise.
    """
    return scenario.robot_of(resolve_params(params, overrides), overrides)


def resolve_scenario(scenario: ScenarioLike) -> Scenario:
    """Return a scenario from an object, which is checked again, a mapping of its keys, a file or a shipped one's name.

    Raises:
        ConfigError: for what is none of these, or not valid.
    """
    if isinstance(scenario, Scenario | Mapping):
        return build(Scenario, plain(scenario), lambda _: "scenario")
    if not isinstance(scenario, str | os.PathLike):
        raise ConfigError(f"scenario = {scenario!r}: must be a name, a file, a mapping of keys to values or a Scenario")
    return load_scenario(scenario)


def plain(value: Any) -> Any:
    """Return an argument as JSON can hold it and a constructor takes it back, for the spec of an environment."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if isinstance(value, os.PathLike):
        return os.path.abspath(value) if os.path.isfile(value) else os.fspath(value)
    if isinstance(value, Mapping):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, type | np.dtype):
        return np.dtype(value).name
    if isinstance(value, Enum):
        return value.value
    return value.item() if isinstance(value, np.generic) else value


def step_limit(max_episode_steps: int | None) -> int | None:
    """Return after how many steps an episode is truncated; None for no limit, which is -1 to Gymnasium.

    Raises:
        ValueError: for anything but -1, None and whole numbers from 1 on.
    """
    if max_episode_steps is None or (is_whole(max_episode_steps) and max_episode_steps == NO_LIMIT):
        return None
    if not is_whole(max_episode_steps) or max_episode_steps < 1:
        raise ValueError(
            f"max_episode_steps = {max_episode_steps!r}: must be a whole number from 1 on, or -1 or None for no limit"
        )
    return int(max_episode_steps)


def observation_type(dtype: DTypeLike) -> np.dtype[Any]:
    """Return the type of observations, ``float32`` or ``float64``; raises ValueError for another one."""
    try:
        resolved = np.dtype(dtype) if dtype is not None else None
    except TypeError:
        resolved = None
    if resolved is None or resolved.name not in DTYPES or not resolved.isnative:
        raise ValueError(f"dtype = {dtype!r}: must be one of {', '.join(DTYPES)}")
    return resolved


def check_options(options: Mapping[str, Any] | None, known: Sequence[str]) -> dict[str, Any]:
    """Return a copy of the options of a reset.

    Raises:
        ValueError: for what is no mapping, or an option that is not known.
    """
    if options is not None and not isinstance(options, Mapping):
        raise ValueError(f"options must be a mapping such as {{'scenario': 'excited'}}, got {options!r}")
    unknown = [key for key in options or {} if key not in known]
    if unknown:
        raise ValueError(f"unknown reset option {sorted(map(str, unknown))}; known: {list(known)}")
    return dict(options or {})


def check_seed(seed: Any) -> int | None:
    """Return a seed as Python's integer, None as it is.

    Raises:
        gymnasium.error.Error: for what is no whole number or below 0, in Gymnasium's words.
    """
    if seed is None:
        return None
    if not is_whole(seed):
        raise gym.error.Error(f"Seed must be a python integer, actual type: {type(seed)}")
    if seed < 0:
        raise gym.error.Error(f"Seed must be greater or equal to zero, actual value: {seed}")
    return int(seed)


def is_whole(value: Any) -> bool:
    """Say whether a value is a whole number; True and False are none."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def check_seeds(seed: int | Sequence[int | None] | None, n: int) -> list[int | None]:
    """Return a seed for each of ``n`` environments, None for those that go on with their generator.

    Raises:
        ValueError: for another number of seeds.
        gymnasium.error.Error: for a seed that is no whole number from 0 on.
    """
    if isinstance(seed, list | tuple | range | np.ndarray) and np.shape(seed):
        if len(seed) != n:
            raise ValueError(f"seed must be an integer or {n} of them, got {len(seed)}")
        return [check_seed(each) for each in seed]
    first = check_seed(seed)
    return [None if first is None else first + i for i in range(n)]
