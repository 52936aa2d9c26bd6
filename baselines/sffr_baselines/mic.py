"""Multiple impedance control (Eqs. 5-13): task-space inverse dynamics of the rigid part plus the object's law.

Task coordinates are the base's pose, the grippers' positions and the held joints' angles, so that J_c is square and
``Q = J_c' (Q_m + Q_f)`` is the inverse dynamics of the acceleration that the error law (Eqs. 9 and 12) asks for, with
the gripper forces that move the object (Eq. 10) at the tips. Acts on the observation and the prior model alone.
"""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple

from sffr_gym.compile.kernels import kernel
from sffr_gym.physics.model import N_BASE
from sffr_gym.task.observation import reference_turning
from sffr_gym.types import Array


class Gains(NamedTuple):
    """Gains of the error law ``edd + Kd ed + Kp e + Ki (integral of e) = 0``, of Eqs. 9 and 12 without the last."""

    Kp: float  #: [1/s2]
    Kd: float  #: [1/s]
    Ki: float  #: [1/s3]; 0 is the paper's law


class MicWork(NamedTuple):
    """Memory of the law."""

    base: Array  #: (3,) commanded acceleration of the base, base axes [m/s2, m/s2, rad/s2]
    c: Array  #: (n_l,) link directions, base axes
    s: Array  #: (n_l,)
    rate: Array  #: (n_l,) absolute angular velocities [rad/s]
    alpha: Array  #: (n_l,) commanded absolute angular accelerations [rad/s2]
    hold: Array  #: (n_l,) commanded relative accelerations of held joints [rad/s2]
    grip_x: Array  #: (n_a,) force on the object at each arm's tip, base axes [N]
    grip_y: Array  #: (n_a,)


def mic_shapes(prior):
    """Shapes of the :class:`MicWork` for a robot."""
    n_l, n_a = len(prior.link_mass), len(prior.arm_angle)
    return MicWork((3,), (n_l,), (n_l,), (n_l,), (n_l,), (n_l,), (n_a,), (n_a,))


@kernel
def ask(prior, reference, held, gains, at, obs, integral, work):
    """Write into ``work`` what the law asks for: accelerations of base and held joints, gripper forces.

    prior: the model that the controller believes; its rigid part and object are used.
    reference: the formation that the task asks for (:class:`reference.Reference`).
    held: joints that hold their angles; gains: :class:`Gains`.
    at: index map of the observation ``obs`` (n_o,).
    integral: (n_t,) of the tracked errors over time, in the order of :func:`observer.tracked_errors`.
    work: :class:`MicWork`.
    """
    Kp, Kd, Ki = gains.Kp, gains.Kd, gains.Ki
    turn, axd, ayd = obs[at.reference_turn], obs[at.reference_acceleration], obs[at.reference_acceleration + 1]
    turn_acceleration, _ = reference_turning(at, obs)
    # Base axes seen from the reference axes, in which errors and the reference are given.
    yaw = reference.yaw - obs[at.yaw_error]
    cb, sb = cos(yaw), sin(yaw)
    e, ed = at.base_error, at.base_error_rate
    bx, by = axd - turn_acceleration * reference.base_y, ayd + turn_acceleration * reference.base_x
    ax = bx - turn * turn * reference.base_x + Kp * obs[e] + Kd * obs[ed] + Ki * integral[0]
    ay = by - turn * turn * reference.base_y + Kp * obs[e + 1] + Kd * obs[ed + 1] + Ki * integral[1]
    alpha = turn_acceleration + Kp * obs[at.yaw_error] + Kd * obs[at.yaw_error_rate] + Ki * integral[2]
    ax, ay = cb * ax + sb * ay, cb * ay - sb * ax
    work.base[0], work.base[1], work.base[2] = ax, ay, alpha
    _links(prior, obs, at, obs[at.yaw_rate], work)
    work.hold[:] = 0.0
    for k in range(len(held)):
        joint = held[k]
        work.hold[joint] = Kp * obs[at.hold_error + k] - Kd * obs[at.joint_rate + joint]
    work.grip_x[:] = 0.0
    work.grip_y[:] = 0.0
    if prior.object_mass > 0.0:
        _grip_forces(prior, reference, gains, at, obs, integral, cb, sb, work)


