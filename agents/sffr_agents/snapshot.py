"""Everything that the future of a training depends on, as plain numbers: taken, compared with its form, put back.

Nothing of a snapshot is trusted. Shapes and types are compared with those of the training that it is put into, and
generators and counters with what this module writes, all of it before anything is put back.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from math import isfinite
from operator import attrgetter
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecMonitor

from sffr_agents.sb3_vec_env import batch_of
from sffr_gym.config.template import conform

COUNTERS = ("num_timesteps", "_n_updates", "_episode_num")
PROGRESS = "_current_progress_remaining"
REPLAY = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
MOMENTS = ("exp_avg", "exp_avg_sq")  # of Adam, which all algorithms use
POLICY = "policy"  # name of all networks together
MOST_COUNT = 2**53
NUMPY_WORDS = 624  # of the state of NumPy's Mersenne Twister


def take(model: BaseAlgorithm, env: VecMonitor) -> dict[str, Any]:
    """Return the snapshot of a training between two rollouts; its arrays are those of the training itself.

    Args:
        model: after its last update.
        env: its environments, see :func:`sb3_vec_env.batch_of`.
    """
    if model._last_obs is None:
        model._last_obs = env.reset()  # type: ignore[assignment]  # an array, as the observation space is a box
        model._last_episode_starts = np.ones(env.num_envs, dtype=bool)
    environments = batch_of(env).get_state()
    del environments["scenario"]
    buffer = getattr(model, "replay_buffer", None)
    return {
        "networks": {name: _array(tensor) for name, tensor in model.policy.state_dict().items()},
        "optimizers": {name: _moments(optimizer) for name, optimizer in _optimizers(model)},
        "variables": {name: _array(tensor) for name, tensor in _variables(model)},
        "environments": environments,
        "monitor": (env.episode_returns, env.episode_lengths),
        "last": (model._last_obs, model._last_episode_starts),
        "counters": {name: getattr(model, name) for name in COUNTERS},
        "progress": float(getattr(model, PROGRESS)),
        "generators": _generators(model),
        "replay": [getattr(buffer, name)[: _filled(buffer)] for name in REPLAY] if buffer else [],
        "position": (buffer.pos, buffer.full) if buffer else (0, False),
    }


def template(model: BaseAlgorithm, env: VecMonitor, snapshot: Any) -> dict[str, Any]:
    """Return an object of the form that a snapshot of this training must have.

    Args:
        model: as it was built.
        env: its environments.
        snapshot: of which the replay buffer's position, and the names of what was drawn and trained, decide how much
            it holds; its arrays do not matter.

    Raises:
        ValueError: for a position outside of the buffer.
    """
    form = take(model, env)
    position = _at(snapshot, "position")
    buffer = getattr(model, "replay_buffer", None)
    if buffer is not None:
        position = tuple(position) if isinstance(position, list) else position
        conform(position, (0, False), "position")
        if not 0 <= position[0] < buffer.buffer_size:
            raise ValueError(f"position.0 = {position[0]}: must be from 0 to {buffer.buffer_size - 1}")
        filled = buffer.buffer_size if position[1] else position[0]
        form["replay"] = [getattr(buffer, name)[:filled] for name in REPLAY]
    for name, optimizer in _optimizers(model):
        moments, saved = _form_of_moments(optimizer), _at(snapshot, "optimizers", name)
        form["optimizers"][name] = {index: moments[index] for index in moments if index in _names(saved)}
    count = batch_of(env).num_envs
    drawn = np.zeros(count), np.zeros(count, dtype=np.bool_)
    form["environments"]["drawn"] = dict.fromkeys(_names(_at(snapshot, "environments", "drawn")), drawn)
    form["generators"]["python"] = (form["generators"]["python"][0], None)
    return form


def check(snapshot: Any, form: dict[str, Any]) -> None:
    """Make sure that a snapshot may be put back.

    Args:
        snapshot: what was read.
        form: see :func:`template`.

    Raises:
        ValueError: with the place, what is there and what must be.
    """
    conform(snapshot, form, "state")
    for group in ("networks", "optimizers", "variables"):
        for name, array in _leaves(snapshot[group], group):
            if not np.isfinite(array).all():
                raise ValueError(f"{name}: must be finite")
    for name, count in snapshot["counters"].items():
        _check_range(f"counters.{name}", count, 0, MOST_COUNT)
    if not (isfinite(snapshot["progress"]) and snapshot["progress"] <= 1.0):
        raise ValueError(f"progress = {snapshot['progress']}: must be at most 1")
    if not np.isfinite(snapshot["last"][0]).all():
        raise ValueError("last.0: must be finite")
    _check_generators(snapshot["generators"])


def restore(snapshot: dict[str, Any], model: BaseAlgorithm, env: VecMonitor) -> None:
    """Put a training back to a snapshot that :func:`check` has let through.

    Raises:
        ValueError: if the environments do not take their state; nothing has changed then.
    """
    batch = batch_of(env)
    batch.set_state(snapshot["environments"] | {"scenario": batch.scenario})
    env.episode_returns, env.episode_lengths = snapshot["monitor"]
    model._last_obs, model._last_episode_starts = snapshot["last"]
    model.policy.load_state_dict({name: torch.from_numpy(array) for name, array in snapshot["networks"].items()})
    for name, optimizer in _optimizers(model):
        state = {
            int(index): {part: torch.from_numpy(array) for part, array in parts.items()}
            for index, parts in snapshot["optimizers"][name].items()
        }
        optimizer.load_state_dict(optimizer.state_dict() | {"state": state})
    for name, tensor in _variables(model):
        tensor.data.copy_(torch.from_numpy(snapshot["variables"][name]))
    for name, count in snapshot["counters"].items():
        setattr(model, name, count)
    setattr(model, PROGRESS, snapshot["progress"])
    generators = snapshot["generators"]
    random.setstate(_python_state(*generators["python"]))
    np.random.set_state(generators["numpy"])  # noqa: NPY002  (Stable-Baselines3 draws from it)
    torch.set_rng_state(torch.from_numpy(generators["torch"]))
    model.action_space._np_random = generators["actions"]
    buffer = getattr(model, "replay_buffer", None)
    if buffer is not None:
        for name, values in zip(REPLAY, snapshot["replay"], strict=True):
            getattr(buffer, name)[: len(values)] = values
        buffer.pos, buffer.full = snapshot["position"]


def _array(tensor: torch.Tensor) -> np.ndarray:
    return np.asarray(tensor.detach().cpu().numpy())


def _optimizers(model: BaseAlgorithm) -> Iterator[tuple[str, torch.optim.Optimizer]]:
    """Yield the optimisers of all networks and variables by their names."""
    for name in model._get_torch_save_params()[0]:
        if name != POLICY:
            yield name, attrgetter(name)(model)


def _variables(model: BaseAlgorithm) -> Iterator[tuple[str, torch.Tensor]]:
    """Yield trained numbers outside of networks and optimisers, such as SAC's entropy coefficient."""
    for name in model._get_torch_save_params()[1]:
        yield name, attrgetter(name)(model)


