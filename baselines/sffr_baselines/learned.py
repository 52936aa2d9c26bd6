"""Learned schedules: ``.npz`` files that run in NumPy and inside the compiled closed loop; no torch, no pickle."""

from __future__ import annotations

import hashlib
import io
import json
import os
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field

from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv
from sffr_baselines.laws import LawPolicy
from sffr_baselines.own_law import UnfitError
from sffr_baselines.scheduled import action_names, observation_names, scheduled_law
from sffr_gym.config.files import write_whole
from sffr_gym.config.params import Params
from sffr_gym.config.reading import parse_json, read_arrays, read_bytes
from sffr_gym.config.sections import Section
from sffr_gym.config.strict_yaml import ConfigError, build, config_dir
from sffr_gym.config.suggestion import did_you_mean
from sffr_gym.types import Array

FORMAT = "sffr-policy-1"
SUFFIX = ".npz"
ABOUT = "about"  # name of the text within a file
MOST_WEIGHTS = 32_000_000  # bytes of a file's arrays: 4 million weights, of which a control period has no time for more

DampingEnv = SFFRFlexDampingEnv | SFFRFlexDampingVectorEnv


@dataclass(frozen=True)
class Network:
    """A multilayer perceptron."""

    matrices: tuple[Array, ...]  #: (n_out, n_in) of each layer
    biases: tuple[Array, ...]  #: (n_out,) of each layer
    relu: bool  #: hidden layers are rectified, else tanh
    squash: bool  #: the output goes through tanh, else it is clipped to [-1, 1]

    def __post_init__(self) -> None:
        """Reject layers that do not follow on each other: compiled code trusts the sizes; raises ConfigError."""
        if not self.matrices or len(self.matrices) != len(self.biases):
            raise ConfigError("a network has at least one layer, each with a matrix and a bias")
        for matrix, bias in zip(self.matrices, self.biases, strict=True):
            if matrix.ndim != 2 or bias.shape != matrix.shape[:1]:
                raise ConfigError(f"a layer has a matrix of shape {matrix.shape} and a bias of shape {bias.shape}")
            if not (np.isfinite(matrix).all() and np.isfinite(bias).all()):
                raise ConfigError("a layer has weights that are not finite")
        for first, second in pairwise(self.matrices):
            if second.shape[1] != first.shape[0]:
                raise ConfigError(f"a layer of {first.shape[0]} outputs is followed by one of {second.shape[1]} inputs")

    @property
    def sizes(self) -> tuple[int, ...]:
        """Return the widths from the input to the output."""
        return (self.matrices[0].shape[1], *(len(bias) for bias in self.biases))

    def __call__(self, features: Array) -> Array:
        """Return the outputs (..., n_out) in [-1, 1] for features (..., n_in)."""
        values = np.asarray(features, dtype=np.float64)
        for matrix, bias in zip(self.matrices[:-1], self.biases[:-1], strict=True):
            values = values @ matrix.T + bias
            values = np.maximum(values, 0.0) if self.relu else np.tanh(values)
        values = values @ self.matrices[-1].T + self.biases[-1]
        return np.tanh(values) if self.squash else np.clip(values, -1.0, 1.0)

    def flat(self) -> Array:
        """Return matrix and bias of each layer, one after the other, as the compiled schedule takes them."""
        layers = zip(self.matrices, self.biases, strict=True)
        return np.concatenate([part.ravel() for layer in layers for part in layer])


