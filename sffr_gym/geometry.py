"""Where arms, panels and tips are in a state ``p`` of the plant, and how long forces are drawn, for pictures.

States are laid out as :mod:`sffr_gym.model` says.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from sffr_gym.beam import N_TIP, Array, shape_functions
from sffr_gym.kinematics import rotation
from sffr_gym.model import N_BASE, Model, joint_slice, mode_slice, nodal, object_slice
from sffr_gym.params import Params
from sffr_gym.reference import Reference

CORNERS = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]])  # of a square of side 2


class Scales(NamedTuple):
    """Lengths of forces: newtons for a metre of plume, and of grasp arrow; and the piezos' voltage limit."""

    thrust: float
    grasp: float
    volts: float


def arm_line(model: Model, p: Array, arm: int) -> Array:
    """Mount, joints and tip of an arm (n_links + 1, 2) [m], inertial axes, in a state ``p`` (n,)."""
    mount = model.arm_mount[arm]
    links = slice(model.arm_first[arm], model.arm_first[arm + 1])
    angles = p[2] + mount[2] + np.cumsum(p[joint_slice(model)][links])
    steps = model.link_length[links, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    line: Array = p[:2] + rotation(p[2]) @ mount[:2] + np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    return line


def panel_line(model: Model, params: Params, p: Array, panel: int, factor: float = 1.0, points: int = 24) -> Array:
    """A panel's centre line from root to tip (about ``points``, 2) [m], inertial axes, deflections times ``factor``."""
    x, U, W = panel_shapes(params.panel.length, params.panel.elements, points)
    q_f = nodal(model, p[mode_slice(model)])[panel]
    local = np.column_stack([x + U @ q_f, factor * (W @ q_f)])
    return place_in_panel(model, p, panel, local)


def place_in_panel(model: Model, p: Array, panel: int, local: Array) -> Array:
    """Points (k, 2) [m] of a panel's axes, from its root, as inertial ones."""
    (c, s), root = model.panel_axis[panel], model.panel_root[panel]
    placed: Array = p[:2] + (root + local @ np.array([[c, s], [-s, c]])) @ rotation(p[2]).T
    return placed


def tip_deflections(model: Model, p: Array) -> Array:
    """Transverse tip deflections (rows, n_p) [m] of positions (rows, n)."""
    amplitudes = p[:, mode_slice(model)].reshape(len(p), *model.omega2.shape)
    tips: Array = np.einsum("pm,tpm->tp", model.shapes[:, -N_TIP + 1, :], amplitudes)
    return tips


def resting_amplitudes(model: Model, reference: Reference, a: Array, turn: Array) -> Array:
    """Amplitudes (rows, n_p, n_m) of the panels' quasi-static shape: bent by the desired motion, without swing.

    ``eta = -omega^-2 phi a_root`` with the transverse acceleration of each panel's root.

    Args:
        model: the robot.
        reference: the desired motion.
        a: (rows, 2) its acceleration, reference axes [m/s2].
        turn: (rows,) its angular rate [rad/s].
    """
    amplitudes = np.zeros((len(a), *model.omega2.shape))
    bending = slice(model.n_axial, None)
    for i, (root, axis) in enumerate(zip(model.panel_root, model.panel_axis, strict=True)):
        arm = np.array([reference.base_x, reference.base_y]) + rotation(reference.yaw) @ root
        across = (a - turn[:, None] ** 2 * arm) @ rotation(reference.yaw) @ np.array([-axis[1], axis[0]])
        amplitudes[:, i, bending] = -across[:, None] * model.translation[i, bending] / model.omega2[i, bending]
    return amplitudes


def in_base_axes(model: Model, p: Array) -> Array:
    """The same state (n,) seen from the base."""
    seen, pose = p.copy(), object_slice(model)
    seen[:N_BASE] = 0.0
    if seen[pose].size:
        seen[pose] = np.append((p[pose][:2] - p[:2]) @ rotation(p[2]), p[pose][2] - p[2])
    return seen


def force_scales(params: Params, model: Model) -> Scales:
    """Scales at which a metre stands for what the path asks: of the thrusters, and of both grippers together."""
    curve = params.path.speed**2 / params.path.radius
    mass = float(model.base_mass + model.link_mass.sum() + model.panel_inertia[:, 0].sum())
    return Scales(
        (mass + model.object_mass) * curve, max(model.object_mass, 1.0) * curve, params.actuators.piezo.voltage
    )


@functools.lru_cache(maxsize=16)
def panel_shapes(length: float, elements: int, points: int) -> tuple[Array, Array, Array]:
    """Places (k,) [m] along a panel, and axial and transverse displacement (k, n_f) there for unit nodal ones."""
    step, each = length / elements, max(points // elements, 2)
    k, n_f = elements * each + 1, N_TIP * elements
    U, W = np.zeros((k, N_TIP + n_f)), np.zeros((k, N_TIP + n_f))  # the clamped root's first
    for row in range(1, k):
        element = (row - 1) // each
        at = slice(N_TIP * element, N_TIP * (element + 2))
        U[row, at], W[row, at], *_ = shape_functions((row - element * each) / each, step)
    return np.linspace(0.0, length, k), U[:, N_TIP:], W[:, N_TIP:]
