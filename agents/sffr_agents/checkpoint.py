"""Checkpoints from which a killed training resumes with bitwise identical results; written whole or not at all.

A folder with two files, ``state.json`` and ``arrays.npz``: weights, optimisers, random number generators, the state of
every environment and the replay buffer. Plain numbers alone: nothing of it is run when it is read, and all of it is
compared with what the training expects before anything of the training is changed.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import warnings
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecMonitor

from sffr_agents import snapshot
from sffr_agents.folder import Tell
from sffr_agents.plain import decode, encode
from sffr_gym.config.reading import read_arrays, read_json
from sffr_gym.config.sections import Section
from sffr_gym.config.strict_yaml import ConfigError, build, check_error

FORMAT = "sffr-checkpoint-1"
STATE, ARRAYS = "state.json", "arrays.npz"
NAME, UNFINISHED = re.compile(r"\d{6}"), re.compile(r"\.\d{6}\.\d+")
MOST_STATE = 8_000_000  # bytes; 64 environments have 20,000
MOST_HEADERS = 1_000_000  # bytes of an archive beside its numbers
WINDOW = 100  # episodes whose mean Stable-Baselines3 logs

Score = Annotated[float, Field(allow_inf_nan=True)]
Count = Annotated[int, Field(ge=0, le=snapshot.MOST_COUNT)]


class Notes(Section):
    """What a training wants to know again beside the state of its algorithm and environments."""

    validated: Count = Field(default=0, description="steps at the last comparison with AHSC")
    saved: Count = Field(default=0, description="steps at the last checkpoint")
    scores: dict[str, Score] = Field(default={}, description="of the last comparison")
    best_scores: dict[str, Score] = Field(default={}, description="of the best policy")
    elapsed: float = Field(default=0.0, ge=0.0, description="time of all processes [s]")
    pending: tuple[tuple[str, int | Score, tuple[str, ...]], ...] = Field(
        default=(), description="what waits for the next row of the log, and for each the outputs that do not get it"
    )
    episodes: tuple[tuple[Score, Count], ...] = Field(
        default=(), max_length=WINDOW, description="returns and lengths of the last ones"
    )

    @model_validator(mode="after")
    def _complete_scores(self) -> Self:
        for scores in (self.scores, self.best_scores):
            names = {name.removesuffix("/cost") for name in scores if name.endswith("/cost")}
            needed = {"cost"} | {f"{name}/{measure}" for name in names for measure in ("vibration", "tracking")}
            if scores and not needed <= scores.keys():
                raise check_error(f"has scores without {min(needed - scores.keys())!r}")
        if bool(self.scores) != bool(self.best_scores):
            raise check_error("has either scores or best_scores")
        return self


class Written(Section):
    """What ``state.json`` holds."""

    format: Literal["sffr-checkpoint-1"] = Field(description="of the folder")
    notes: Any = Field(description="see Notes")
    state: Any = Field(description="see snapshot.take")


def save_checkpoint(folder: Path, model: BaseAlgorithm, env: VecMonitor, notes: Notes, keep: int) -> None:
    """Write a checkpoint between two rollouts, and remove all but the last ones.

    Args:
        folder: of the run's checkpoints; what else lies in it stays.
        model: after its last update.
        env: its environments, see :func:`sb3_vec_env.batch_of`.
        notes: what the training wants to know again.
        keep: how many checkpoints stay.

    Raises:
        OSError: if the disk is full, or the folder cannot be written to.
    """
    folder.mkdir(parents=True, exist_ok=True)
    remove_unfinished(folder)
    arrays: dict[str, np.ndarray] = {}
    written = {
        "format": FORMAT, "notes": encode(notes.model_dump(), arrays),
        "state": encode(snapshot.take(model, env), arrays),
    }  # fmt: skip
    own = [path for path in _numbered(folder) if _is_ours(path)]
    number = 1 + (int(own[-1].name) if own else 0)
    while os.path.lexists(place := folder / f"{number:06d}"):  # of others, or damaged
        number += 1
    unfinished = folder / f".{place.name}.{os.getpid()}"
    unfinished.mkdir()
    try:
        np.savez(unfinished / ARRAYS, allow_pickle=False, **arrays)
        (unfinished / STATE).write_text(json.dumps(written, allow_nan=False), encoding="utf-8")
        for file in unfinished.iterdir():
            with file.open("rb") as content:
                os.fsync(content.fileno())
        unfinished.rename(place)
    except BaseException:
        shutil.rmtree(unfinished, ignore_errors=True)
        raise
    for old in [*own, place][:-keep]:
        shutil.rmtree(old)


def load_checkpoint(folder: Path, model: BaseAlgorithm, env: VecMonitor, tell: Tell = warnings.warn) -> Notes:
    """Put model, environments and random number generators back to the last checkpoint that is whole.

    Args:
        folder: of the run's checkpoints.
        model: as it was built from the configuration.
        env: its environments.
        tell: called with a line for each later checkpoint that is damaged.

    Raises:
        ConfigError: if there is none, or all are damaged; model and environments have not changed then.
    """
    found = _numbered(folder)
    if not found:
        raise ConfigError(f"{folder}: holds no checkpoint")
    damages: list[str] = []
    for checkpoint in reversed(found):
        try:
            notes = _load(checkpoint, model, env)
        except ConfigError as error:
            damages.append(str(error).splitlines()[0])
            continue
        for damage in damages:
            tell(f"{damage}; {checkpoint.name} is taken, an earlier checkpoint")
        return notes
    raise ConfigError("\n".join(damages))


def holds_checkpoint(folder: Path) -> bool:
    """Say whether a folder holds checkpoints, whole or not."""
    return bool(_numbered(folder))


def remove_unfinished(folder: Path) -> None:
    """Remove checkpoints that killed processes had begun to write."""
    for path in folder.glob(".*"):
        if UNFINISHED.fullmatch(path.name) and _holds_only_ours(path):
            shutil.rmtree(path)


def _load(checkpoint: Path, model: BaseAlgorithm, env: VecMonitor) -> Notes:
    """Put a training back to a checkpoint; raises ConfigError if that is damaged, or of another training."""
    file = checkpoint / STATE
    data = read_json(file, MOST_STATE)
    if not isinstance(data, dict):
        raise ConfigError(f"{file}: must hold a mapping of keys to values")
    written = build(Written, data, lambda key: str(file))
    try:
        notes = decode(written.notes, None, {})
        if not isinstance(notes, dict):
            raise ValueError("notes: must be a mapping of keys to values")
        form = snapshot.template(model, env, decode(written.state, None, {}))
        arrays = read_arrays(checkpoint / ARRAYS, _size(form) + MOST_HEADERS)
        state = decode(written.state, form, arrays)
        snapshot.check(state, form)
        kept = build(Notes, notes, lambda key: str(file))
        snapshot.restore(state, model, env)
    except ConfigError:
        raise
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{file}: is no checkpoint of this training: {str(error)[:200]}") from None
    return kept


def _size(value: Any) -> int:
    """Return the bytes of all arrays in nested values."""
    if isinstance(value, np.ndarray):
        return value.nbytes
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, list | tuple) else ()
    return sum(map(_size, parts))


def _numbered(folder: Path) -> list[Path]:
    """Return the folders that have a name of ours, the oldest first."""
    return sorted(path for path in folder.glob("[0-9]*") if NAME.fullmatch(path.name) and path.is_dir())


def _is_ours(path: Path) -> bool:
    """Say whether a folder holds a checkpoint of this program and nothing else."""
    if not _holds_only_ours(path):
        return False
    try:
        data = read_json(path / STATE, MOST_STATE)
    except ConfigError:
        return False
    return isinstance(data, dict) and data.get("format") == FORMAT


def _holds_only_ours(path: Path) -> bool:
    """Say whether a folder, no link to one, holds nothing but files of the names that are written here."""
    if path.is_symlink() or not path.is_dir():
        return False
    return all(file.name in (STATE, ARRAYS) and file.is_file() and not file.is_symlink() for file in path.iterdir())
