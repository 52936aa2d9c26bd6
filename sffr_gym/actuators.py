"""Actuators (Eqs. 14 and 15): thrusters, joint motors and piezo channels under their limits.

A command is one flat vector: piezo voltages panel by panel [V], base thrust along the base axes [N, N, N m], joint
torques [N m]. An action is a command divided by each actuator's limit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sffr_gym._jit import kernel
from sffr_gym.beam import Array
from sffr_gym.model import N_BASE, Model, tip_rows
from sffr_gym.params import Params
from sffr_gym.piezo import channels

LEAST_REACH = 1.0e-9  # of an array's largest reach; it is not asked for tip forces that it reaches less


class Actuators(NamedTuple):
    """Limits and authority of the actuators, ready for the kernels.

    Attributes:
        limit: (n_u,) largest command, in the order of a command.
        K_PZ: (n_p, 3, n_c) tip forces (axial N, transverse N, moment N m) for one volt on each channel, Eq. 15, of the
            panel as one element; what the controllers know.
        allocation: (n_p, n_c, 3) volts that give a wanted tip force in the least-squares sense.
        gain: (n_p, n_c) force or moment of a channel for one volt [N/V, N m/V].
        reach: (n_p, n_m, n_c) displacement [m] or slope that it works on, for a unit of each mode; of the plant.
        tips: (n_p, n_m, 3) tip coordinates for a unit of each mode.
    """

    limit: Array
    K_PZ: Array
    allocation: Array
    gain: Array
    reach: Array
    tips: Array


def pack_actuators(params: Params, model: Model) -> Actuators:
    """Turn validated parameters into the arrays of the kernels."""
    piezo, panel = params.actuators.piezo, params.panel
    gain, tip_reach = channels(piezo, panel, elements=1)
    n_p = len(model.panel_root)
    K_PZ = np.tile(tip_reach * gain, (n_p, 1, 1))
    nodal_reach = channels(piezo, panel, panel.elements).reach
    thrust = params.actuators.thruster_force
    limits = (
        np.full(n_p * len(gain), piezo.voltage),
        [thrust, thrust, params.actuators.thruster_torque],
        np.full(len(model.link_mass), params.actuators.joint_torque),
    )
    return Actuators(
        limit=np.concatenate(limits),
        K_PZ=K_PZ,
        allocation=np.array(np.linalg.pinv(K_PZ, rcond=LEAST_REACH), dtype=np.float64, order="C"),
        gain=np.tile(gain, (n_p, 1)),
        reach=np.array(model.shapes.transpose(0, 2, 1) @ nodal_reach, order="C"),
        tips=tip_rows(model).transpose(0, 2, 1).copy(),
    )


@kernel(inline=True)
def saturate(actuators, command, applied):
    """Clip a command (n_u,) to the limits into ``applied``; NaN stays NaN."""
    for i in range(len(command)):
        applied[i] = min(max(command[i], -actuators.limit[i]), actuators.limit[i])


@kernel(inline=True)
def generalized_forces(model, actuators, applied, tau):
    """Write the generalised forces (n,) of an applied command; the object's stay as they are.

    Piezo forces are internal to a panel: they act on the elastic coordinates alone (Eq. 14).
    """
    n_p, n_m, n_c = actuators.reach.shape
    n_l = len(model.link_mass)
    at = n_p * n_c
    for i in range(N_BASE + n_l):
        tau[i] = applied[at + i]
    start = N_BASE + n_l
    for i in range(n_p):
        for m in range(n_m):
            tau[start + i * n_m + m] = 0.0
        for c in range(n_c):
            force = actuators.gain[i, c] * applied[i * n_c + c]
            for m in range(n_m):
                tau[start + i * n_m + m] += actuators.reach[i, m, c] * force