@dataclass(frozen=True)
class LearnedSchedule:
    """A learned schedule of the virtual damping."""

    network: Network  #: for one panel, or for all at once
    law: str  #: the environment it was trained in; see ``SFFRFlexDampingEnv``
    rho: float
    agent_period: float
    base_tolerance: float | None
    stack_size: int
    obs_names: tuple[str, ...]  #: of the environment, in order
    action_names: tuple[str, ...]
    scaling: tuple[float, float, float]  #: constants of the observation, [J], [m/s2], [m/s3]
    trained: dict[str, Any]  #: where it comes from: algorithm, hashes of configuration and suite, seed, steps

    def __post_init__(self) -> None:
        """Reject a network that does not fit observations and actions; raises ConfigError."""
        sizes = self.network.sizes
        blocks = len(self.obs_names) // sizes[0]
        if (blocks * sizes[0], blocks * sizes[-1]) != (len(self.obs_names), len(self.action_names)) or blocks == 0:
            raise ConfigError(
                f"a network of {sizes[0]} inputs and {sizes[-1]} outputs does not fit {len(self.obs_names)} "
                f"observations and {len(self.action_names)} actions"
            )
        if len(self.scaling) != 3 or not all(np.isfinite(each) and each > 0.0 for each in self.scaling):
            raise ConfigError(f"scaling = {self.scaling}: must be three positive numbers")

    @classmethod
    def of(cls, network: Network, env: DampingEnv, trained: dict[str, Any]) -> Self:
        """Return what a network has learned in an environment.

        Args:
            network: for one panel, or for all at once.
            env: ``SFFRFlexDamping-v0``, bare, single or batched.
            trained: where it comes from, of plain values.

        Raises:
            ConfigError: if the network does not fit the environment.
        """
        law = env.law.schedule
        return cls(
            network=network, law=env.law_name, rho=law.rho, agent_period=law.hold * env.law.suppression.period,
            base_tolerance=law.tolerance if isfinite(law.tolerance) else None, stack_size=law.stack,
            obs_names=env.obs_names, action_names=env.action_names,
            scaling=(law.energy, law.acceleration, law.acceleration_rate), trained=trained,
        )  # fmt: skip

    def predict(self, observation: Array, state: None = None, **_: Any) -> tuple[Array, None]:
        """Return actions for observations (..., n_o) of ``SFFRFlexDamping-v0``, as ``predict`` of Stable-Baselines3."""
        observation = np.asarray(observation)
        blocks = observation.reshape(*observation.shape[:-1], -1, self.network.sizes[0])
        actions = self.network(blocks)
        return actions.reshape(*observation.shape[:-1], -1).astype(np.float32), None

    def policy(self, prior: Params, name: str = "learned") -> LawPolicy:
        """Return the schedule and its law as one compiled policy for ``SFFRFlex-v0``.

        Raises:
            UnfitError: if the robot has other panels or damped coordinates than the schedule was made for.
        """
        law = scheduled_law(prior, self.law, self.rho, self.agent_period, self.base_tolerance, self.stack_size)
        if (observation_names(prior, self.stack_size), action_names(prior, law)) != (self.obs_names, self.action_names):
            raise UnfitError(
                f"{name} was made for a robot with the actions {', '.join(self.action_names)} and "
                f"{len(self.obs_names)} observations ({self.obs_names[0]} to {self.obs_names[-1]})"
            )
        energy, acceleration, rate = self.scaling
        schedule = law.schedule._replace(
            energy=energy, acceleration=acceleration, acceleration_rate=rate,
            sizes=np.array(self.network.sizes, dtype=np.int64), weights=self.network.flat(),
            relu=self.network.relu, squash=self.network.squash,
        )  # fmt: skip
        return LawPolicy(name, law._replace(schedule=schedule))


def save_schedule(file: str | os.PathLike[str], schedule: LearnedSchedule) -> None:
    """Write a schedule to an ``.npz`` file, whole or not at all."""
    network = schedule.network
    about = {
        "format": FORMAT, "law": schedule.law, "rho": schedule.rho, "agent_period": schedule.agent_period,
        "base_tolerance": schedule.base_tolerance, "stack_size": schedule.stack_size,
        "obs_names": schedule.obs_names, "action_names": schedule.action_names, "scaling": schedule.scaling,
        "relu": network.relu, "squash": network.squash, "trained": schedule.trained,
    }  # fmt: skip
    arrays = {f"matrix{k}": matrix for k, matrix in enumerate(network.matrices)}
    arrays |= {f"bias{k}": bias for k, bias in enumerate(network.biases)}
    content = io.BytesIO()
    np.savez_compressed(content, allow_pickle=False, **{ABOUT: np.array(json.dumps(about))}, **arrays)
    write_whole(Path(file), content.getvalue())


