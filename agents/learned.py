"""Learned schedules: ``.npz`` files that run in NumPy and inside the compiled closed loop; no torch, no pickle."""

from __future__ import annotations

import difflib
import hashlib
import io
import json
import os
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Any, Self

import numpy as np

from agents.files import write_whole
from agents.residual_env import (
    SFFRFlexDampingEnv,
    SFFRFlexDampingVectorEnv,
    action_names,
    observation_names,
    scheduled_law,
)
from baselines import POLICIES, make_policy
from baselines.policies import LawPolicy, Policy
from sffr_gym import config
from sffr_gym.beam import Array
from sffr_gym.params import ConfigError, Params

FORMAT = "sffr-policy-1"
SUFFIX = ".npz"

DampingEnv = SFFRFlexDampingEnv | SFFRFlexDampingVectorEnv


@dataclass(frozen=True)
class Network:
    """A multilayer perceptron.

    Attributes:
        matrices: (n_out, n_in) of each layer.
        biases: (n_out,) of each layer.
        relu: hidden layers are rectified, else tanh.
        squash: the output goes through tanh, else it is clipped to [-1, 1].
    """

    matrices: tuple[Array, ...]
    biases: tuple[Array, ...]
    relu: bool
    squash: bool

    def __post_init__(self) -> None:
        """Refuse layers that do not follow on each other: compiled code trusts the sizes; raises ConfigError."""
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
        """Widths from the input to the output."""
        return (self.matrices[0].shape[1], *(len(bias) for bias in self.biases))

    def __call__(self, seen: Array) -> Array:
        """Decisions (..., n_out) for what is seen (..., n_in)."""
        values = np.asarray(seen, dtype=np.float64)
        for matrix, bias in zip(self.matrices[:-1], self.biases[:-1], strict=True):
            values = values @ matrix.T + bias
            values = np.maximum(values, 0.0) if self.relu else np.tanh(values)
        values = values @ self.matrices[-1].T + self.biases[-1]
        return np.tanh(values) if self.squash else np.clip(values, -1.0, 1.0)

    def flat(self) -> Array:
        """Matrix and bias of each layer, one after the other, as the compiled schedule takes them."""
        layers = zip(self.matrices, self.biases, strict=True)
        return np.concatenate([part.ravel() for layer in layers for part in layer])


@dataclass(frozen=True)
class LearnedSchedule:
    """A learned schedule of the virtual damping.

    Attributes:
        network: for one panel, or for all at once.
        law, rho, agent_period, base_tolerance: the environment it was trained in; see ``SFFRFlexDampingEnv``.
        obs_names, action_names: of the environment, in order.
        scaling: constants of the observation, [J], [m/s2], [m/s3].
        trained: where it comes from: algorithm, hashes of configuration and suite, seed, steps.
    """

    network: Network
    law: str
    rho: float
    agent_period: float
    base_tolerance: float | None
    obs_names: tuple[str, ...]
    action_names: tuple[str, ...]
    scaling: tuple[float, float, float]
    trained: dict[str, Any]

    def __post_init__(self) -> None:
        """Refuse a network that does not serve all that is seen and done; raises ConfigError."""
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
        """What a network has learned in an environment.

        Args:
            network: for one panel, or for all at once.
            env: ``SFFRFlexDamping-v0``, bare, single or batched.
            trained: where it comes from, of plain values.

        Raises:
            ConfigError: if the network does not fit the environment.
        """
        law = env.law.schedule
        return cls(
            network=network, law=env.law_name, rho=law.rho, agent_period=law.hold * env.robot.period,
            base_tolerance=law.tolerance if isfinite(law.tolerance) else None,
            obs_names=env.obs_names, action_names=env.action_names,
            scaling=(law.energy, law.acceleration, law.acceleration_rate), trained=trained,
        )  # fmt: skip

    def predict(self, observation: Array, state: None = None, **_: Any) -> tuple[Array, None]:
        """Actions for observations (..., n_o) of ``SFFRFlexDamping-v0``, as Stable-Baselines3's ``predict`` does."""
        observation = np.asarray(observation)
        blocks = observation.reshape(*observation.shape[:-1], -1, self.network.sizes[0])
        actions = self.network(blocks)
        return actions.reshape(*observation.shape[:-1], -1).astype(np.float32), None

    def policy(self, prior: Params, name: str = "learned") -> LawPolicy:
        """The schedule and its law as one compiled policy for ``SFFRFlex-v0``.

        Raises:
            ConfigError: if the robot has other panels or damped coordinates than the schedule was made for.
        """
        law = scheduled_law(prior, self.law, self.rho, self.agent_period, self.base_tolerance)
        if (observation_names(prior), action_names(prior, law)) != (self.obs_names, self.action_names):
            raise ConfigError(
                f"{name} was made for a robot with the observations {', '.join(self.obs_names)} and the actions "
                f"{', '.join(self.action_names)}"
            )
        energy, acceleration, rate = self.scaling
        schedule = law.schedule._replace(
            energy=energy, acceleration=acceleration, acceleration_rate=rate,
            sizes=np.array(self.network.sizes, dtype=np.int64), weights=self.network.flat(),
            relu=float(self.network.relu), squash=float(self.network.squash),
        )  # fmt: skip
        return LawPolicy(name, law._replace(schedule=schedule))


