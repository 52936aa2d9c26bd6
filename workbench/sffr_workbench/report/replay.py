"""What the page's replay draws: the robot's shape once, and of each policy a table of numbers over time."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sffr_baselines.rollout import STRIDE
from sffr_baselines.suppression import TRANSVERSE
from sffr_gym.physics.kinematics import modal_tip_deflections, tip_deflections
from sffr_gym.physics.model import N_BASE, Model, joint_slice, mode_slice, object_slice, pack
from sffr_gym.render.geometry import force_scales, panel_shapes, path_points, track_of
from sffr_gym.task.quasi_static import quasi_static_at
from sffr_gym.task.reference import N_REFERENCE
from sffr_gym.task.signals import ERROR, VIBRATION
from sffr_gym.types import Array
from sffr_workbench.evaluation import Recording
from sffr_workbench.report.spectrum import mode_frequencies, spectrum, use_of_limits

POINTS = 32  # of a panel's drawn line
PATH_POINTS = 361  # of the drawn path, evenly in time


def episode_data(recordings: Mapping[str, Recording], colours: Mapping[str, str]) -> dict[str, Any]:
    """Return one episode under several policies, for the page's scripts.

    Args:
        recordings: of the same episode, by the names that the page shows.
        colours: by name, ``#rrggbb``.
    """
    first = next(iter(recordings.values()))
    return {
        "name": f"{first.scenario}, seed {first.seed}",
        "robot": robot_data(first),
        "policies": [policy_data(name, each, colours[name]) for name, each in recordings.items()],
    }


def robot_data(recording: Recording) -> dict[str, Any]:
    """Return the robot's shape, its path and limits; lengths in metres."""
    params, reference = recording.plant, recording.reference
    model, track = pack(params), track_of(reference)
    scales = force_scales(params, model)
    lines = [panel_shapes(panel.length, params.panel.elements, POINTS) for panel in params.panel.each]
    bounds = zip(model.arm_first, model.arm_first[1:], strict=False)
    return {
        "side": params.base.side,
        "arms": [
            {
                "name": arm.name, "mount": [*mount.tolist(), arm.mount_angle], "first": int(start),
                "links": model.link_length[start:stop].tolist(), "grasps": bool(i in model.grasp_arm),
            }
            for i, (arm, mount, (start, stop)) in enumerate(zip(params.arms, model.arm_mount, bounds, strict=True))
        ],
        "panels": [
            {
                "name": mount.name, "root": root.tolist(), "axis": axis.tolist(), "length": float(x[-1]),
                "x": x.tolist(), "shapes": (W @ shapes).round(9).tolist(),  # deflection at x for a unit of each mode
            }
            for mount, root, axis, shapes, (x, _, W) in zip(
                params.panel.mounts, model.panel_root, model.panel_axis, model.shapes, lines, strict=True
            )
        ],
        "faces": 1 if params.actuators.piezo.array == "generalized" else 2,
        "grasps": model.grasp_point.tolist(),
        "path": {
            "points": path_points(reference, np.linspace(0.0, track.span, PATH_POINTS)).round(4).tolist(),
            "radius": track.reach, "centre": track.centre.tolist(), "span": track.span,
        },
        "volts": params.actuators.piezo.voltage,
        "newtons": {"thrust": scales.thrust, "grasp": scales.grasp},  # for a metre of plume or arrow
        "frequencies": mode_frequencies(recording),
    }  # fmt: skip


def policy_data(name: str, recording: Recording, colour: str) -> dict[str, Any]:
    """Return a policy's episode: its columns over time, spectra, and how it used its actuators."""
    model = pack(recording.plant)
    columns = columns_of(recording, model)
    widths = [block.shape[1] for block in columns.values()]
    starts = np.cumsum([0, *widths]).tolist()
    return {
        "name": name,
        "colour": colour,
        "failure": recording.failure,
        "step": STRIDE * recording.period,
        "rows": len(recording.t),
        "layout": {key: [start, width] for key, start, width in zip(columns, starts, widths, strict=False)},
        "width": starts[-1],
        "table": encode_floats(np.hstack(list(columns.values()))),
        "spectra": spectrum(recording),
        "use": use_of_limits(recording),
    }


def columns_of(recording: Recording, model: Model) -> dict[str, Array]:
    """Return columns (rows, k) by what they mean; angles in rad, the rest in plain SI units."""
    rows, p = len(recording.t), recording.p
    n_volts = len(recording.limit) - N_BASE - len(model.link_mass)
    rest, tips = quasi_static_at(model, recording.reference, recording.t), tip_deflections(model, p)
    return {
        "base": p[:, :N_BASE],
        "joints": p[:, joint_slice(model)],
        "object": p[:, object_slice(model)],
        "modes": p[:, mode_slice(model)],
        "rest": rest.reshape(rows, -1),
        "volts": recording.applied[:, :n_volts],
        "thrust": recording.applied[:, n_volts : n_volts + N_BASE],
        "grasp": -recording.grasp.reshape(rows, -1),  # on the object
        "tips": tips,
        "swing": tips - modal_tip_deflections(model, rest),
        "error": recording.signals[:, [ERROR]],
        "energy": recording.signals[:, [VIBRATION]],
        "damping": recording.B_hat[:, :, TRANSVERSE],
    }


def encode_floats(values: Array) -> str:
    """Encode numbers as text: little-endian single precision in base64, row by row."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")


def group_by_episode(recordings: Sequence[tuple[str, Recording]]) -> list[dict[str, Recording]]:
    """Group recordings of the same episode, by the name to show; a policy of two runs gets its run's name as well.

    Args:
        recordings: each with the name of its run.
    """
    episodes: dict[tuple[Any, ...], list[tuple[str, Recording]]] = {}
    for run, each in recordings:
        episodes.setdefault(_identity(each), []).append((run, each))
    groups = []
    for members in episodes.values():
        names = [each.policy for _, each in members]
        groups.append(
            {each.policy if names.count(each.policy) == 1 else f"{each.policy} ({run})": each for run, each in members}
        )
    return groups


def _identity(recording: Recording) -> tuple[Any, ...]:
    """Return what recordings of the same episode share: scenario, seed, plant, limits, path and start."""
    path, arrays = recording.reference, (recording.limit.tobytes(), recording.p[0].tobytes())
    drawn = path[:N_REFERENCE], path.pieces.tobytes(), *arrays
    return recording.scenario, recording.seed, recording.plant.hash(), *drawn
