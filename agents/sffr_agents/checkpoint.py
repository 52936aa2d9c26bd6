"""Checkpoints from which a killed training resumes with bitwise identical results; written whole or not at all.

A folder with the weights and optimisers (read with ``weights_only``), the random number generators, the state of every
environment and the replay buffer. Plain numbers alone: nothing of it is run when it is read.
"""

from __future__ import annotations

import json
import os
import random
import shutil
from collections.abc import Iterable
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecMonitor

from sffr_agents.sb3_vec_env import batch_of
from sffr_gym.config.strict_yaml import ConfigError

COUNTERS = ("num_timesteps", "_n_updates", "_episode_num", "_current_progress_remaining")
REPLAY = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def save_checkpoint(folder: Path, model: BaseAlgorithm, env: VecMonitor, notes: dict[str, Any], keep: int) -> None:
    """Write a checkpoint between two rollouts, and remove all but the last ones.

    Args:
        folder: of the run's checkpoints.
        model: after its last update.
        env: its environments, see :func:`sb3_vec_env.batch_of`.
        notes: what the training wants to know again, of plain values.
        keep: how many checkpoints stay.
    """
    folder.mkdir(parents=True, exist_ok=True)
    arrays: dict[str, np.ndarray] = {}
    tree = {"notes": notes, "state": _encode(_state(model, env), arrays)}
    before = _finished(folder)
    number = int(before[-1].name) + 1 if before else 1
    unfinished = folder / "unfinished"
    shutil.rmtree(unfinished, ignore_errors=True)
    unfinished.mkdir()
    torch.save(
        {"parameters": model.get_parameters(), "variables": _variables(model), "rng": torch.get_rng_state()},
        unfinished / "weights.pt",
    )
    np.savez(unfinished / "arrays.npz", allow_pickle=False, **arrays)
    (unfinished / "state.json").write_text(json.dumps(tree))
    for file in unfinished.iterdir():
        with file.open("rb") as written:
            os.fsync(written.fileno())
    unfinished.rename(folder / f"{number:06d}")
    for old in _finished(folder)[:-keep]:
        shutil.rmtree(old)


def load_checkpoint(folder: Path, model: BaseAlgorithm, env: VecMonitor) -> dict[str, Any]:
    """Put model, environments and random number generators back to the last checkpoint, and return its notes.

    Raises:
        ConfigError: if there is none.
    """
    finished = _finished(folder)
    if not finished:
        raise ConfigError(f"{folder}: holds no checkpoint to resume from")
    saved = torch.load(finished[-1] / "weights.pt", weights_only=True)
    model.set_parameters(saved["parameters"])
    for name, value in saved["variables"].items():
        attrgetter(name)(model).data.copy_(value)
    tree: dict[str, Any] = json.loads((finished[-1] / "state.json").read_text())
    with np.load(finished[-1] / "arrays.npz", allow_pickle=False) as arrays:
        _restore(_decode(tree["state"], _state(model, env), arrays), model, env)
    torch.set_rng_state(saved["rng"])
    notes: dict[str, Any] = tree["notes"]
    return notes


def _state(model: BaseAlgorithm, env: VecMonitor) -> dict[str, Any]:
    """Return everything beside the weights that the future depends on."""
    if model._last_obs is None:
        model._last_obs = env.reset()  # type: ignore[assignment]  # an array, as the observation space is a box
        model._last_episode_starts = np.ones(env.num_envs, dtype=bool)
    state = batch_of(env).get_state()
    del state["scenario"]
    buffer = getattr(model, "replay_buffer", None)
    filled = 0 if buffer is None else buffer.buffer_size if buffer.full else buffer.pos
    return {
        "environments": state,
        "monitor": (env.episode_returns, env.episode_lengths),
        "last": (model._last_obs, model._last_episode_starts),
        "counters": {name: getattr(model, name) for name in COUNTERS},
        "random": random.getstate(),
        "numpy": np.random.get_state(),  # noqa: NPY002  (Stable-Baselines3 draws from it)
        "actions": model.action_space.np_random,
        "replay": [getattr(buffer, name)[:filled] for name in REPLAY] if buffer else [],
        "position": (buffer.pos, buffer.full) if buffer else (0, False),
    }


def _restore(state: dict[str, Any], model: BaseAlgorithm, env: VecMonitor) -> None:
    """Undo :func:`_state`."""
    batch = batch_of(env)
    batch.set_state(state["environments"] | {"scenario": batch.scenario})
    env.episode_returns, env.episode_lengths = state["monitor"]
    model._last_obs, model._last_episode_starts = state["last"]
    for name, value in state["counters"].items():
        setattr(model, name, value)
    version, words, gauss = state["random"]
    random.setstate((version, tuple(words), gauss))
    np.random.set_state(state["numpy"])  # noqa: NPY002
    model.action_space._np_random = state["actions"]
    buffer = getattr(model, "replay_buffer", None)
    if buffer is not None:
        for name, values in zip(REPLAY, state["replay"], strict=True):
            getattr(buffer, name)[: len(values)] = values
        buffer.pos, buffer.full = state["position"]


def _encode(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    """Return the value as JSON, its arrays by their names in ``arrays``."""
    if isinstance(value, np.ndarray):
        name = f"a{len(arrays)}"
        arrays[name] = value
        return {"array": name}
    if isinstance(value, np.random.Generator):
        return {"generator": _encode(value.bit_generator.state, arrays)}
    if isinstance(value, dict):
        return {"items": {name: _encode(entry, arrays) for name, entry in value.items()}}
    if isinstance(value, list | tuple):
        return [_encode(entry, arrays) for entry in value]
    return value.item() if isinstance(value, np.generic) else value


def _decode(saved: Any, template: Any, arrays: Any) -> Any:
    """Undo :func:`_encode`; tuples with names are those of the template."""
    if isinstance(saved, list):
        parts = template if isinstance(template, list | tuple) and len(template) == len(saved) else [None] * len(saved)
        values = [_decode(entry, part, arrays) for entry, part in zip(saved, parts, strict=True)]
        if hasattr(template, "_fields"):
            return type(template)(*values)
        return tuple(values) if isinstance(template, tuple) else values
    if not isinstance(saved, dict):
        return saved
    if "array" in saved:
        return arrays[saved["array"]]
    if "generator" in saved:
        state = _decode(saved["generator"], None, arrays)
        generator = np.random.Generator(getattr(np.random, state["bit_generator"])())
        generator.bit_generator.state = state
        return generator
    known = template if isinstance(template, dict) else {}
    return {name: _decode(entry, known.get(name), arrays) for name, entry in saved["items"].items()}


def _variables(model: BaseAlgorithm) -> dict[str, torch.Tensor]:
    """Return trained numbers outside of networks and optimisers, such as SAC's entropy coefficient."""
    names: Iterable[str] = model._get_torch_save_params()[1]
    return {name: attrgetter(name)(model).data for name in names}


def _finished(folder: Path) -> list[Path]:
    """Return the complete checkpoints, the oldest first."""
    return sorted(path for path in folder.glob("[0-9]*") if path.is_dir())
