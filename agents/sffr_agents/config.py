"""Configurations of trainings, ``configs/train``: validated keys for each algorithm."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import os
from collections.abc import Sequence
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field, create_model

from sffr_baselines.damping_env import DURATION
from sffr_baselines.learned import MOST_WEIGHTS
from sffr_baselines.schedule import N_FEATURES
from sffr_baselines.scheduled import Scheduling
from sffr_gym.config.params import Params, load_params
from sffr_gym.config.ranges import MOST_ENVS, EpisodeLength, Share, at_most
from sffr_gym.config.sections import Section
from sffr_gym.config.strict_yaml import (
    ConfigError,
    Where,
    apply_overrides,
    build,
    find_config,
    read_mapping,
)

SectionT = TypeVar("SectionT", bound=Section)

VALIDATION_SEED = 900_000  # of the episodes that choose the best model; evaluation has its own
MOST_STEPS = 10**10  # of a training: days of the fastest
MOST_SAMPLES = 10**7  # kept for learning: about a GiB
MOST_LAYERS = 16  # of a network
QUANTILES = 25  # of each of TQC's critics

Steps = Annotated[int, Field(ge=1, le=MOST_STEPS)]
Width = Annotated[int, Field(ge=1, le=100_000)]
Coefficient = Annotated[float, Field(ge=0.0, le=1.0e6)]  # weight of a term of the loss
Entropy = Annotated[float, Field(ge=1.0e-9, le=1.0e6)]  # likewise, at the start of its adaptation
Spread = Annotated[float, Field(ge=0.0, le=2.0)]  # of actions, which lie in [-1, 1]


class Environment(Scheduling):
    """What the agent is trained in; see ``SFFRFlexDamping-v0``."""

    scenario: str = Field(default="excited", description="shipped scenario or file")
    duration: EpisodeLength | None = Field(default=DURATION, description="length of an episode [s]; null: scenario's")
    random_phase: bool = Field(default=True, description="start anywhere on the circle")
    overrides: tuple[str, ...] = Field(default=(), description="assignments to parameters, such as panel.EI=25")

    def robot(self) -> Params:
        """Return the robot before a scenario changes it, as the one of training does; raises ConfigError."""
        return load_params().with_overrides(*self.overrides)


class NetworkShape(Section):
    """Actor and critic."""

    hidden: Annotated[tuple[Width, ...], at_most(MOST_LAYERS, "none that deep learns here")] = Field(
        default=(64, 64), min_length=1, description="widths of the hidden layers"
    )
    actor: Annotated[tuple[Width, ...], at_most(MOST_LAYERS, "none that deep learns here")] | None = Field(
        default=None, description="widths of the actor's, if others; [] makes it linear in what it sees"
    )
    activation: Literal["tanh", "relu"] = Field(default="tanh", description="of the hidden layers")
    per_panel: bool = Field(default=True, description="one network serves each panel by itself")


class Validation(Section):
    """Episodes on which the agent is compared with AHSC during training."""

    scenarios: tuple[str, ...] = Field(
        default=("excited", "nominal"), min_length=1, description="whose mean cost counts"
    )
    episodes: int = Field(default=8, ge=1, le=1000, description="of each scenario that draws something")
    duration: EpisodeLength | None = Field(default=None, description="length [s]; null: the scenario's")
    every: Steps = Field(default=500_000, description="steps between two comparisons")


class Checkpoints(Section):
    """What a killed training resumes from."""

    every: Steps = Field(default=100_000, description="steps between two checkpoints")
    keep: int = Field(default=2, ge=1, le=1000, description="how many of the last ones stay")


class AlgorithmSettings(Section):
    """What all algorithms share."""

    learning_rate: float = Field(default=1.0e-3, ge=1.0e-12, le=1.0, description="at the start")
    final_learning_rate: float = Field(default=1.0e-4, ge=0.0, le=1.0, description="at the end, linearly")
    gamma: Share = Field(default=0.98, description="discount of an action")
    energy_scaling: bool = Field(default=True, description="values per energy of the panels; see energy_scaling.py")


class PPOSettings(AlgorithmSettings):
    """Arguments of Stable-Baselines3's PPO."""

    n_steps: int = Field(default=64, ge=2, le=MOST_SAMPLES, description="steps of each row between two updates")
    batch_size: int = Field(default=1024, ge=2, le=MOST_SAMPLES, description="samples of a gradient")
    n_epochs: int = Field(default=6, ge=1, le=1000, description="passes through the samples")
    gae_lambda: float = Field(default=0.95, ge=0.0, le=1.0, description="of the advantages")
    clip_range: float = Field(default=0.2, ge=1.0e-6, le=10.0, description="of the probability ratio")
    ent_coef: Coefficient = Field(default=0.0, description="weight of the entropy")
    vf_coef: Coefficient = Field(default=0.5, description="weight of the critic")
    max_grad_norm: float = Field(default=0.5, ge=1.0e-9, le=1.0e9, description="of the gradient")
    log_std_init: float = Field(default=-0.5, ge=-20.0, le=2.0, description="log of the actions' spread at the start")
    learn_spread: bool = Field(default=False, description="let the spread change; else it stays as it was")