@kernel
def answer(prior, reference, gains, at, obs, integral, work, wrench, torque):
    """Write the base wrench (3,), base axes, and the joint torques (n_l,) that give the base ``work.base``.

    Grippers and held joints move, and the object is held, as :func:`ask` left it; its arguments, and its ``work``.
    """
    Kp, Kd, Ki = gains.Kp, gains.Kd, gains.Ki
    turn, axd, ayd = obs[at.reference_turn], obs[at.reference_acceleration], obs[at.reference_acceleration + 1]
    turn_acceleration, _ = reference_turning(at, obs)
    yaw = reference.yaw - obs[at.yaw_error]
    cb, sb = cos(yaw), sin(yaw)
    ax, ay, alpha, w = work.base[0], work.base[1], work.base[2], obs[at.yaw_rate]
    for arm in range(len(prior.arm_angle)):
        for k in range(prior.arm_first[arm], prior.arm_first[arm + 1]):
            before = alpha if k == prior.arm_first[arm] else work.alpha[k - 1]
            work.alpha[k] = before + work.hold[k]
    for g in range(len(prior.grasp_arm)):
        # Desired tip acceleration: formation turning with the reference, and the error law of Eq. 12.
        c, s = cos(reference.phi), sin(reference.phi)
        gx = c * prior.grasp_point[g, 0] - s * prior.grasp_point[g, 1]
        gy = s * prior.grasp_point[g, 0] + c * prior.grasp_point[g, 1]
        e, ed, z = at.tip_error + 2 * g, at.tip_error_rate + 2 * g, N_BASE + 2 * g
        tx, ty = axd - turn_acceleration * gy, ayd + turn_acceleration * gx
        tx = tx - turn * turn * gx + Kp * obs[e] + Kd * obs[ed] + Ki * integral[z]
        ty = ty - turn * turn * gy + Kp * obs[e + 1] + Kd * obs[ed + 1] + Ki * integral[z + 1]
        tx, ty = cb * tx + sb * ty, cb * ty - sb * tx
        _reach(prior, prior.grasp_arm[g], tx - ax, ty - ay, alpha, w, work)
    _inverse_dynamics(prior, ax, ay, alpha, w, work, wrench, torque)


@kernel
def _links(prior, obs, at, yaw_rate, work):
    """Link directions in base axes and absolute angular velocities, from observed joint angles and rates."""
    for arm in range(len(prior.arm_angle)):
        angle, rate = prior.arm_angle[arm], yaw_rate
        for k in range(prior.arm_first[arm], prior.arm_first[arm + 1]):
            angle += obs[at.joint_angle + k]
            rate += obs[at.joint_rate + k]
            work.c[k], work.s[k], work.rate[k] = cos(angle), sin(angle), rate


@kernel
def _grip_forces(prior, reference, gains, at, obs, integral, cb, sb, work):
    """Gripper forces that move the object, ``G# M v`` (Eqs. 9-11), into ``work``, base axes."""
    Kp, Kd, Ki = gains.Kp, gains.Kd, gains.Ki
    e, ed, a, n_g = at.object_error, at.object_error_rate, at.reference_acceleration, len(prior.grasp_arm)
    z = N_BASE + 2 * n_g
    fx = prior.object_mass * (obs[a] + Kp * obs[e] + Kd * obs[ed] + Ki * integral[z])
    fy = prior.object_mass * (obs[a + 1] + Kp * obs[e + 1] + Kd * obs[ed + 1] + Ki * integral[z + 1])
    turning, turning_rate = at.object_angle_error, at.object_angle_error_rate
    turn_acceleration, _ = reference_turning(at, obs)
    alpha = turn_acceleration + Kp * obs[turning] + Kd * obs[turning_rate] + Ki * integral[z + 2]
    moment = prior.object_inertia * alpha
    fx, fy = cb * fx + sb * fy, cb * fy - sb * fx
    # Object axes seen from the base axes.
    phi = reference.phi - obs[at.object_angle_error] - reference.yaw + obs[at.yaw_error]
    c, s = cos(phi), sin(phi)
    sum_x = sum_y = square = 0.0
    for g in range(n_g):
        gx = c * prior.grasp_point[g, 0] - s * prior.grasp_point[g, 1]
        gy = s * prior.grasp_point[g, 0] + c * prior.grasp_point[g, 1]
        sum_x += gx
        sum_y += gy
        square += gx * gx + gy * gy
    # G# = G' (G G')^-1 with G = [I ...; (z x gamma)' ...]; its multipliers: a force shared by all and a common turn.
    spread = square - (sum_x * sum_x + sum_y * sum_y) / n_g
    twist = (moment - (sum_x * fy - sum_y * fx) / n_g) / spread if n_g > 1 else 0.0
    push_x, push_y = (fx + twist * sum_y) / n_g, (fy - twist * sum_x) / n_g
    for g in range(n_g):
        gx = c * prior.grasp_point[g, 0] - s * prior.grasp_point[g, 1]
        gy = s * prior.grasp_point[g, 0] + c * prior.grasp_point[g, 1]
        work.grip_x[prior.grasp_arm[g]] = push_x - twist * gy
        work.grip_y[prior.grasp_arm[g]] = push_y + twist * gx


