"""The folder of a training: what its files are called, what was trained, and where it comes from."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from sffr_agents.config import TrainConfig, from_dict
from sffr_gym.config.files import to_json, write_whole
from sffr_gym.config.provenance import MANIFEST
from sffr_gym.config.strict_yaml import ConfigError

CONFIG, PROGRESS, CHECKPOINTS = "train.json", "progress.csv", "checkpoints"
STEPS = "steps"  # column of the progress file
BEST, LAST = "best.npz", "last.npz"


def holds_run(out: Path) -> bool:
    """Say whether a folder holds a training, finished or not."""
    return (out / CONFIG).is_file()


def begin_run(out: Path, config: TrainConfig, seed: int, facts: dict[str, Any]) -> None:
    """Write where a training comes from, then what it is, as the sign that the folder holds one."""
    out.mkdir(parents=True, exist_ok=True)
    write_whole(out / MANIFEST, to_json(facts).encode())
    write_whole(out / CONFIG, to_json({"seed": seed, "config": config.model_dump(mode="json")}).encode())


def finish_run(out: Path, elapsed: float) -> None:
    """Note how long a training took in all [s]."""
    facts = json.loads((out / MANIFEST).read_text(encoding="utf-8"))
    write_whole(out / MANIFEST, to_json(facts | {"duration_s": elapsed}).encode())


def read_run(out: Path) -> tuple[TrainConfig, int]:
    """Return configuration and seed of a run folder; raises ConfigError if it holds no training."""
    if not holds_run(out):
        raise ConfigError(f"{out}: holds no training ({CONFIG} is missing)")
    kept = json.loads((out / CONFIG).read_text(encoding="utf-8"))
    return from_dict(kept["config"]), int(kept["seed"])
