"""Learning algorithms by name, built from a training's configuration."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.vec_env import VecMonitor

from sffr_agents.config import TrainConfig
from sffr_agents.energy_scaling import EnergyPolicy, EnergyReplayBuffer, EnergyRolloutBuffer, SchedulePolicy
from sffr_agents.sb3_vec_env import make_sb3_vec_env
from sffr_gym.config.strict_yaml import ConfigError

CLASSES = {
    "ppo": ("stable_baselines3", "PPO"),
    "sac": ("stable_baselines3", "SAC"),
    "td3": ("stable_baselines3", "TD3"),
    "tqc": ("sb3_contrib", "TQC"),
    "crossq": ("sb3_contrib", "CrossQ"),
}
ADAPT_ENTROPY = ("sac", "tqc", "crossq")
ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}


def make_model(config: TrainConfig, seed: int) -> tuple[BaseAlgorithm, VecMonitor]:
    """Return the algorithm with its environments, both seeded.

    Args:
        config: of the training.
        seed: environment i gets ``seed + i``.

    Raises:
        ConfigError: for an environment that is not valid, or an algorithm that is not installed.
    """
    torch.set_num_threads(1)  # the networks are small, and sums would depend on the number of threads
    env = VecMonitor(make_sb3_vec_env(config.n_envs, config.network.per_panel, **config.environment.model_dump()))
    settings: dict[str, Any] = config.learning.model_dump()
    hidden, actor = config.network.hidden, config.network.actor
    critic = "vf" if config.algo == "ppo" else "qf"
    network: dict[str, Any] = {
        "net_arch": {"pi": list(hidden if actor is None else actor), critic: list(hidden)},
        "activation_fn": ACTIVATIONS[config.network.activation],
    }
    settings["learning_rate"] = _linear_schedule(settings["learning_rate"], settings.pop("final_learning_rate"))
    policy: Any = "MlpPolicy"
    stacked = {"stack_size": config.environment.stack_size}
    by_energy = settings.pop("energy_scaling")
    if config.algo == "ppo":
        network |= {name: settings.pop(name) for name in ("log_std_init", "learn_spread")}
        policy = SchedulePolicy
        if by_energy:
            policy, settings["rollout_buffer_class"] = EnergyPolicy, EnergyRolloutBuffer
            settings["rollout_buffer_kwargs"] = stacked
            network |= stacked
    elif by_energy:
        settings["replay_buffer_class"] = EnergyReplayBuffer
        settings["replay_buffer_kwargs"] = {"gamma": settings["gamma"]} | stacked
    if config.algo in ADAPT_ENTROPY:
        settings["ent_coef"] = f"auto_{settings['ent_coef']}"
    if config.algo == "td3":
        spread = np.full(env.action_space.shape or (), settings["action_noise"])
        settings["action_noise"] = NormalActionNoise(np.zeros_like(spread), spread)
    algorithm = _algorithm_class(config.algo)
    return algorithm(policy, env, seed=seed, device="cpu", policy_kwargs=network, **settings), env


def _linear_schedule(first: float, last: float) -> Any:
    """Return a learning rate that goes from ``first`` to ``last`` with the part of the steps that is done."""
    return lambda remaining: last + (first - last) * remaining


def _algorithm_class(name: str) -> Any:
    """Import an algorithm; raises ConfigError if it is not installed."""
    package, algorithm = CLASSES[name]
    try:
        return getattr(importlib.import_module(package), algorithm)
    except ModuleNotFoundError as error:
        raise ConfigError(f"{name} needs {error.name}: pip install 'sffr-gym[agents]'") from None
