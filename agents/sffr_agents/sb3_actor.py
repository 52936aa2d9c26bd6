"""The actor in a zip of plain Stable-Baselines3 or of the RL Zoo, made of its weights alone.

Names and shapes of the weights say what network it is, whatever wrote the zip; only the units of the hidden layers
are not in them. Those are named in the text ``data`` of the zip, beside pickles that are left alone.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sffr_agents.config import Environment, build_section
from sffr_agents.sb3_zip import read_data, read_weights
from sffr_baselines.damping_env import SFFRFlexDampingEnv
from sffr_baselines.learned import LearnedSchedule, Network, save_schedule
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.types import Array

UNITS = {"Tanh": False, "ReLU": True}  # hidden layers that a policy's file knows, and whether they are rectified


def export_plain_zip(source: Path, file: Path, changes: tuple[str, ...] = ()) -> None:
    """Write the policy of a zip whose network is not that of a configuration.

    Args:
        source: the zip, of PPO, A2C, TRPO, SAC, TD3, DDPG or TQC with an ``MlpPolicy``.
        file: where the policy goes.
        changes: assignments to the arguments of ``SFFRFlexDamping-v0`` that it was trained with, such as ``law=hsc``.

    Raises:
        ConfigError: if the zip cannot be read, its network has no counterpart in a policy's file, or it fits neither
            the observations and actions of the environment nor those of one panel.
    """
    asked = build_section(Environment, {}, lambda key: "--set", changes)
    arguments = asked.model_dump() | {"overrides": list(asked.overrides)}
    network = read_actor(source)
    try:
        schedule = LearnedSchedule.of(network, SFFRFlexDampingEnv(**arguments), {"source": source.name})
    except ConfigError as error:
        raise ConfigError(f"{source}: {error} of SFFRFlexDamping-v0") from None
    file.parent.mkdir(parents=True, exist_ok=True)
    save_schedule(file, schedule)


def read_actor(source: Path) -> Network:
    """Return the deterministic actor of a zip.

    Raises:
        ConfigError: if the zip cannot be read, or its network is none of linear layers with tanh or rectified units.
    """
    weights = read_weights(source)
    try:
        layers, squash, units = _layers(weights)
        settings = read_data(source).get("policy_kwargs")
        return Network(
            tuple(_of(weights, f"{name}.weight") for name in layers),
            tuple(_of(weights, f"{name}.bias") for name in layers),
            UNITS[_units(settings if isinstance(settings, Mapping) else {}, units)], squash,
        )  # fmt: skip
    except (ConfigError, ValueError) as error:
        raise ConfigError(f"{source}: cannot be exported: {error}") from None


def _layers(weights: Mapping[str, Array]) -> tuple[list[str], bool, str]:
    """Return the names of the actor's layers from the first to the last, whether a tanh follows, and its usual units.

    Raises:
        ValueError: for a network that is none of linear layers, or whose observation passes through something else.
    """
    if strange := [name for name in weights if re.search(r"features_extractor|lstm|cnn", name)]:
        raise ValueError(f"its policy has {strange[0]}, not an MlpPolicy's layers alone")
    if strange := [name for name in weights if name.startswith("actor.") and name.endswith("ra_mean")]:
        raise ValueError(f"its policy normalises layers ({strange[0]}); name its configuration with --algo")
    for hidden, head, squash, units in (
        ("mlp_extractor.policy_net", "action_net", False, "Tanh"),
        ("actor.latent_pi", "actor.mu", True, "ReLU"),
        ("actor.mu", None, True, "ReLU"),
    ):
        if head is None or f"{head}.weight" in weights:
            numbers = [re.fullmatch(rf"{re.escape(hidden)}\.(\d+)\.weight", name) for name in weights]
            names = [f"{hidden}.{k}" for k in sorted(int(found[1]) for found in numbers if found)]
            layers = [*names, *([head] if head else [])]
            if layers and all(f"{name}.bias" in weights for name in layers):
                return layers, squash, units
    raise ValueError("its policy has no actor of linear layers; those of PPO, A2C, TRPO, SAC, TD3, DDPG and TQC have")


def _units(settings: Mapping[str, Any], usual: str) -> str:
    """Return the units of the hidden layers; raises ValueError for others than tanh and rectified ones."""
    if "True" in str(settings.get("squash_output", "")):
        raise ValueError("its policy was made with squash_output")
    named = re.search(r"\.(\w+)'>", str(settings.get("activation_fn", "")))
    units = named[1] if named else usual
    if units not in UNITS:
        raise ValueError(f"its policy has the units {units}, not one of {', '.join(UNITS)}")
    return units


def _of(weights: Mapping[str, Array], name: str) -> Array:
    return np.asarray(weights[name], dtype=np.float64)
