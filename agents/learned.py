"""Learned schedules: ``.npz`` files that run in NumPy and inside the compiled closed loop; no torch, no pickle."""

from __future__ import annotations

import json
import os
import zipfile
from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.residual_env import action_names, observation_names, scheduled_law
from baselines.policies import LawPolicy
from sffr_gym.beam import Array
from sffr_gym.params import ConfigError, Params

FORMAT = "sffr-policy-1"
SUFFIX = ".npz"


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
class Schedule:
    """A learned schedule of the virtual damping.

    Attributes:
        network: for one panel, or for all at once.
        law, rho, agent_period: the environment it was trained in; see ``SFFRFlexDampingEnv``.
        obs_names, action_names: of the environment, in order.
        scaling: constants of the observation, [J], [m/s2], [m/s3].
        trained: where it comes from: hashes of config and suite, seed, steps, score.
    """

    network: Network
    law: str
    rho: float
    agent_period: float
    obs_names: tuple[str, ...]
    action_names: tuple[str, ...]
    scaling: tuple[float, float, float]
    trained: dict[str, Any]

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
        law = scheduled_law(prior, self.law, self.rho, self.agent_period)
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


def save_schedule(file: str | os.PathLike[str], schedule: Schedule) -> None:
    """Write a schedule to an ``.npz`` file."""
    network = schedule.network
    about = {
        "format": FORMAT, "law": schedule.law, "rho": schedule.rho, "agent_period": schedule.agent_period,
        "obs_names": schedule.obs_names, "action_names": schedule.action_names, "scaling": schedule.scaling,
        "relu": network.relu, "squash": network.squash, "trained": schedule.trained,
    }  # fmt: skip
    arrays = {f"matrix{k}": matrix for k, matrix in enumerate(network.matrices)}
    arrays |= {f"bias{k}": bias for k, bias in enumerate(network.biases)}
    with open(file, "wb") as target:
        np.savez(target, allow_pickle=False, about=np.array(json.dumps(about)), **arrays)


def load_schedule(file: str | os.PathLike[str]) -> Schedule:
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
            raise ConfigError(f"{file}: has the format {about['format']!r}, not {FORMAT!r}")
        count = len(arrays) // 2
        network = Network(
            tuple(arrays[f"matrix{k}"] for k in range(count)), tuple(arrays[f"bias{k}"] for k in range(count)),
            about["relu"], about["squash"],
        )  # fmt: skip
        return Schedule(
            network, about["law"], about["rho"], about["agent_period"], tuple(about["obs_names"]),
            tuple(about["action_names"]), tuple(about["scaling"]), about["trained"],
        )  # fmt: skip
    except (KeyError, zipfile.BadZipFile, json.JSONDecodeError) as error:
        raise ConfigError(f"{file}: is not a policy that sffr export or sffr train wrote ({error})") from None
