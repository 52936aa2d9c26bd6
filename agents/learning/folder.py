"""The folder of a training: what its files are called, and what was trained."""

from __future__ import annotations

import json
from pathlib import Path

from agents.learning.config import TrainConfig, from_dict
from sffr_gym.params import ConfigError

CONFIG, PROGRESS, CHECKPOINTS = "train.json", "progress.csv", "checkpoints"
BEST, LAST = "best.npz", "last.npz"


def read_run(out: Path) -> tuple[TrainConfig, int]:
    """Configuration and seed of a run folder; raises ConfigError if it holds no training."""
    if not (out / CONFIG).is_file():
        raise ConfigError(f"{out}: holds no training ({CONFIG} is missing)")
    kept = json.loads((out / CONFIG).read_text(encoding="utf-8"))
    return from_dict(kept["config"]), int(kept["seed"])
