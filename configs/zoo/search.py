"""Where the RL Zoo's search looks for PPO's hyperparameters, given as its ``--conf-file`` (docs/clients/zoo.md).

The zoo's own space has no falling learning rates, no spread of the actions but 1 at the start, and minibatches of four
samples. What is not searched is as in ``ppo.yml``, and the second trial is that file's settings.
"""

from __future__ import annotations

import copy
import math
from typing import Any

import optuna
import yaml
from rl_zoo3.hyperparams_opt import HYPERPARAMS_SAMPLER
from rl_zoo3.utils import SimpleLinearSchedule

from sffr_gym.config.strict_yaml import config_dir

ID = {4: "SFFRFlexDamping-v0", 15: "SFFRFlex-v0"}  # by the number of actions, all that a sampler is told
RANGES = {  # on a logarithmic scale
    "SFFRFlexDamping-v0": {
        "learning_rate": (5e-4, 1e-2), "one_minus_gamma": (5e-3, 0.1), "one_minus_gae_lambda": (0.01, 0.3),
        "spread": (0.2, 1.0),
    },
    "SFFRFlex-v0": {
        "learning_rate": (1e-5, 3e-3), "one_minus_gamma": (2e-4, 0.02), "one_minus_gae_lambda": (0.005, 0.1),
        "spread": (0.01, 0.5),
    },
}  # fmt: skip
CHOICES: dict[str, dict[str, list[Any]]] = {
    "SFFRFlexDamping-v0": {
        "n_steps": [150, 300, 600], "batch_size": [300, 600, 1200], "n_epochs": [3, 6, 12],
        "clip_range": [0.1, 0.2, 0.3], "actor": ["32", "64 64"],
    },
    "SFFRFlex-v0": {
        "n_steps": [1024, 2048, 4096], "batch_size": [512, 2048, 8192], "n_epochs": [3, 5, 10],
        "clip_range": [0.1, 0.2, 0.3], "actor": ["64 64", "256 256"],
    },
}  # fmt: skip

hyperparams = yaml.safe_load((config_dir() / "zoo" / "ppo.yml").read_text(encoding="utf-8"))
FILE = copy.deepcopy(hyperparams)  # the zoo changes the other


def sample(trial: optuna.Trial, n_actions: int, n_envs: int, additional_args: dict[str, Any]) -> dict[str, Any]:
    """Return a trial's hyperparameters, as the zoo hands them to PPO."""
    name = ID[n_actions]
    if trial.number == 0:
        trial.study.enqueue_trial(start(FILE[name]))
    drawn = {key: trial.suggest_float(key, *bounds, log=True) for key, bounds in RANGES[name].items()}
    chosen = {key: trial.suggest_categorical(key, values) for key, values in CHOICES[name].items()}
    actor = [int(width) for width in chosen.pop("actor").split()]
    critic = FILE[name]["policy_kwargs"]["net_arch"]["vf"]
    return chosen | {
        "learning_rate": SimpleLinearSchedule(drawn["learning_rate"]),
        "gamma": 1.0 - drawn["one_minus_gamma"],
        "gae_lambda": 1.0 - drawn["one_minus_gae_lambda"],
        "policy_kwargs": {"log_std_init": math.log(drawn["spread"]), "net_arch": {"pi": actor, "vf": critic}},
    }


def start(settings: dict[str, Any]) -> dict[str, Any]:
    """Return a file's settings in the terms of the search."""
    kept = {key: settings[key] for key in ("n_steps", "batch_size", "n_epochs", "clip_range")}
    return kept | {
        "learning_rate": float(settings["learning_rate"].removeprefix("lin_")),
        "one_minus_gamma": 1.0 - settings["gamma"],
        "one_minus_gae_lambda": 1.0 - settings["gae_lambda"],
        "spread": math.exp(settings["policy_kwargs"]["log_std_init"]),
        "actor": " ".join(map(str, settings["policy_kwargs"]["net_arch"]["pi"])),
    }


HYPERPARAMS_SAMPLER["ppo"] = sample
