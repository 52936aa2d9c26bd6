"""Configurations of trainings, ``configs/train``: validated keys for each algorithm."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from typing import Any, Literal, TypeVar

from pydantic import Field, create_model

from sffr_baselines.damping_env import DURATION
from sffr_baselines.scheduled import AGENT_PERIOD, RHO
from sffr_gym.config.sections import NonNegative, Positive, Section
from sffr_gym.config.strict_yaml import ConfigError, Where, apply_overrides, build, find_config, read_mapping

SectionT = TypeVar("SectionT", bound=Section)

VALIDATION_SEED = 900_000  # of the episodes that choose the best model; evaluation has its own


class Environment(Section):
    """What the agent is trained in; see ``SFFRFlexDamping-v0``."""

    scenario: str = Field(default="excited", description="shipped scenario or file")
    law: Literal["hsc", "ahsc"] = Field(default="ahsc", description="law that runs inside")
    rho: float = Field(default=RHO, ge=1.0, description="largest factor of the damping [-]")
    agent_period: Positive = Field(default=AGENT_PERIOD, description="time between two actions [s]")
    duration: float | None = Field(default=DURATION, gt=0.0, description="length of an episode [s]; null: scenario's")
    random_phase: bool = Field(default=True, description="start anywhere on the circle")
    base_tolerance: float | None = Field(
        default=None, gt=0.0, description="error of the base at which an action counts half [m]; null: it never does"
    )
    overrides: tuple[str, ...] = Field(default=(), description="assignments to parameters, such as panel.EI=25")


class NetworkShape(Section):
    """Actor and critic."""

    hidden: tuple[int, ...] = Field(default=(64, 64), min_length=1, description="widths of the hidden layers")
    activation: Literal["tanh", "relu"] = Field(default="tanh", description="of the hidden layers")
    per_panel: bool = Field(default=True, description="one network serves each panel by itself")


class Validation(Section):
    """Episodes on which the agent is compared with AHSC during training."""

    scenarios: tuple[str, ...] = Field(
        default=("excited", "nominal"), min_length=1, description="whose mean cost counts"
    )
    episodes: int = Field(default=8, ge=1, description="of each scenario that draws something")
    duration: float | None = Field(default=None, gt=0.0, description="length [s]; null: the scenario's")
    every: int = Field(default=500_000, ge=1, description="steps between two comparisons")


class Checkpoints(Section):
    """What a killed training resumes from."""

    every: int = Field(default=100_000, ge=1, description="steps between two checkpoints")
    keep: int = Field(default=2, ge=1, description="how many of the last ones stay")


class AlgorithmSettings(Section):
    """What all algorithms share."""

    learning_rate: Positive = Field(default=1.0e-3, description="at the start")
    final_learning_rate: NonNegative = Field(default=1.0e-4, description="at the end, linearly")
    gamma: float = Field(default=0.98, gt=0.0, le=1.0, description="discount of an action")
    energy_scaling: bool = Field(default=True, description="values per energy of the panels; see energy_scaling.py")


class PPOSettings(AlgorithmSettings):
    """Arguments of Stable-Baselines3's PPO."""

    n_steps: int = Field(default=64, ge=2, description="steps of each row between two updates")
    batch_size: int = Field(default=1024, ge=2, description="samples of a gradient")
    n_epochs: int = Field(default=6, ge=1, description="passes through the samples")
    gae_lambda: float = Field(default=0.95, ge=0.0, le=1.0, description="of the advantages")
    clip_range: Positive = Field(default=0.2, description="of the probability ratio")
    ent_coef: NonNegative = Field(default=0.0, description="weight of the entropy")
    vf_coef: NonNegative = Field(default=0.5, description="weight of the critic")
    max_grad_norm: Positive = Field(default=0.5, description="of the gradient")
    log_std_init: float = Field(default=-0.5, description="log of the actions' spread at the start")


class ReplaySettings(AlgorithmSettings):
    """What the algorithms with a replay buffer share."""

    buffer_size: int = Field(default=1_000_000, ge=1, description="samples kept")
    learning_starts: int = Field(default=10_000, ge=1, description="samples before the first gradient")
    batch_size: int = Field(default=512, ge=2, description="samples of a gradient")
    train_freq: int = Field(default=1, ge=1, description="steps of each row between two updates")
    gradient_steps: int = Field(default=8, ge=1, description="gradients of an update")


class SoftTargetSettings(ReplaySettings):
    """What the algorithms share whose target networks follow slowly."""

    tau: float = Field(default=0.005, gt=0.0, le=1.0, description="how fast")


class SACSettings(SoftTargetSettings):
    """Arguments of SAC."""

    ent_coef: Positive = Field(default=0.02, description="weight of the entropy at the start; it adapts itself")


class TD3Settings(SoftTargetSettings):
    """Arguments of TD3."""

    policy_delay: int = Field(default=2, ge=1, description="critic's gradients for one of the actor")
    target_policy_noise: NonNegative = Field(default=0.2, description="spread of the target's actions")
    action_noise: NonNegative = Field(default=0.2, description="spread of the actions while collecting")


class TQCSettings(SACSettings):
    """Arguments of TQC."""

    top_quantiles_to_drop_per_net: int = Field(default=2, ge=0, description="of each critic")


class CrossQSettings(ReplaySettings):
    """Arguments of CrossQ."""

    ent_coef: Positive = Field(default=0.02, description="weight of the entropy at the start; it adapts itself")


class TrainConfig(Section):
    """Everything about a training but its seed."""

    algo: str = Field(description="algorithm")
    steps: int = Field(default=4_000_000, ge=1, description="actions in all; with per_panel each panel's counts")
    n_envs: int = Field(default=64, ge=1, description="environments")
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
    return build_section(_model(data, where), data, where, overrides)


def from_dict(data: dict[str, Any], where: Where) -> TrainConfig:
    """Return the configuration that a run folder keeps; raises ConfigError if it is not valid."""
    return build(_model(data, where), data, where)


def build_section(model: type[SectionT], data: dict[str, Any], where: Where, overrides: Sequence[str]) -> SectionT:
    """Validate what a file holds, then the assignments on top of it; raises ConfigError."""
    section = build(model, data, where)
    return build(model, *apply_overrides(section.model_dump(mode="json"), overrides)) if overrides else section


def _model(data: dict[str, Any], where: Where) -> type[TrainConfig]:
    """Return the configuration's class; raises ConfigError for an unknown algorithm."""
    algo = data.get("algo")
    if not (isinstance(algo, str) and algo in CONFIGS):
        raise ConfigError(f"{where(('algo',))}: algo = {algo!r}: must be one of {', '.join(CONFIGS)}")
    return CONFIGS[algo]
