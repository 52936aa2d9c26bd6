"""Recordings: what a run folder keeps of an episode of each policy, enough to replay it without simulating again.

One file for each policy in the folder ``recordings``: NumPy's ``.npz`` of plain arrays and one text of JSON, so that
reading a stranger's file runs no code.
"""

from __future__ import annotations

import io
import json
import os
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import Field

from sffr_baselines.rollout import STRIDE, Trajectory
from sffr_gym import ConfigError, Params, Simulator
from sffr_gym.config.ranges import Period, Radius
from sffr_gym.config.reading import parse_json, read_arrays
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.config.sections import Section
from sffr_gym.config.strict_yaml import build
from sffr_gym.physics.actuators import pack_actuators
from sffr_gym.physics.kinematics import rotation
from sffr_gym.physics.model import N_BASE, pack
from sffr_gym.task.episode import Episode
from sffr_gym.task.reference import Reference
from sffr_gym.task.signals import N_SIGNALS
from sffr_gym.types import Array
from sffr_workbench.common import file_name

RECORDINGS, SUFFIX = "recordings", ".npz"
ABOUT = "about"  # name of the text within a file
LARGEST = 1.0e9  # of times, coordinates and commands in SI units; no robot gets so far


class ReferenceSection(Section):
    """A :class:`Reference` as a file has it."""

    radius: Radius = Field(description="[m]")
    rate: float = Field(description="[rad/s]")
    phase: float = Field(description="[rad]")
    lobes: float = Field(description="[-]")
    turning: float = Field(description="[-]")
    bearing: float = Field(description="[rad]")
    x0: float = Field(description="[m]")
    y0: float = Field(description="[m]")
    base_x: float = Field(description="[m]")
    base_y: float = Field(description="[m]")
    yaw: float = Field(description="[rad]")
    phi: float = Field(description="[rad]")
    joints: tuple[float, ...] = Field(description="[rad]")
    pieces: tuple[float, ...] = Field(description="[s, m, rad and rates]")


class About(Section):
    """What a file says of the episode, beside the arrays; see :class:`Recording`."""

    policy: str = Field(description="name")
    scenario: str = Field(description="name")
    seed: int = Field(ge=0, description="of the episode")
    failure: str = Field(description="why it ended early")
    period: Period = Field(description="control period [s]")
    plant: Params = Field(description="the robot as it was")
    reference: ReferenceSection = Field(description="the desired motion")