class ReplaySettings(AlgorithmSettings):
    """What the algorithms with a replay buffer share."""

    buffer_size: int = Field(default=1_000_000, ge=1, le=MOST_SAMPLES, description="samples kept")
    learning_starts: Steps = Field(default=10_000, description="samples before the first gradient")
    batch_size: int = Field(default=512, ge=2, le=MOST_SAMPLES, description="samples of a gradient")
    train_freq: int = Field(default=1, ge=1, le=100_000, description="steps of each row between two updates")
    gradient_steps: int = Field(default=8, ge=1, le=100_000, description="gradients of an update")


class SoftTargetSettings(ReplaySettings):
    """What the algorithms share whose target networks follow slowly."""

    tau: Share = Field(default=0.005, description="how fast")


class SACSettings(SoftTargetSettings):
    """Arguments of SAC."""

    ent_coef: Entropy = Field(default=0.02, description="weight of the entropy at the start; it adapts itself")


class TD3Settings(SoftTargetSettings):
    """Arguments of TD3."""

    policy_delay: int = Field(default=2, ge=1, le=1000, description="critic's gradients for one of the actor")
    target_policy_noise: Spread = Field(default=0.2, description="spread of the target's actions")
    action_noise: Spread = Field(default=0.2, description="spread of the actions while collecting")


class TQCSettings(SACSettings):
    """Arguments of TQC."""

    top_quantiles_to_drop_per_net: int = Field(default=2, ge=0, le=QUANTILES - 1, description="of each critic")


class CrossQSettings(ReplaySettings):
    """Arguments of CrossQ."""

    ent_coef: Entropy = Field(default=0.02, description="weight of the entropy at the start; it adapts itself")