@kernel
def _reach(prior, arm, tx, ty, alpha, w, work):
    """Angular accelerations of a grasping arm's links that give its tip (tx, ty) relative to the base's origin.

    The first two joints place the tip; further ones hold their angles, and are already in ``work.alpha`` relative to
    the second link.
    """
    first, last = prior.arm_first[arm], prior.arm_first[arm + 1]
    x, y = prior.arm_mount[arm, 0], prior.arm_mount[arm, 1]
    rx, ry = tx + alpha * y + w * w * x, ty - alpha * x + w * w * y
    ux = uy = relative = 0.0
    for k in range(first, last):
        dx, dy = prior.link_length[k] * work.c[k], prior.link_length[k] * work.s[k]
        rx += work.rate[k] * work.rate[k] * dx
        ry += work.rate[k] * work.rate[k] * dy
        if k > first:
            ux -= dy
            uy += dx
        if k > first + 1:
            relative += work.hold[k]
            rx += relative * dy
            ry -= relative * dx
    nx, ny = -prior.link_length[first] * work.s[first], prior.link_length[first] * work.c[first]
    det = nx * uy - ny * ux
    work.alpha[first] = (rx * uy - ry * ux) / det
    second = (nx * ry - ny * rx) / det
    for k in range(first + 1, last):
        if k > first + 1:
            second += work.hold[k]
        work.alpha[k] = second


@kernel
def _inverse_dynamics(prior, ax, ay, alpha, w, work, wrench, torque):
    """Forces for commanded accelerations, tip forces included: ``Q = H qdd + C + J' F_e`` (Eqs. 6, 7 and 13)."""
    fx, fy, moment = prior.base_mass * ax, prior.base_mass * ay, prior.base_inertia * alpha
    for arm in range(len(prior.arm_angle)):
        first, last = prior.arm_first[arm], prior.arm_first[arm + 1]
        x, y = prior.arm_mount[arm, 0], prior.arm_mount[arm, 1]
        # Accelerations outward: that of the tip, then unwound link by link on the way back.
        px, py = ax - alpha * y - w * w * x, ay + alpha * x - w * w * y
        for k in range(first, last):
            turn, w2 = work.alpha[k], work.rate[k] * work.rate[k]
            px -= prior.link_length[k] * (turn * work.s[k] + w2 * work.c[k])
            py += prior.link_length[k] * (turn * work.c[k] - w2 * work.s[k])
        gx, gy, load = work.grip_x[arm], work.grip_y[arm], 0.0
        for k in range(last - 1, first - 1, -1):
            c, s, turn, w2 = work.c[k], work.s[k], work.alpha[k], work.rate[k] * work.rate[k]
            length, com, mass = prior.link_length[k], prior.link_com[k], prior.link_mass[k]
            px += length * (turn * s + w2 * c)
            py -= length * (turn * c - w2 * s)
            mx, my = mass * (px - com * (turn * s + w2 * c)), mass * (py + com * (turn * c - w2 * s))
            load += prior.link_inertia[k] * turn + com * (c * my - s * mx) + length * (c * gy - s * gx)
            torque[k] = load
            gx += mx
            gy += my
        fx += gx
        fy += gy
        moment += x * gy - y * gx + load
    wrench[0], wrench[1], wrench[2] = fx, fy, moment