def _moments(optimizer: torch.optim.Optimizer) -> dict[str, Any]:
    """Return Adam's moments and count of steps by the index of each parameter; empty before the first step.

    Its settings are the configuration's, and its learning rate is set anew at each update.
    """
    state = optimizer.state_dict()["state"]
    return {str(index): {part: _array(tensor) for part, tensor in parts.items()} for index, parts in state.items()}


def _form_of_moments(optimizer: torch.optim.Optimizer) -> dict[str, Any]:
    """Return the form of :func:`_moments` after a step."""
    parameters = [parameter for group in optimizer.param_groups for parameter in group["params"]]
    step = np.zeros((), dtype=np.float32)
    return {
        str(index): {"step": step} | dict.fromkeys(MOMENTS, _array(parameter))
        for index, parameter in enumerate(parameters)
    }


def _generators(model: BaseAlgorithm) -> dict[str, Any]:
    """Return the states of all generators that a training draws from, but for the environments'."""
    _, words, spare = random.getstate()
    return {
        "python": (np.array(words, dtype=np.uint32), spare),
        "numpy": np.random.get_state(),  # noqa: NPY002
        "torch": torch.get_rng_state().numpy(),
        "actions": model.action_space.np_random,
    }


def _check_generators(generators: dict[str, Any]) -> None:
    """Raise ValueError for states that generators do not take, or would read beyond their memory with."""
    words, spare = generators["python"]
    if not (spare is None or isinstance(spare, float)):
        raise ValueError("generators.python.1: must be a number or null")
    random.Random().setstate(_python_state(words, spare))  # raises ValueError
    name, _, position, has_spare, _ = generators["numpy"]
    if name != "MT19937":
        raise ValueError(f"generators.numpy.0 = {name!r}: must be 'MT19937'")
    _check_range("generators.numpy.2", position, 0, NUMPY_WORDS)
    _check_range("generators.numpy.3", has_spare, 0, 1)
    try:
        torch.Generator().set_state(torch.from_numpy(generators["torch"]))
    except RuntimeError:
        raise ValueError("generators.torch: is no state of torch's generator") from None


def _python_state(words: np.ndarray, spare: float | None) -> tuple[int, tuple[int, ...], float | None]:
    return random.Random.VERSION, tuple(words.tolist()), spare


def _at(value: Any, *keys: str) -> Any:
    """Return what lies at a path of nested mappings, None if there is nothing."""
    for key in keys:
        value = value.get(key) if isinstance(value, dict) else None
    return value


def _names(value: Any) -> list[str]:
    """Return the keys of a mapping, none of anything else."""
    return list(value) if isinstance(value, dict) else []


def _filled(buffer: Any) -> int:
    """Return how many rows of a replay buffer hold samples."""
    return int(buffer.buffer_size if buffer.full else buffer.pos)


def _leaves(value: Any, where: str) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the arrays in nested mappings with their places."""
    if isinstance(value, dict):
        for name, entry in value.items():
            yield from _leaves(entry, f"{where}.{name}")
    else:
        yield where, value


def _check_range(where: str, value: int, least: int, most: int) -> None:
    if isinstance(value, bool) or not least <= value <= most:
        raise ValueError(f"{where} = {value}: must be from {least} to {most}")
