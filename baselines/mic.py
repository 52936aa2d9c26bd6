"""Multiple impedance control (Eqs. 5-13): task-space inverse dynamics of the rigid part plus the object's law.

Task coordinates are the base's pose, the grippers' positions and the held joints' angles, so that J_c is square and
``Q = J_c' (Q_m + Q_f)`` is the inverse dynamics of the acceleration that the error law (Eqs. 9 and 12) asks for, with
the gripper forces that move the object (Eq. 10) at the tips. Acts on the observation and the prior model alone.
"""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple

from sffr_gym._jit import kernel
from sffr_gym.beam import Array
from sffr_gym.lanes import ONE, zeros
from sffr_gym.observation import Field


class Layout(NamedTuple):
    """Where the law finds its fields in an observation."""

    base: int
    tip: int
    object: int
    hold: int
    angle: int
    yaw_rate: int
    elastic: int
    reference: int


class MicWork(NamedTuple):
    """Buffers of the law, one row or entry for each link or gripper."""

    c: Array  # (n_l,) link directions, base axes
    s: Array
    rate: Array  # (n_l,) absolute angular velocity [rad/s]
    alpha: Array  # (n_l,) commanded absolute angular acceleration [rad/s2]
    hold: Array  # (n_l,) commanded relative acceleration of held joints [rad/s2]
    grip: Array  # (n_a, 2) force on the object at each arm's tip, base axes [N]


def layout(fields: dict[str, Field]) -> Layout:
    """Offsets of the fields that the law reads."""
    return Layout(
        base=fields["base_error"].start,
        tip=fields["tip_error"].start,
        object=fields["object_error"].start,
        hold=fields["hold_error"].start,
        angle=fields["joint_angle"].start,
        yaw_rate=fields["yaw_rate"].start,
        elastic=fields["elastic"].start,
        reference=fields["reference_velocity"].start,
    )


@kernel(allocates=True)
def mic_workspace(prior, one=ONE):
    """Allocate the buffers of :func:`mic` for a robot, or for robots in lanes; see :func:`lanes.zeros`."""
    n, n_a = len(prior.link_mass), len(prior.arm_mount)
    return MicWork(
        zeros(one, n), zeros(one, n), zeros(one, n), zeros(one, n), zeros(one, n), zeros(one, (n_a, 2))
    )  # fmt: skip


@kernel(inline=True)
def mic(prior, reference, held, Kp, Kd, at, obs, work, wrench, torque):
    """Write the base wrench (3,), base axes, and the joint torques (n_l,) of the law.

    prior: the model that the controller believes; its rigid part and object are used.
    reference: the formation that the task asks for (:class:`reference.Reference`).
    held: joints that hold their angles; Kp [1/s2], Kd [1/s]: gains of Eqs. 9 and 12.
    at: a :class:`Layout`; obs: an observation.
    """
    n_g = len(prior.grasp_arm)
    ref = at.reference
    turn, axd, ayd = obs[ref + 2], obs[ref + 3], obs[ref + 4]
    # Base axes seen from the reference axes, in which errors and the reference are given.
    yaw = reference.yaw - obs[at.base + 2]
    cb, sb = cos(yaw), sin(yaw)
    b = at.base
    ax = axd - turn * turn * reference.base_x + Kp * obs[b] + Kd * obs[b + 3]
    ay = ayd - turn * turn * reference.base_y + Kp * obs[b + 1] + Kd * obs[b + 4]
    alpha = Kp * obs[b + 2] + Kd * obs[b + 5]
    ax, ay = cb * ax + sb * ay, cb * ay - sb * ax
    w = obs[at.yaw_rate]

    _links(prior, obs, at.angle, w, work)
    work.hold[:] = 0.0
    for k in range(len(held)):
        joint = held[k]
        work.hold[joint] = Kp * obs[at.hold + k] - Kd * obs[at.angle + len(prior.link_mass) + joint]
    work.grip[:] = 0.0
    if prior.object_mass > 0.0:
        _grip_forces(prior, reference, Kp, Kd, at, obs, cb, sb, work)
    for arm in range(len(prior.arm_mount)):
        for k in range(prior.arm_first[arm], prior.arm_first[arm + 1]):
            before = alpha if k == prior.arm_first[arm] else work.alpha[k - 1]
            work.alpha[k] = before + work.hold[k]
    for g in range(n_g):
        # Desired tip acceleration: formation turning with the reference, and the error law of Eq. 12.
        c, s = cos(reference.phi), sin(reference.phi)
        gx = c * prior.grasp_point[g, 0] - s * prior.grasp_point[g, 1]
        gy = s * prior.grasp_point[g, 0] + c * prior.grasp_point[g, 1]
        e, ed = at.tip + 2 * g, at.tip + 2 * (n_g + g)
        tx = axd - turn * turn * gx + Kp * obs[e] + Kd * obs[ed]
        ty = ayd - turn * turn * gy + Kp * obs[e + 1] + Kd * obs[ed + 1]
        tx, ty = cb * tx + sb * ty, cb * ty - sb * tx
        _reach(prior, prior.grasp_arm[g], tx - ax, ty - ay, alpha, w, work)
    _inverse_dynamics(prior, ax, ay, alpha, w, work, wrench, torque)


