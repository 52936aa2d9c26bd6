"""The quasi-static shape of the panels: what the reference's acceleration alone bends them to, without vibration.

In NumPy for draws, pictures and figures, and of a single mode for the kernels.
"""

from __future__ import annotations

import numpy as np

from sffr_gym.compile.kernels import kernel
from sffr_gym.physics.kinematics import perpendicular, rotation
from sffr_gym.physics.model import Model
from sffr_gym.task.reference import Reference
from sffr_gym.types import Array


@kernel
def quasi_static_amplitude(model, panel, mode, across):
    """Amplitude of a bending mode of a panel whose root accelerates across it by ``across`` [m/s2]."""
    return -model.translation[panel, mode] * across / model.omega2[panel, mode]


def quasi_static_amplitudes(model: Model, reference: Reference, acceleration: Array) -> tuple[Array, Array]:
    """Return modal amplitudes and rates (rows, n_p, n_m) of the panels' quasi-static shape.

    ``eta = -omega^-2 phi a_root`` with the transverse acceleration of each panel's root; axial modes are left at rest.

    Args:
        model: the robot.
        reference: the desired motion.
        acceleration: (rows, 2) of the desired motion, reference axes [m/s2].
    """
    turn, base_axes = reference.turning * reference.rate, rotation(reference.yaw)
    from_object = np.array([reference.base_x, reference.base_y])
    turned = np.column_stack([-acceleration[:, 1], acceleration[:, 0]])  # by a quarter, the direction of the jerk
    shape, rate = np.zeros((2, len(acceleration), *model.omega2.shape))
    bending = slice(model.n_axial, None)
    for i, (root, axis) in enumerate(zip(model.panel_root, model.panel_axis, strict=True)):
        across = base_axes @ perpendicular(axis)
        push = np.vecdot(acceleration - turn**2 * (from_object + base_axes @ root), across)
        push_rate = np.vecdot(turned, across) * (reference.rate - turn)
        compliance = model.translation[i, bending] / model.omega2[i, bending]
        shape[:, i, bending] -= compliance * push[:, None]
        rate[:, i, bending] -= compliance * push_rate[:, None]
    return shape, rate


def quasi_static_at(model: Model, reference: Reference, t: Array) -> Array:
    """Return modal amplitudes (rows, n_p, n_m) of the quasi-static shape at times (rows,) [s] of the desired motion."""
    turn = reference.turning * reference.rate
    angle = reference.phase + reference.rate * t - turn * t  # in the reference axes
    acceleration = reference.radius * reference.rate**2 * np.column_stack([-np.sin(angle), np.cos(angle)])
    return quasi_static_amplitudes(model, reference, acceleration)[0]
