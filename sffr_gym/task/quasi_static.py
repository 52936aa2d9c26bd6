"""The quasi-static shape of the panels: what the reference's acceleration alone bends them to, without vibration.

For the kernels at one time, and in NumPy at many for pictures and figures.
"""

from __future__ import annotations

from math import cos, sin

import numpy as np

from sffr_gym.compile.kernels import kernel
from sffr_gym.physics.model import Model
from sffr_gym.task.reference import Desired, Reference, desired, on_circle
from sffr_gym.types import Array


@kernel
def quasi_static_amplitude(model, panel, mode, across, alpha):
    """Amplitude of a bending mode of a panel under the acceleration of its root.

    across: transverse to the panel [m/s2]; alpha: angular [rad/s2].
    """
    return -(model.translation[panel, mode] * across + model.rotation[panel, mode] * alpha) / model.omega2[panel, mode]


@kernel
def panel_push(model, panel, reference, want, c, s):
    """Acceleration of a panel's root across it by the desired motion [m/s2], and the rate of it [m/s3].

    want: a :class:`Desired`; c, s: cosine and sine of its heading. As kernel of numbers, else of arrays over time.
    """
    cy, sy = cos(reference.yaw), sin(reference.yaw)
    root, axis = model.panel_root[panel], model.panel_axis[panel]
    across_x, across_y = -cy * axis[1] - sy * axis[0], cy * axis[0] - sy * axis[1]  # in the reference axes
    place_x = reference.base_x + cy * root[0] - sy * root[1]
    place_y = reference.base_y + sy * root[0] + cy * root[1]
    lever, reach = place_x * across_x + place_y * across_y, place_x * across_y - place_y * across_x
    x, y, turn = c * want.xdd + s * want.ydd, c * want.ydd - s * want.xdd, want.turn
    push = x * across_x + y * across_y - turn * turn * lever + want.turn_acceleration * reach
    turned = x * across_y - y * across_x
    if on_circle(reference):  # its acceleration turns with it, which is exact
        push_rate = turned * (reference.rate - turn)
    else:
        x, y = c * want.xddd + s * want.yddd, c * want.yddd - s * want.xddd
        push_rate = x * across_x + y * across_y - turn * turned
    return push, push_rate + want.turn_jerk * reach - 2.0 * turn * want.turn_acceleration * lever


def quasi_static_amplitudes(model: Model, reference: Reference, t: Array) -> tuple[Array, Array]:
    """Return modal amplitudes and rates (rows, n_p, n_m) of the panels' quasi-static shape.

    ``eta = -omega^-2 (phi a_root + psi alpha)`` with the transverse acceleration of each panel's root and the angular
    one; axial modes are left at rest.

    Args:
        model: the robot.
        reference: the desired motion.
        t: (rows,) times of it [s].
    """
    want = Desired(*np.array([desired(reference, each) for each in t.tolist()]).T)
    shape, rate = np.zeros((2, len(t), *model.omega2.shape))
    for panel in range(len(model.panel_root)):
        push, push_rate = panel_push(model, panel, reference, want, np.cos(want.heading), np.sin(want.heading))
        for mode in range(model.n_axial, model.omega2.shape[1]):
            shape[:, panel, mode] = quasi_static_amplitude(model, panel, mode, push, want.turn_acceleration)
            rate[:, panel, mode] = quasi_static_amplitude(model, panel, mode, push_rate, want.turn_jerk)
    return shape, rate


def quasi_static_at(model: Model, reference: Reference, t: Array) -> Array:
    """Return modal amplitudes (rows, n_p, n_m) of the quasi-static shape at times (rows,) [s] of the desired motion."""
    return quasi_static_amplitudes(model, reference, t)[0]
