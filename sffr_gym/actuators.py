"""Actuators (Eqs. 14 and 15): thrusters, joint motors and piezo channels under their limits.

A command is one flat vector: piezo voltages panel by panel [V], base thrust along the base axes [N, N, N m], joint
torques [N m]. An action is a command divided by each actuator's limit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sffr_gym._jit import kernel
from sffr_gym.beam import N_TIP, Array
from sffr_gym.model import N_BASE, Model, tip_rows
from sffr_gym.params import Params


class Actuators(NamedTuple):
    """Limits and authority of the actuators, ready for the kernels.

    Attributes:
        limit: (n_u,) largest command, in the order of a command.
        K_PZ: (n_p, 3, n_c) tip forces (axial N, transverse N, moment N m) for one volt on each channel, Eq. 15.
        allocation: (n_p, n_c, 3) volts that give a wanted tip force in the least-squares sense.
        modal_force: (n_p, n_m, 3) modal forces for a unit of each tip force.
    """

    limit: Array
    K_PZ: Array
    allocation: Array
    modal_force: Array


def pack_actuators(params: Params, model: Model) -> Actuators:
    """Turn validated parameters into the arrays of the kernels."""
    piezo = params.actuators.piezo
    authority = np.diag([piezo.force, piezo.force, piezo.moment]) / piezo.voltage
    n_p = len(model.panel_root)
    K_PZ = np.tile(authority, (n_p, 1, 1))
    thrust = params.actuators.thruster_force
    limits = (
        np.full(n_p * authority.shape[1], piezo.voltage),
        [thrust, thrust, params.actuators.thruster_torque],
        np.full(len(model.link_mass), params.actuators.joint_torque),
    )
    return Actuators(
        limit=np.concatenate(limits),
        K_PZ=K_PZ,
        allocation=np.array(np.linalg.pinv(K_PZ), dtype=np.float64, order="C"),
        modal_force=tip_rows(model).transpose(0, 2, 1).copy(),
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
    n_p, _, n_c = actuators.K_PZ.shape
    n_m, n_l = model.omega2.shape[1], len(model.link_mass)
    at = n_p * n_c
    for i in range(N_BASE + n_l):
        tau[i] = applied[at + i]
    start = N_BASE + n_l
    for i in range(n_p):
        for m in range(n_m):
            tau[start + i * n_m + m] = 0.0
        for k in range(N_TIP):
            force = 0.0
            for c in range(n_c):
                force += actuators.K_PZ[i, k, c] * applied[i * n_c + c]
            for m in range(n_m):
                tau[start + i * n_m + m] += actuators.modal_force[i, m, k] * force