class TrainConfig(Section):
    """Everything about a training but its seed."""

    algo: str = Field(description="algorithm")
    steps: Steps = Field(default=4_000_000, description="actions in all; with per_panel each panel's counts")
    n_envs: int = Field(default=64, ge=1, le=MOST_ENVS, description="environments")
    environment: Environment = Environment()
    network: NetworkShape = NetworkShape()
    validation: Validation = Validation()
    checkpoints: Checkpoints = Checkpoints()
    learning: AlgorithmSettings = AlgorithmSettings()

    def hash(self) -> str:
        """Return the first 16 hexadecimal digits of the SHA-256 of the values."""
        values = json.dumps(self.model_dump(mode="json"), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(values.encode()).hexdigest()[:16]


SETTINGS: dict[str, type[AlgorithmSettings]] = {
    "ppo": PPOSettings, "sac": SACSettings, "td3": TD3Settings, "tqc": TQCSettings, "crossq": CrossQSettings,
}  # fmt: skip
CONFIGS: dict[str, type[TrainConfig]] = {  # of each algorithm, with its own settings
    algo: create_model(f"{algo}_config", __base__=TrainConfig, learning=(settings, settings()))
    for algo, settings in SETTINGS.items()
}


def load_config(name: str | os.PathLike[str], overrides: Sequence[str] = ()) -> TrainConfig:
    """Read a training's configuration: a shipped one by its name, or a file, with assignments on top.

    Raises:
        ConfigError: for a file, a key or a value that is not valid.
    """
    data, where = read_mapping(find_config(name, folder="train"))
    return _feasible(*_build_with(_model(data, where), data, where, overrides))


def from_dict(data: dict[str, Any], where: Where) -> TrainConfig:
    """Return the configuration that a run folder keeps; raises ConfigError if it is not valid."""
    return _feasible(build(_model(data, where), data, where), where)


def build_section(model: type[SectionT], data: dict[str, Any], where: Where, overrides: Sequence[str]) -> SectionT:
    """Validate what a file holds, then the assignments on top of it; raises ConfigError."""
    return _build_with(model, data, where, overrides)[0]


def _build_with(
    model: type[SectionT], data: dict[str, Any], where: Where, overrides: Sequence[str]
) -> tuple[SectionT, Where]:
    """Return what :func:`build_section` does, and what names the place of a key in it."""
    section = build(model, data, where)
    if not overrides:
        return section, where
    changed, where = apply_overrides(section.model_dump(mode="json"), overrides)
    return build(model, changed, where), where


def _feasible(config: TrainConfig, where: Where) -> TrainConfig:
    """Return the configuration if there is memory for it, and its updates have the samples that they take.

    Raises:
        ConfigError: if not, or for an override of the environment that is not valid.
    """
    try:
        panels = config.environment.robot().n_panels
    except ConfigError as error:
        place = f"{where(('environment', 'overrides'))}: environment.overrides"
        raise ConfigError("\n".join(f"{place}: {line}" for line in str(error).splitlines())) from None
    _check_networks(config, panels, where)
    _check_samples(config, panels, where)
    return config


def _check_networks(config: TrainConfig, panels: int, where: Where) -> None:
    """Reject networks too large to be learned, with optimiser and critics, or read as a policy; raises ConfigError."""
    inputs = N_FEATURES * config.environment.stack_size * (1 if config.network.per_panel else panels)
    most = MOST_WEIGHTS // 2
    for key, layers in (("hidden", config.network.hidden), ("actor", config.network.actor or ())):
        size = 8 * sum(map(math.prod, itertools.pairwise((inputs, *layers, 1))))
        if size > most:
            raise ConfigError(
                f"{where(('network', key))}: network.{key} = {list(layers)}: makes a network of {size / 1e6:.3g} MB, "
                f"at most {most / 1e6:g}: take narrower layers"
            )


def _check_samples(config: TrainConfig, panels: int, where: Where) -> None:
    """Reject more samples than there is memory for, or fewer than an update takes; raises ConfigError."""
    learning, stack = config.learning, config.environment.stack_size
    most, place = MOST_SAMPLES // stack, where(("learning",))
    stacked = f" with environment.stack_size = {stack}" if stack > 1 else ""
    if isinstance(learning, PPOSettings):
        samples = learning.n_steps * config.n_envs * (panels if config.network.per_panel else 1)
        each = f"learning.n_steps = {learning.n_steps} of n_envs = {config.n_envs}, of {panels} panels by per_panel"
        if samples > most:
            raise ConfigError(
                f"{place}: learning.n_steps = {learning.n_steps}: an update would take {samples:.2g} samples, at most "
                f"{most:.0e}{stacked} ({each})"
            )
        if learning.batch_size > samples > 0:
            raise ConfigError(
                f"{place}: learning.batch_size = {learning.batch_size}: must be at most the {samples} samples of an "
                f"update ({each})"
            )
    elif isinstance(learning, ReplaySettings):
        if learning.buffer_size > most:
            raise ConfigError(
                f"{place}: learning.buffer_size = {learning.buffer_size}: must be at most {most}{stacked}"
            )
        if learning.learning_starts >= config.steps:
            raise ConfigError(
                f"{place}: learning.learning_starts = {learning.learning_starts}: must be less than steps = "
                f"{config.steps}, or nothing is learned"
            )


def _model(data: dict[str, Any], where: Where) -> type[TrainConfig]:
    """Return the configuration's class; raises ConfigError for an unknown algorithm."""
    algo = data.get("algo")
    if not (isinstance(algo, str) and algo in CONFIGS):
        raise ConfigError(f"{where(('algo',))}: algo = {algo!r}: must be one of {', '.join(CONFIGS)}")
    return CONFIGS[algo]