def load_schedule(name: str | os.PathLike[str]) -> LearnedSchedule:
    """Read a schedule; nothing of the file is run.

    Args:
        name: of a policy that comes with the package, or the path of an ``.npz`` file.

    Raises:
        ConfigError: for an unknown name (with the nearest one), or a file that cannot be read or is not a policy of
            this format.
    """
    file = learned_file(name)
    if file is None:
        shipped = shipped_policies()
        raise ConfigError(
            f"{name}: is neither a shipped learned policy nor an {SUFFIX} file{did_you_mean(str(name), shipped)} "
            f"(shipped: {', '.join(shipped)})"
        )
    arrays = read_arrays(file, MOST_WEIGHTS)
    try:
        return _schedule_of(arrays)
    except ConfigError as error:
        reasons = str(error).splitlines()
        raise ConfigError("\n".join(f"{file}: is not a policy of {FORMAT}: {reason}" for reason in reasons)) from None


class About(Section):
    """What a policy's file says of the policy."""

    format: Literal["sffr-policy-1"] = Field(description="of the file")
    law: str = Field(description="that runs inside")
    rho: float = Field(description="largest factor of the damping [-]")
    agent_period: float = Field(description="time between two actions [s]")
    base_tolerance: float | None = Field(description="error of the base at which an action counts half [m]")
    stack_size: int = Field(default=1, description="actions whose observations are seen at once")
    obs_names: tuple[str, ...] = Field(description="of the environment")
    action_names: tuple[str, ...] = Field(description="of the environment")
    scaling: tuple[float, float, float] = Field(description="of the observation [J, m/s2, m/s3]")
    relu: bool = Field(description="whether hidden layers are rectified")
    squash: bool = Field(description="whether the output goes through tanh")
    trained: dict[str, Any] = Field(description="where it comes from")


def _schedule_of(arrays: dict[str, np.ndarray]) -> LearnedSchedule:
    """Return the schedule that a file's arrays describe; raises ConfigError if they describe none."""
    names = set(arrays)
    count = (len(names) - 1) // 2
    if names != {ABOUT, *(f"{kind}{k}" for kind in ("matrix", "bias") for k in range(count))}:
        raise ConfigError(f"holds {', '.join(sorted(names)[:5])}, not {ABOUT}, and matrix and bias of each layer")
    if arrays[ABOUT].shape != () or arrays[ABOUT].dtype.kind != "U":
        raise ConfigError(f"{ABOUT} must be a text")
    about = build(About, parse_json(str(arrays.pop(ABOUT)), ABOUT), lambda key: ABOUT)
    if texts := [name for name, values in arrays.items() if values.dtype.kind == "U"]:
        raise ConfigError(f"{texts[0]} must hold numbers")
    network = Network(
        tuple(arrays[f"matrix{k}"].astype(np.float64) for k in range(count)),
        tuple(arrays[f"bias{k}"].astype(np.float64) for k in range(count)),
        about.relu, about.squash,
    )  # fmt: skip
    return LearnedSchedule(
        network, about.law, about.rho, about.agent_period, about.base_tolerance, about.stack_size, about.obs_names,
        about.action_names, about.scaling, about.trained,
    )  # fmt: skip


def shipped_policies() -> dict[str, Path]:
    """Return the files of the learned policies that come with the package, by name."""
    return {file.stem: file for file in sorted((config_dir() / "policies").glob(f"*{SUFFIX}"))}


def learned_file(name: str | os.PathLike[str]) -> Path | None:
    """Return the file of a learned policy, given by its path or a shipped name; None for anything else."""
    name = os.fspath(name)
    return Path(name) if name.endswith(SUFFIX) else shipped_policies().get(name)


def file_hash(file: Path) -> str:
    """Return the first 16 hexadecimal digits of the SHA-256 of a file."""
    return hashlib.sha256(read_bytes(file, MOST_WEIGHTS)).hexdigest()[:16]
