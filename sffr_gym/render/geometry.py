"""Where arms, panels and path are in a state ``p`` of the plant, and how long forces are drawn, for pictures.

States are laid out as :mod:`sffr_gym.physics.model` says.
"""

from __future__ import annotations

import functools
from math import pi
from typing import NamedTuple

import numpy as np

from sffr_gym.config.params import Params
from sffr_gym.config.path import N_PIECE
from sffr_gym.physics.beam import N_TIP, shape_functions
from sffr_gym.physics.kinematics import rotation
from sffr_gym.physics.model import N_BASE, Model, joint_slice, mode_slice, nodal, object_slice
from sffr_gym.task.reference import Reference, desired
from sffr_gym.types import Array

LEAST_FORCE = 1e-9  # N; a path that asks for less is a straight line, or not moved along
LEAST_REACH = 1.0  # m, of the map of a path that stays on the spot
TRACK_POINTS = 361
CORNERS = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]])  # of a square of side 2


class Scales(NamedTuple):
    """Forces that a metre of plume and a metre of grasp arrow stand for [N/m], and the largest piezo voltage [V]."""

    thrust: float
    grasp: float
    volts: float


class Track(NamedTuple):
    """How a path lies in space and time."""

    closed: bool  #: whether it leads back to its start
    span: float  #: time once along it [s]
    pace: float  #: mean speed [m/s]
    centre: Array  #: (2,) middle of the box around it [m]
    reach: float  #: half of that box's longer side [m]

    def ahead(self, t: float) -> float:
        """Return the time from which nothing new comes, for pictures at a time ``t`` [s]."""
        return t + self.span if self.closed else max(t, self.span)


def arm_line(model: Model, p: Array, arm: int) -> Array:
    """Return mount, joints and tip of an arm (n_links + 1, 2) [m], inertial axes, in a state ``p`` (n,)."""
    links = slice(model.arm_first[arm], model.arm_first[arm + 1])
    angles = p[2] + model.arm_angle[arm] + np.cumsum(p[joint_slice(model)][links])
    steps = model.link_length[links, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    line: Array = p[:2] + rotation(p[2]) @ model.arm_mount[arm] + np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    return line


def panel_line(model: Model, params: Params, p: Array, panel: int, factor: float = 1.0, points: int = 24) -> Array:
    """Return a panel's centre line (about ``points``, 2) [m], inertial axes, its deflection times ``factor``."""
    x, U, W = panel_shapes(params.panel.each[panel].length, params.panel.elements, points)
    q_f = nodal(model, p[mode_slice(model)])[panel]
    local = np.column_stack([x + U @ q_f, factor * (W @ q_f)])
    return place_in_panel(model, p, panel, local)


def place_in_panel(model: Model, p: Array, panel: int, local: Array) -> Array:
    """Return points (k, 2) [m], given in a panel's axes from its root, in the inertial axes."""
    (c, s), root = model.panel_axis[panel], model.panel_root[panel]
    placed: Array = p[:2] + (root + local @ np.array([[c, s], [-s, c]])) @ rotation(p[2]).T
    return placed


def path_points(reference: Reference, t: Array) -> Array:
    """Return the points (k, 2) [m] of the path at times (k,) [s], inertial axes."""
    return np.array([desired(reference, each)[:2] for each in t.tolist()]).reshape(-1, 2)


def track_of(reference: Reference) -> Track:
    """Return how a path lies."""
    closed = len(reference.pieces) == 0
    span = 2.0 * pi / reference.rate if closed else float(reference.pieces[-N_PIECE])
    points = path_points(reference, np.linspace(0.0, span, TRACK_POINTS))
    low, high = points.min(axis=0), points.max(axis=0)
    length = float(np.hypot(*np.diff(points, axis=0).T).sum())
    return Track(closed, span, length / span, (low + high) / 2.0, max(float((high - low).max()) / 2.0, LEAST_REACH))


def in_base_axes(model: Model, p: Array) -> Array:
    """Return positions (n,) in the axes of the base."""
    seen, pose = p.copy(), object_slice(model)
    seen[:N_BASE] = 0.0
    if seen[pose].size:
        seen[pose] = np.append((p[pose][:2] - p[:2]) @ rotation(p[2]), p[pose][2] - p[2])
    return seen


def force_scales(params: Params, model: Model) -> Scales:
    """Return scales at which a metre stands for what the path asks: of the thrusters, of both grippers together."""
    curve = params.path.acceleration
    mass = float(model.base_mass + model.link_mass.sum() + model.panel_mass.sum())
    thrust, grasp = (mass + model.object_mass) * curve, max(model.object_mass, 1.0) * curve
    return Scales(max(thrust, LEAST_FORCE), max(grasp, LEAST_FORCE), params.actuators.piezo.voltage)


@functools.lru_cache(maxsize=16)
def panel_shapes(length: float, elements: int, points: int) -> tuple[Array, Array, Array]:
    """Return places (k,) [m] along a panel, and its axial and transverse displacement (k, n_f) for unit nodal ones."""
    step, each = length / elements, max(points // elements, 2)
    k, n_f = elements * each + 1, N_TIP * elements
    U, W = np.zeros((k, N_TIP + n_f)), np.zeros((k, N_TIP + n_f))  # the clamped root's first
    for row in range(1, k):
        element = (row - 1) // each
        at = slice(N_TIP * element, N_TIP * (element + 2))
        U[row, at], W[row, at], *_ = shape_functions((row - element * each) / each, step)
    return np.linspace(0.0, length, k), U[:, N_TIP:], W[:, N_TIP:]
