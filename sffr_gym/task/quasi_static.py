"""The quasi-static shape of the panels: what the reference's acceleration alone bends them to, without vibration.

In NumPy for draws, pictures and figures, and of a single mode for the kernels.
"""

from __future__ import annotations

import numpy as np

from sffr_gym.compile.kernels import kernel
from sffr_gym.physics.kinematics import perpendicular, rotation
from sffr_gym.physics.model import Model
from sffr_gym.task.reference import Desired, Reference, desired, on_circle
from sffr_gym.types import Array


@kernel
def quasi_static_amplitude(model, panel, mode, across, alpha):
    """Amplitude of a bending mode of a panel under the acceleration of its root.

    across: transverse to the panel [m/s2]; alpha: angular [rad/s2].
    """
    return -(model.translation[panel, mode] * across + model.rotation[panel, mode] * alpha) / model.omega2[panel, mode]


def quasi_static_amplitudes(model: Model, reference: Reference, t: Array) -> tuple[Array, Array]:
    """Return modal amplitudes and rates (rows, n_p, n_m) of the panels' quasi-static shape.

    ``eta = -omega^-2 (phi a_root + psi alpha)`` with the transverse acceleration of each panel's root and the angular
    one; axial modes are left at rest.

    Args:
        model: the robot.
        reference: the desired motion.
        t: (rows,) times of it [s].
    """
    want = dict(zip(Desired._fields, np.array([desired(reference, each) for each in t.tolist()]).T, strict=True))
    c, s, base_axes = np.cos(want["heading"]), np.sin(want["heading"]), rotation(reference.yaw)
    turn, alpha, alpha_rate = want["turn"], want["turn_acceleration"], want["turn_jerk"]
    acceleration = np.column_stack(
        [c * want["xdd"] + s * want["ydd"], c * want["ydd"] - s * want["xdd"]]
    )  # in its axes
    jerk = np.column_stack([c * want["xddd"] + s * want["yddd"], c * want["yddd"] - s * want["xddd"]])
    turned = np.column_stack([-acceleration[:, 1], acceleration[:, 0]])
    from_object = np.array([reference.base_x, reference.base_y])
    shape, rate = np.zeros((2, len(acceleration), *model.omega2.shape))
    bending = slice(model.n_axial, None)
    for i, (root, axis) in enumerate(zip(model.panel_root, model.panel_axis, strict=True)):
        across, place = base_axes @ perpendicular(axis), from_object + base_axes @ root
        lever, reach = np.vecdot(place, across), np.vecdot(perpendicular(place), across)
        push = np.vecdot(acceleration - turn[:, None] ** 2 * place, across) + alpha * reach
        if on_circle(reference):  # its acceleration turns with it, which is exact
            push_rate = np.vecdot(turned, across) * (reference.rate - turn)
        else:
            push_rate = np.vecdot(jerk - turn[:, None] * turned, across)
        push_rate += alpha_rate * reach - 2.0 * turn * alpha * lever
        compliance = model.translation[i, bending] / model.omega2[i, bending]
        turning = model.rotation[i, bending] / model.omega2[i, bending]
        shape[:, i, bending] -= compliance * push[:, None] + turning * alpha[:, None]
        rate[:, i, bending] -= compliance * push_rate[:, None] + turning * alpha_rate[:, None]
    return shape, rate


def quasi_static_at(model: Model, reference: Reference, t: Array) -> Array:
    """Return modal amplitudes (rows, n_p, n_m) of the quasi-static shape at times (rows,) [s] of the desired motion."""
    return quasi_static_amplitudes(model, reference, t)[0]
