"""Actuators (Eqs. 14 and 15): thrusters, joint motors and piezo channels under their limits.

A command is one flat vector: piezo voltages panel by panel [V], base thrust along the base axes [N, N, N m], joint
torques [N m]. An action is a command divided by each actuator's limit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.workspace import Integers
from sffr_gym.config.params import Params
from sffr_gym.physics.model import N_BASE, Model, first_mode, tip_rows
from sffr_gym.physics.piezo import channels
from sffr_gym.types import Array

LEAST_REACH = 1.0e-9  # of an array's largest reach; it is not asked for tip forces that it reaches less


class CommandIndex(NamedTuple):
    """The index map of a command: where each group begins; the piezos begin at 0."""

    thrust: int  #: base thrust and torque
    joints: int  #: joint torques
    end: int  #: length of a command, n_u


class Actuators(NamedTuple):
    """Limits and authority of the actuators, ready for the kernels.

    Attributes:
        at: index map of a command.
        limit: (n_u,) largest command, in the order of a command.
        K_PZ: (n_p, 3, n_c) tip forces (axial N, transverse N, moment N m) for one volt on each channel, Eq. 15, of the
            panel as one element; what the controllers know.
        allocation: (n_p, n_c, 3) volts that give a desired tip force in the least-squares sense.
        gain: (n_p, n_c) force or moment of a channel for one volt [N/V, N m/V].
        reach: (n_p, n_m, n_c) displacement [m] or slope that it works on, for a unit of each mode; of the plant.
        tips: (n_p, n_m, 3) tip coordinates for a unit of each mode.
    """

    at: CommandIndex
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
    thrust_at = n_p * len(gain)
    joints_at = thrust_at + N_BASE
    return Actuators(
        at=CommandIndex(thrust_at, joints_at, joints_at + len(model.link_mass)),
        limit=np.concatenate(limits),
        K_PZ=K_PZ,
        allocation=np.array(np.linalg.pinv(K_PZ, rcond=LEAST_REACH), dtype=np.float64, order="C"),
        gain=np.tile(gain, (n_p, 1)),
        reach=np.array(model.shapes.transpose(0, 2, 1) @ nodal_reach, order="C"),
        tips=tip_rows(model).transpose(0, 2, 1).copy(),
    )


def actuator_shapes(n, n_c, n_u):
    """Shapes of :class:`Actuators`, for :func:`sffr_gym.compile.workspace.structure`.

    n: :class:`sffr_gym.physics.model.Sizes`; n_c: channels of a panel; n_u: length of a command.
    """
    return Actuators(
        at=CommandIndex(Integers(()), Integers(()), Integers(())), limit=(n_u,), K_PZ=(n.panels, 3, n_c),
        allocation=(n.panels, n_c, 3), gain=(n.panels, n_c), reach=(n.panels, n.modes, n_c),
        tips=(n.panels, n.modes, 3),
    )  # fmt: skip


@kernel
def command_of(action, scale, command):
    """Write the command (n_u,) of an action (n_u,): clipped to [-1, 1], times what a unit action asks for (n_u,)."""
    for k in range(len(command)):
        command[k] = min(max(action[k], -1.0), 1.0) * scale[k]


@kernel
def saturate(actuators, command, applied):
    """Clip a command (n_u,) to the limits into ``applied``; NaN stays NaN."""
    for i in range(len(command)):
        applied[i] = min(max(command[i], -actuators.limit[i]), actuators.limit[i])


@kernel
def generalized_forces(model, actuators, applied, tau):
    """Write the generalised forces ``tau`` (n,) of an applied command (n_u,); the object's stay as they are.

    Piezo forces are internal to a panel: they act on the elastic coordinates alone (Eq. 14).
    """
    n_p, n_m, n_c = actuators.reach.shape
    for i in range(model.at.modes):  # base and joints
        tau[i] = applied[actuators.at.thrust + i]
    for i in range(n_p):
        start = first_mode(model, i)
        for m in range(n_m):
            tau[start + m] = 0.0
        for c in range(n_c):
            force = actuators.gain[i, c] * applied[i * n_c + c]
            for m in range(n_m):
                tau[start + m] += actuators.reach[i, m, c] * force