@kernel(inline=True)
def _links(prior, obs, at, yaw_rate, work):
    """Link directions in base axes and absolute angular velocities, from observed joint angles and rates."""
    n_l = len(prior.link_mass)
    for arm in range(len(prior.arm_mount)):
        angle, rate = prior.arm_mount[arm, 2], yaw_rate
        for k in range(prior.arm_first[arm], prior.arm_first[arm + 1]):
            angle += obs[at + k]
            rate += obs[at + n_l + k]
            work.c[k], work.s[k], work.rate[k] = cos(angle), sin(angle), rate


@kernel(inline=True)
def _grip_forces(prior, reference, Kp, Kd, at, obs, cb, sb, work):
    """Gripper forces that move the object, ``G# M v`` (Eqs. 9-11), into ``work.grip``, base axes."""
    o, ref, n_g = at.object, at.reference, len(prior.grasp_arm)
    fx = prior.object_mass * (obs[ref + 3] + Kp * obs[o] + Kd * obs[o + 3])
    fy = prior.object_mass * (obs[ref + 4] + Kp * obs[o + 1] + Kd * obs[o + 4])
    moment = prior.object_inertia * (Kp * obs[o + 2] + Kd * obs[o + 5])
    fx, fy = cb * fx + sb * fy, cb * fy - sb * fx
    # Object axes seen from the base axes.
    phi = reference.phi - obs[o + 2] - reference.yaw + obs[at.base + 2]
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
        work.grip[prior.grasp_arm[g], 0] = push_x - twist * gy
        work.grip[prior.grasp_arm[g], 1] = push_y + twist * gx


@kernel(inline=True)
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


@kernel(inline=True)
def _inverse_dynamics(prior, ax, ay, alpha, w, work, wrench, torque):
    """Forces for commanded accelerations, tip forces included: ``Q = H qdd + C + J' F_e`` (Eqs. 6, 7 and 13)."""
    fx, fy, moment = prior.base_mass * ax, prior.base_mass * ay, prior.base_inertia * alpha
    for arm in range(len(prior.arm_mount)):
        first, last = prior.arm_first[arm], prior.arm_first[arm + 1]
        x, y = prior.arm_mount[arm, 0], prior.arm_mount[arm, 1]
        # Accelerations outward: that of the tip, then unwound link by link on the way back.
        px, py = ax - alpha * y - w * w * x, ay + alpha * x - w * w * y
        for k in range(first, last):
            turn, w2 = work.alpha[k], work.rate[k] * work.rate[k]
            px -= prior.link_length[k] * (turn * work.s[k] + w2 * work.c[k])
            py += prior.link_length[k] * (turn * work.c[k] - w2 * work.s[k])
        gx, gy, load = work.grip[arm, 0], work.grip[arm, 1], 0.0
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
