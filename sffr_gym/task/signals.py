"""What is measured in each control period: the task's signals, of the true state and of the commands that acted."""

from __future__ import annotations

from math import cos, sin

from sffr_gym.compile.angles import wrap
from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.lanes import where
from sffr_gym.compile.linalg import length
from sffr_gym.physics.model import N_BASE, first_mode
from sffr_gym.task.quasi_static import quasi_static_amplitude

# What is measured each control period: states at its end, commands during it, Q_flex under them at its start.
SIGNALS = (
    "object_error",  # m, distance of the object (without one: the base) from its desired position
    "attitude_error",  # rad, its orientation error
    "vibration",  # J, bending energy of all panels about the quasi-static shape
    "tip",  # m, largest transverse tip displacement
    "force_deviation",  # N, Q_flex about its quasi-static value
    "moment_deviation",  # N m
    "piezo_square",  # V2, sum over channels
    "thrust",  # N, sum of magnitudes over the base axes
    "joint_square",  # N2 m2, sum over joints
    "piezo_saturated",  # fraction of the group's actuators at their limit
    "thruster_saturated",
    "joint_saturated",
)
N_SIGNALS = len(SIGNALS)
(ERROR, ATTITUDE, VIBRATION, TIP, FORCE, MOMENT, PIEZO, THRUST, JOINT, SAT_PIEZO, SAT_THRUST, SAT_JOINT) = range(
    N_SIGNALS
)


@kernel
def measure_state(task, reference, des, p, v, energy, wrench, signals):
    """Fill the signals that depend on the state by itself.

    task: the plant as a :class:`task_model.TaskModel`; reference: the episode's :class:`reference.Reference`.
    des: the :class:`reference.Desired` of this time; p, v: (n,) positions and velocities.
    energy: (n_p,) bending energy of each panel about its quasi-static shape [J], written.
    wrench: (3,) quasi-static wrench of the panels on the base, inertial axes [N, N, N m], written.
    signals: (N_SIGNALS,) written.
    """
    model = task.model
    if model.at.object < model.at.end:
        o = model.at.object
        signals[ERROR] = length(des.x - p[o], des.y - p[o + 1])
        signals[ATTITUDE] = abs(wrap(des.heading + reference.phi - p[o + 2]))
    else:
        signals[ERROR] = length(des.x - p[0], des.y - p[1])
        signals[ATTITUDE] = abs(wrap(des.heading + reference.yaw - p[2]))
    signals[VIBRATION] = tip = 0.0
    fx = fy = moment = 0.0
    ch, sh, turn2, alpha = cos(des.heading), sin(des.heading), des.turn * des.turn, des.turn_acceleration
    bx, by = ch * reference.base_x - sh * reference.base_y, sh * reference.base_x + ch * reference.base_y
    yaw = des.heading + reference.yaw
    cb, sb = cos(yaw), sin(yaw)
    for i in range(model.omega2.shape[0]):
        # The root's acceleration under the reference's motion, in panel axes.
        rx, ry = model.panel_root[i, 0], model.panel_root[i, 1]
        rx, ry = cb * rx - sb * ry, sb * rx + cb * ry
        ax, ay = des.xdd - turn2 * (bx + rx) - alpha * (by + ry), des.ydd - turn2 * (by + ry) + alpha * (bx + rx)
        c, s = model.panel_axis[i, 0], model.panel_axis[i, 1]
        c, s = cb * c - sb * s, sb * c + cb * s
        energy[i], first_y, square = _bending(model, i, c * ay - s * ax, alpha, p, v)
        signals[VIBRATION] += energy[i]
        tip = max(tip, abs(tip_deflection(task.actuators, model, i, p)))
        first_x = model.panel_first_moment[i]
        first_x, first_y = c * first_x - s * first_y, s * first_x + c * first_y
        mass = model.panel_mass[i]
        gx = mass * ax - turn2 * first_x - alpha * first_y
        gy = mass * ay - turn2 * first_y + alpha * first_x
        fx -= gx
        fy -= gy
        moment -= rx * gy - ry * gx + first_x * ay - first_y * ax + alpha * (model.panel_second_moment[i] + square)
    signals[TIP] = tip
    wrench[0], wrench[1], wrench[2] = fx, fy, moment


@kernel
def measure_command(task, asked, applied, q_flex, quasi_static, signals):
    """Fill the signals that depend on the command.

    task: the plant as a :class:`task_model.TaskModel`; asked: (n_u,) command within the limits, at one of which an
    actuator is saturated; applied: (n_u,) what the actuators gave of it, whose size counts.
    q_flex, quasi_static: (3,) wrench of the panels on the base, and what is quasi-static of it [N, N, N m].
    signals: (N_SIGNALS,) written.
    """
    at, limit = task.actuators.at, task.actuators.limit
    signals[FORCE] = length(q_flex[0] - quasi_static[0], q_flex[1] - quasi_static[1])
    signals[MOMENT] = abs(q_flex[2] - quasi_static[2])
    signals[PIEZO] = signals[THRUST] = signals[JOINT] = 0.0
    signals[SAT_PIEZO] = signals[SAT_THRUST] = signals[SAT_JOINT] = 0.0
    for k in range(at.end):
        saturated = where((abs(asked[k]) >= limit[k]) & (limit[k] > 0.0), 1.0, 0.0)  # not the dead ones
        if k < at.thrust:
            signals[PIEZO] += applied[k] * applied[k]
            signals[SAT_PIEZO] += saturated / at.thrust
        elif k < at.joints:
            signals[SAT_THRUST] += saturated / N_BASE
            if k < at.thrust + 2:
                signals[THRUST] += abs(applied[k])
        else:
            signals[JOINT] += applied[k] * applied[k]
            signals[SAT_JOINT] += saturated / (at.end - at.joints)


@kernel
def tip_deflection(actuators, model, i, p):
    """Transverse tip displacement [m] of panel ``i`` along its y axis, for positions ``p`` (n,)."""
    tip, start = 0.0, first_mode(model, i)
    for m in range(model.omega2.shape[1]):
        tip += actuators.tips[i, m, 1] * p[start + m]
    return tip


@kernel
def _bending(model, i, across, alpha, p, v):
    """Bending energy [J] of panel ``i`` about its quasi-static shape, and that shape's moments across it.

    across: transverse acceleration of the root [m/s2]; alpha: its angular acceleration [rad/s2]; p, v: (n,) positions
    and velocities. The moments are the first [kg m] and the second one [kg m2].
    """
    energy = first_y = square = 0.0
    start = first_mode(model, i)
    for m in range(model.n_axial, model.omega2.shape[1]):
        shape = quasi_static_amplitude(model, i, m, across, alpha)
        first_y += model.translation[i, m] * shape
        square += shape * shape
        deflection, rate = p[start + m] - shape, v[start + m]
        energy += 0.5 * (rate * rate + model.omega2[i, m] * deflection * deflection)
    return energy, first_y, square