def save_schedule(file: str | os.PathLike[str], schedule: LearnedSchedule) -> None:
    """Write a schedule to an ``.npz`` file, whole or not at all."""
    network = schedule.network
    about = {
        "format": FORMAT, "law": schedule.law, "rho": schedule.rho, "agent_period": schedule.agent_period,
        "base_tolerance": schedule.base_tolerance,
        "obs_names": schedule.obs_names, "action_names": schedule.action_names, "scaling": schedule.scaling,
        "relu": network.relu, "squash": network.squash, "trained": schedule.trained,
    }  # fmt: skip
    arrays = {f"matrix{k}": matrix for k, matrix in enumerate(network.matrices)}
    arrays |= {f"bias{k}": bias for k, bias in enumerate(network.biases)}
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, about=np.array(json.dumps(about)), **arrays)
    write_whole(Path(file), content.getvalue())


def load_schedule(file: str | os.PathLike[str]) -> LearnedSchedule:
    """Read a schedule; nothing of the file is run.

    Raises:
        ConfigError: if it is not a policy of this format.
        OSError: if it cannot be read.
    """
    try:
        with np.load(file, allow_pickle=False) as data:
            arrays = {name: data[name] for name in data.files}
        about = json.loads(str(arrays.pop("about")))
        if about["format"] != FORMAT:
            raise ConfigError(f"has the format {about['format']!r}, not {FORMAT!r}")
        count = len(arrays) // 2
        network = Network(
            tuple(arrays[f"matrix{k}"].astype(np.float64) for k in range(count)),
            tuple(arrays[f"bias{k}"].astype(np.float64) for k in range(count)),
            bool(about["relu"]), bool(about["squash"]),
        )  # fmt: skip
        tolerance = about["base_tolerance"]
        return LearnedSchedule(
            network, about["law"], float(about["rho"]), float(about["agent_period"]),
            None if tolerance is None else float(tolerance), tuple(about["obs_names"]),
            tuple(about["action_names"]), tuple(map(float, about["scaling"])), about["trained"],  # type: ignore[arg-type]
        )  # fmt: skip
    except (KeyError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise ConfigError(f"{file}: is not a policy that sffr train or sffr export wrote: {error}") from None


def shipped_policies() -> dict[str, Path]:
    """Files of the learned policies that come with the package, by name."""
    return {file.stem: file for file in sorted((config.config_dir() / "policies").glob(f"*{SUFFIX}"))}


def policy_file(name: str) -> Path | None:
    """The file of a learned policy, given by a path or a shipped name; None for anything else."""
    return Path(name) if name.endswith(SUFFIX) else shipped_policies().get(name)


def policy_title(name: str) -> str:
    """What tables call a policy: its name; of a file its folder's name and its own, ``seed0/best``."""
    return "/".join(Path(name).with_suffix("").parts[-2:]) if name.endswith(SUFFIX) else name


def file_hash(file: Path) -> str:
    """First 16 hexadecimal digits of the SHA-256 of a file."""
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16]


def load_policy(name: str, prior: Params) -> Policy:
    """A policy for ``SFFRFlex-v0``: a baseline or a shipped policy by its name, a learned one by its file.

    Args:
        name: of the policy, or path of its ``.npz`` file.
        prior: what the controllers believe.

    Raises:
        ConfigError: for an unknown name (with the nearest one), or a file that is no policy for this robot.
        OSError: for a file that cannot be read.
    """
    file = policy_file(name)
    if file is not None:
        return load_schedule(file).policy(prior, policy_title(name))
    known = [*POLICIES, *shipped_policies()]
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ConfigError(f"unknown policy {name!r}{hint} (known: {', '.join(known)}, or an {SUFFIX} file)")
    return make_policy(name, prior)


def check_titles(names: Sequence[str]) -> None:
    """Make sure that tables can tell the policies apart; raises ConfigError."""
    titles = [policy_title(name) for name in names]
    for name, title in zip(names, titles, strict=True):
        if names.count(name) > 1:
            raise ConfigError(f"policy {name!r} is given twice")
        if titles.count(title) > 1:
            raise ConfigError(f"two policies would be called {title!r}: rename one file or its folder")
