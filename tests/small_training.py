"""Trainings that take a second, for the tests of learning."""

import json

import numpy as np
import pytest

from sffr_agents.config import load_config
from sffr_agents.folder import CHECKPOINTS

SMALL = [
    "n_envs=2", "environment.duration=1.0", "network.hidden=[8, 8]", "network.actor=null",
    "validation.scenarios=[nominal]", "validation.duration=0.2", "validation.every=150", "checkpoints.every=64",
]  # fmt: skip
PPO_SMALL = [*SMALL, "steps=200", "learning.n_steps=8", "learning.batch_size=16", "learning.n_epochs=2"]
REPLAY_SMALL = [
    *SMALL, "steps=160", "learning.learning_starts=40", "learning.batch_size=16", "learning.buffer_size=500",
    "learning.gradient_steps=2",
]  # fmt: skip
CONTRIB = {"tqc", "crossq"}


def small(algo, *changes):
    """A training of an algorithm, skipped if that is not installed."""
    if algo in CONTRIB:
        pytest.importorskip("sb3_contrib")
    return load_config(algo, [*(PPO_SMALL if algo == "ppo" else REPLAY_SMALL), *changes])


def weights(folder):
    """The policy's weights in a run's last checkpoint."""
    last = sorted((folder / CHECKPOINTS).glob("[0-9]*"))[-1]
    networks = json.loads((last / "state.json").read_text())["state"]["items"]["networks"]["items"]
    with np.load(last / "arrays.npz") as arrays:
        return {name: arrays[entry["array"]] for name, entry in networks.items()}


def assert_same(first, second):
    """Two dictionaries hold the same arrays, bit for bit."""
    assert first.keys() == second.keys()
    for name, array in first.items():
        assert array.tobytes() == second[name].tobytes(), name
