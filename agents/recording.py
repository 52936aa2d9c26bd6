"""Recordings: what a run folder keeps of an episode of each policy, enough to replay it without simulating again.

One file for each policy in the folder ``recordings``: NumPy's ``.npz`` of plain arrays and one text of JSON, so that
reading a stranger's file runs no code.
"""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Self
from urllib.parse import quote

import numpy as np
from pydantic import ValidationError

from baselines.rollout import STRIDE, Trajectory
from sffr_gym import ConfigError, Params, Simulator
from sffr_gym.actuators import pack_actuators
from sffr_gym.beam import Array
from sffr_gym.kinematics import rotation
from sffr_gym.model import N_BASE, pack
from sffr_gym.reference import Reference
from sffr_gym.task import N_SIGNALS

RECORDINGS, SUFFIX = "recordings", ".npz"
ABOUT = "about"  # name of the text within a file


@dataclass(frozen=True)
class Recording:
    """One episode of a policy.

    Attributes:
        policy, scenario: names; seed: of the episode; failure: why it ended early, empty if it did not.
        period: control period [s].
        plant: the robot as it was; reference: the desired motion.
        t: (rows,) times of the states [s].
        p: (rows, n) positions of the plant.
        applied: (rows, n_u) command after the limits; limit: (n_u,) what the actuators could give.
        B_hat: (rows, n_p, 3) virtual damping; NaN for a policy without one.
        grasp: (rows, n_g, 2) forces of the object on each gripper, inertial axes [N].
        signals: (rows, N_SIGNALS) see ``task.SIGNALS``.
        tips: (n_ticks, n_p) transverse tip displacements at the end of every control period [m].
    """

    policy: str
    scenario: str
    seed: int
    failure: str
    period: float
    plant: Params
    reference: Reference
    t: Array
    p: Array
    applied: Array
    limit: Array
    B_hat: Array
    grasp: Array
    signals: Array
    tips: Array

    @classmethod
    def of(cls, trajectory: Trajectory) -> Self:
        """Keep of an episode what a replay shows."""
        episode = trajectory.episode
        actuators = pack_actuators(episode.plant, pack(episode.plant))
        ticks = np.maximum(np.arange(len(trajectory.t)) * STRIDE - 1, 0)  # a signal is that of its period's end
        return cls(
            policy=trajectory.policy, scenario=trajectory.scenario, seed=trajectory.seed, failure=trajectory.failure,
            period=trajectory.period, plant=episode.plant, reference=episode.reference, t=trajectory.t,
            p=trajectory.p, applied=trajectory.applied, limit=actuators.limit * episode.health.left(actuators),
            B_hat=trajectory.B_hat, grasp=grasp_forces(trajectory), signals=trajectory.signals[ticks],
            tips=trajectory.tips,
        )  # fmt: skip

    def to_bytes(self) -> bytes:
        """The file's content."""
        kept = {field.name: getattr(self, field.name) for field in fields(self)}
        about = kept | {
            "plant": self.plant.to_dict(),
            "reference": self.reference._replace(joints=self.reference.joints.tolist())._asdict(),
        }
        arrays = {name: about.pop(name).astype(np.float32) for name in _ARRAYS}
        file = io.BytesIO()
        np.savez_compressed(file, allow_pickle=False, **{ABOUT: np.array(json.dumps(about))}, **arrays)
        return file.getvalue()

    @classmethod
    def read(cls, file: Path) -> Self:
        """Read a file.

        Raises:
            ConfigError: if it is not one of ours, or is damaged.
        """
        try:
            with np.load(io.BytesIO(file.read_bytes()), allow_pickle=False) as kept:
                about = json.loads(str(kept[ABOUT]))
                arrays = {name: kept[name].astype(np.float64) for name in _ARRAYS}
            reference = Reference(**about["reference"] | {"joints": np.array(about["reference"]["joints"])})
            recording = cls(**about | arrays | {"plant": Params(**about["plant"]), "reference": reference})
            recording._check()
        except (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, ValidationError) as error:
            raise ConfigError(f"{file}: no recording of ours, or damaged: {error}") from None
        return recording

    def _check(self) -> None:
        """Raise ValueError where arrays do not fit each other or the robot."""
        model, rows = pack(self.plant), len(self.t)
        n_p, n_u = len(model.panel_root), len(self.limit)
        shapes = {
            "p": (rows, N_BASE + len(model.link_mass) + model.omega2.size + N_BASE * (model.object_mass > 0.0)),
            "applied": (rows, n_u), "B_hat": (rows, n_p, 3), "grasp": (rows, len(model.grasp_arm), 2),
            "signals": (rows, N_SIGNALS), "tips": (len(self.tips), n_p),
        }  # fmt: skip
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} has the shape {getattr(self, name).shape} instead of {shape}")


_ARRAYS = tuple(field.name for field in fields(Recording) if field.type == "Array")


def file_of(folder: Path, policy: str) -> Path:
    """Where a run folder keeps the recording of a policy, whose name may be a path."""
    return folder / RECORDINGS / (quote(policy, safe="") + SUFFIX)


def recording_files(folder: Path) -> list[Path]:
    """The recordings of a run folder, by the policies' names."""
    return sorted((folder / RECORDINGS).glob("*" + SUFFIX))


def grasp_forces(trajectory: Trajectory) -> Array:
    """Forces (rows, n_g, 2) of the object on each gripper, inertial axes [N]; computed where they were not recorded."""
    if np.isfinite(trajectory.lam).all():
        forces: Array = np.stack([lam @ rotation(p[2]).T for lam, p in zip(trajectory.lam, trajectory.p, strict=True)])
        return forces
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
