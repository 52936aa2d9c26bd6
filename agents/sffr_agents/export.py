"""A trained policy as one ``.npz`` file of plain numbers, which runs without torch and without pickle."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.common.vec_env import VecMonitor
from torch import nn

from sffr_agents.algorithms import make_model
from sffr_agents.checkpoint import load_checkpoint
from sffr_agents.config import TrainConfig
from sffr_agents.folder import CHECKPOINTS, Tell, read_run
from sffr_agents.sb3_vec_env import batch_of
from sffr_agents.sb3_zip import MOST_ZIP, first_line, read_weights
from sffr_agents.validation import hash_of_suite
from sffr_baselines.learned import LearnedSchedule, Network, save_schedule
from sffr_gym.config.reading import read_bytes
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.config.template import conform
from sffr_gym.types import Array


def origin_of(config: TrainConfig, **more: Any) -> dict[str, Any]:
    """Return what a policy's file says of its training: algorithm, hashes of configuration and suite, and more."""
    suite = hash_of_suite(config.validation, config.environment.robot())
    return {"algo": config.algo, "config_hash": config.hash(), "suite_hash": suite} | more


def network_of(model: Any) -> Network:
    """Return the deterministic actor of a Stable-Baselines3 model as plain layers.

    Args:
        model: a PPO, SAC, TD3, TQC or CrossQ model with an ``MlpPolicy`` of tanh or rectified layers.

    Raises:
        ValueError: for a layer that has no counterpart, or features that are not the observation.
    """
    policy = model.policy
    if not isinstance(extractor := getattr(policy, "actor", policy).features_extractor, FlattenExtractor):
        raise ValueError(f"a policy with a {type(extractor).__name__} cannot be exported")
    if hasattr(policy, "mlp_extractor"):
        head = policy.action_net if isinstance(policy.action_net, nn.Sequential) else [policy.action_net]
        return network_of_layers([*policy.mlp_extractor.policy_net, *head])
    actor = policy.actor
    if isinstance(actor.mu, nn.Sequential):  # TD3
        return network_of_layers(actor.mu)
    return network_of_layers([*actor.latent_pi, actor.mu, nn.Tanh()])


def network_of_layers(modules: Iterable[nn.Module]) -> Network:
    """Return linear layers with the normalisations between them folded in, and what kind of units they have.

    Raises:
        ValueError: for layers of other kinds, hidden units that differ, or an output through more than tanh.
    """
    matrices: list[Array] = []
    biases: list[Array] = []
    kinds: list[str] = []
    scale, shift = 1.0, 0.0  # of a normalisation that waits for the next linear layer
    for module in modules:
        if isinstance(module, nn.Linear):
            matrix, bias = _array(module.weight), _array(module.bias)
            biases.append(bias + matrix @ np.broadcast_to(shift, matrix.shape[1]))
            matrices.append(matrix * scale)
            scale, shift = 1.0, 0.0
            kinds.append("")
        elif isinstance(module, nn.Tanh | nn.ReLU):
            kinds[-1] = type(module).__name__.lower()
        elif hasattr(module, "ra_mean"):
            scale, shift = _affine(module)
        else:
            raise ValueError(f"a policy with a layer {module} cannot be exported")
    hidden = set(kinds[:-1])
    if len(hidden) > 1 or kinds[-1] not in ("", "tanh") or "" in hidden:
        raise ValueError(f"a policy with the layers {kinds} cannot be exported")
    return Network(tuple(matrices), tuple(biases), hidden == {"relu"}, kinds[-1] == "tanh")


def _affine(module: Any) -> tuple[Any, Any]:
    """Return scale and shift of sb3-contrib's batch renormalisation in use."""
    mean, variance = _array(module.ra_mean), _array(module.ra_var)
    scale = _array(module.scale) / np.sqrt(variance + module.eps)
    return scale, _array(module.bias) - mean * scale


def _array(tensor: torch.Tensor) -> Array:
    return tensor.detach().cpu().numpy().astype(np.float64)


def export_run(folder: Path, file: Path, tell: Tell = warnings.warn) -> None:
    """Write the policy of a run's last checkpoint that is whole.

    Args:
        folder: of the run.
        file: where the policy goes.
        tell: called with a line for each checkpoint that is damaged.

    Raises:
        ConfigError: if the folder holds no training or no checkpoint, or all are damaged.
    """
    config, seed = read_run(folder)
    model, env = make_model(config, seed)
    load_checkpoint(folder / CHECKPOINTS, model, env, tell)
    _write(model, env, config, file, seed=seed, steps=model.num_timesteps)


def export_zip(source: Path, config: TrainConfig, file: Path, trust: bool = False) -> None:
    """Write the policy of a Stable-Baselines3 zip.

    Its weights alone are read, into a model built from the configuration. What else is in a zip is pickled, and
    unpickling runs whatever code its author put there.

    Args:
        source: the zip.
        config: it was trained with.
        file: where the policy goes.
        trust: unpickle it all, so that the configuration's networks need not be the zip's.

    Raises:
        ConfigError: if it cannot be read or is damaged, or the weights do not fit the configuration.
    """
    if trust:
        read_bytes(source, MOST_ZIP)  # whether it is there, and a file
        model, env = make_model(config, seed=0)
        try:
            model = type(model).load(source, env=env, device="cpu")
        except Exception as error:  # whatever its code raises
            raise ConfigError(f"{source}: cannot be loaded by Stable-Baselines3: {first_line(error)}") from None
    else:
        weights = read_weights(source)
        model, env = make_model(config, seed=0)
        _put_weights(weights, model, source)
    try:
        _write(model, env, config, file, source=source.name)
    except ValueError as error:
        raise ConfigError(f"{source}: {first_line(error)}") from None


def _put_weights(weights: dict[str, np.ndarray], model: BaseAlgorithm, source: Path) -> None:
    """Give a model weights; raises ConfigError if they do not fit it."""
    own = {name: tensor.numpy() for name, tensor in model.policy.state_dict().items()}
    try:
        conform(weights, own, "policy")
    except ValueError as error:
        raise ConfigError(f"{source}: does not fit the configuration: {first_line(error)}; see --algo") from None
    model.policy.load_state_dict({name: torch.from_numpy(array.copy()) for name, array in weights.items()})


def _write(model: BaseAlgorithm, env: VecMonitor, config: TrainConfig, file: Path, **more: Any) -> None:
    """Write the policy of a model, and where it comes from."""
    batch = batch_of(env)
    about = origin_of(config, **more)
    schedule = LearnedSchedule.of(network_of(model), batch, about)
    file.parent.mkdir(parents=True, exist_ok=True)
    save_schedule(file, schedule)