@dataclass(frozen=True)
class Recording:
    """One episode of a policy."""

    policy: str  #: names
    scenario: str
    seed: int  #: of the episode
    failure: str  #: why it ended early, empty if it did not
    period: float  #: control period [s]
    plant: Params  #: the robot as it was
    reference: Reference  #: the desired motion
    t: Array  #: (rows,) times of the states [s]
    p: Array  #: (rows, n) positions of the plant
    applied: Array  #: (rows, n_u) command after the limits
    limit: Array  #: (n_u,) what the actuators could give
    B_hat: Array  #: (rows, n_p, 3) virtual damping; NaN for a policy without one
    grasp: Array  #: (rows, n_g, 2) forces of the object on each gripper, inertial axes [N]
    signals: Array  #: (rows, N_SIGNALS) see ``task.SIGNALS``
    tips: Array  #: (n_ticks, n_p) transverse tip displacements at the end of every control period [m]

    @classmethod
    def of(cls, trajectory: Trajectory) -> Self:
        """Keep of an episode what a replay shows."""
        episode = trajectory.episode
        return cls(
            policy=trajectory.policy, scenario=trajectory.scenario, seed=trajectory.seed, failure=trajectory.failure,
            period=trajectory.period, plant=episode.plant, reference=episode.reference, t=trajectory.t,
            p=trajectory.p, applied=trajectory.applied, limit=actuator_limits(episode),
            B_hat=trajectory.B_hat, grasp=grasp_forces(trajectory), signals=recorded_signals(trajectory),
            tips=trajectory.tips,
        )  # fmt: skip

    def to_bytes(self) -> bytes:
        """Return the file's content."""
        kept = {field.name: getattr(self, field.name) for field in fields(self)}
        about = kept | {
            "plant": self.plant.to_dict(),
            "reference": {name: np.asarray(value).tolist() for name, value in self.reference._asdict().items()},
        }
        arrays = {name: about.pop(name).astype(np.float64) for name in _ARRAYS}
        file = io.BytesIO()
        np.savez_compressed(file, allow_pickle=False, **{ABOUT: np.array(json.dumps(about))}, **arrays)
        return file.getvalue()

    @classmethod
    def read(cls, file: Path) -> Self:
        """Read a file.

        Raises:
            ConfigError: if it is no recording, or is damaged.
        """
        arrays = read_arrays(file)
        try:
            return cls._of_arrays(arrays)
        except (ValueError, TypeError) as error:
            reasons = str(error).splitlines()
            raise ConfigError("\n".join(f"{file}: no recording, or damaged: {each}" for each in reasons)) from None

    @classmethod
    def _of_arrays(cls, arrays: dict[str, Array]) -> Self:
        """Return the recording that a file's arrays describe; raises ValueError if there is none."""
        if set(arrays) != {ABOUT, *_ARRAYS}:
            raise ValueError(f"holds {', '.join(sorted(arrays)[:5])}")
        about = build(About, parse_json(str(arrays.pop(ABOUT)), ABOUT), lambda key: ABOUT)
        numbers = about.reference.model_dump()
        reference = Reference(**numbers | {name: np.array(numbers[name], np.float64) for name in ("joints", "pieces")})
        values = {name: array.astype(np.float64) for name, array in arrays.items()}
        recording = cls(**dict(about) | values | {"reference": reference})
        recording._check()
        return recording

    def _check(self) -> None:
        """Raise ValueError where arrays do not fit each other or the robot."""
        model, rows = pack(self.plant), self.t.size
        n_p, n_u = len(model.panel_root), self.limit.size
        shapes = {
            "t": (rows,), "limit": (n_u,), "joints": (len(model.link_mass),),
            "p": (rows, N_BASE + len(model.link_mass) + model.omega2.size + N_BASE * (model.object_mass > 0.0)),
            "applied": (rows, n_u), "B_hat": (rows, n_p, 3), "grasp": (rows, len(model.grasp_arm), 2),
            "signals": (rows, N_SIGNALS), "tips": (*self.tips.shape[:1], n_p),
        }  # fmt: skip
        arrays = {name: getattr(self, name) for name in _ARRAYS} | {"joints": self.reference.joints}
        for name, shape in shapes.items():
            if arrays[name].shape != shape:
                raise ValueError(f"{name} has the shape {arrays[name].shape} instead of {shape}")
        if rows == 0:
            raise ValueError("holds no state")
        if self.reference.pieces.size != self.plant.path.pieces.size:
            raise ValueError(f"reference.pieces: must be those of path.kind = {self.plant.path.kind!r}")
        for name in "t", "p", "applied", "limit":
            if not (np.abs(arrays[name]) <= LARGEST).all():
                raise ValueError(f"{name} must be finite, and at most {LARGEST:.0e}")


_ARRAYS = tuple(field.name for field in fields(Recording) if field.type == "Array")


def recording_name(policy: str, seed: int | None = None) -> str:
    """Return the name of a policy's recording in a run folder; with the seed of the episode if it is not the first."""
    return f"{RECORDINGS}/{file_name(policy)}{'' if seed is None else f'@{seed}'}{SUFFIX}"


def recording_files(run: RunFolder) -> list[Path]:
    """Return the recordings of a run that are still there, sorted by the policies' names."""
    names = sorted(name for name in run.files if name.startswith(f"{RECORDINGS}/") and name.endswith(SUFFIX))
    return [file for file in map(run.file, names) if os.path.lexists(file)]


def actuator_limits(episode: Episode) -> Array:
    """Return what the plant's actuators can give in an episode (n_u,), faults included."""
    actuators = pack_actuators(episode.plant, pack(episode.plant))
    return actuators.limit * episode.health.left(actuators)


def recorded_signals(trajectory: Trajectory) -> Array:
    """Return the signals (rows, N_SIGNALS) of the recorded states, each that of the end of the period before."""
    return trajectory.signals[np.maximum(np.arange(len(trajectory.t)) * STRIDE - 1, 0)]


def grasp_forces(trajectory: Trajectory) -> Array:
    """Return the forces (rows, n_g, 2) of the object on each gripper, inertial axes [N]; computed if not recorded."""
    if np.isfinite(trajectory.lam).all():
        return np.stack([lam @ rotation(p[2]).T for lam, p in zip(trajectory.lam, trajectory.p, strict=True)])
    sim = Simulator(trajectory.episode.plant)
    n_p, n_c = sim.actuators.K_PZ.shape[::2]
    forces = np.zeros_like(trajectory.lam)
    for row, applied in enumerate(trajectory.applied):
        volts, rest = np.split(applied, [n_p * n_c])
        state = sim.unflatten(trajectory.t[row], trajectory.p[row], trajectory.v[row])
        forces[row] = sim.grasp_forces(
            state, base=rest[:N_BASE], joints=rest[N_BASE:], piezo_volts=volts.reshape(n_p, n_c)
        )
    return forces
