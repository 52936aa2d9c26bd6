"""The rigid-flexible interactive model (Eqs. 1-4, 49-53) with the pinned object (Eq. 8), solved exactly.

Every subsystem is eliminated into the base: an arm leaves an apparent mass at its mount, a panel its condensed inertia
at its root, a grasping arm a spring-like link between base and object. What remains are two 3 x 3 systems::

    base    (M_b + sum B'Y B) xdd_b - sum B'Y O xdd_o = F_b - p_b + sum B'Y r
    object  (M_o + sum O'Y O) xdd_o - sum O'Y B xdd_b = F_o       - sum O'Y r
    grasp   lam = Y (O xdd_o + r - B xdd_b),   Y = Lam^-1

All inner vectors are in base axes; positions, velocities and the result are inertial.
"""

from __future__ import annotations

from typing import NamedTuple

from sffr_gym import arms, panel
from sffr_gym._jit import kernel
from sffr_gym.angles import cos_sin_near
from sffr_gym.beam import Array
from sffr_gym.grasp import couple_object, solve_object
from sffr_gym.lanes import ONE, zeros
from sffr_gym.linalg import symmetric_inverse, times
from sffr_gym.model import N_BASE, is_staggered


class Work(NamedTuple):
    """Buffers of one evaluation; what a function leaves here the next one reads. One for each thread."""

    c: Array  # (n_l,) link directions, base axes
    s: Array  # (n_l,)
    rate: Array  # (n_l,) absolute angular velocity [rad/s]
    joint: Array  # (n_l, 6) h_x, h_y, 1/J, alpha0, y_x, y_y
    tip: Array  # (n_a, 9) X (4), Lam (3), b (2)
    elastic: Array  # (n_p, 2, n_m) modal forces f, rotation coupling
    root: Array  # (n_p, 8) condensed inertia and bias of each panel, panel axes
    grasp: Array  # (n_g, 15) Y (3), B (6), O's last column (2), r (2), lam (2)
    base_inv: Array  # (3, 3) inverse of the base's system
    object_inv: Array  # (3, 3) inverse of the object's
    cross: Array  # (3, 3) sum O'Y B
    acceleration: Array  # (6,) base and object accelerations, base axes
    heading: Array  # (2,) cosine and sine of the yaw
    column: Array  # (3,) right-hand side of the base
    anchor: Array  # (n_l + 2, 3) angle, cosine and sine at the start of a step: links, yaw, object relative to the base
    held: Array  # (3,) Q_flex of the start of a step, under the staggered coupling


@kernel(allocates=True)
def workspace(model, one=ONE):
    """Allocate the buffers of :func:`accelerations` for a robot, or for robots in lanes; see :func:`lanes.zeros`."""
    n_l, n_a, n_g = len(model.link_mass), len(model.arm_mount), len(model.grasp_arm)
    n_p, n_m = model.omega2.shape
    return Work(
        c=zeros(one, n_l), s=zeros(one, n_l), rate=zeros(one, n_l),
        joint=zeros(one, (n_l, 6)), tip=zeros(one, (n_a, 9)),
        elastic=zeros(one, (n_p, 2, n_m)), root=zeros(one, (n_p, 8)), grasp=zeros(one, (n_g, 15)),
        base_inv=zeros(one, (3, 3)), object_inv=zeros(one, (3, 3)), cross=zeros(one, (3, 3)),
        acceleration=zeros(one, 6), heading=zeros(one, 2), column=zeros(one, 3), held=zeros(one, 3),
        anchor=zeros(one, (n_l + 2, 3)),
    )  # fmt: skip


@kernel(inline=True)
def accelerations(model, p, v, tau, work, out, held=False, anew=True):
    """Solve the equations of motion.

    p, v: (n,) positions and velocities; see ``model``.
    tau: (n,) generalised forces: base wrench (base axes), joint torques, modal forces of the piezos, and the wrench of
        the surroundings on the object (inertial axes).
    out: (n,) accelerations, written.
    anew: the state is not near the one of the last call that was anew, a step of the integrator away at most.
    held: the base feels ``work.held`` instead of the panels' present reaction, as in Fig. 1.

    Source: Eqs. 2-4 and 40 with the elastic accelerations eliminated, Eq. 8 with the grasp forces solved from the pins,
    whose errors decay at ``model.baumgarte``.
    """
    n_l = len(model.link_mass)
    work.heading[0], work.heading[1] = cos_sin_near(work.anchor[n_l], p[2], anew)
    arms.link_directions(model, p, v, work, anew)
    H, bias = _base_inertia(model, p, v, tau, work, held)
    if model.object_mass > 0.0:
        H, bias = couple_object(model, p, v, tau, work, H, bias, anew)
    symmetric_inverse(H, work.base_inv)
    work.column[0], work.column[1], work.column[2] = tau[0] - bias[0], tau[1] - bias[1], tau[2] - bias[2]
    _solve(model, work, 1.0)
    _distribute(model, v, work, 1.0, out)


@kernel(inline=True)
def stiff_response(model, v, panel_index, mode, work, out):
    """Accelerations that a unit force on one clamped mode causes; call after :func:`accelerations` at the same state.

    Source: a column of the inverse of the condensed mass matrix; under the staggered coupling the mode answers alone.
    """
    at = N_BASE + len(model.link_mass) + panel_index * model.omega2.shape[1] + mode
    if is_staggered(model):
        out[:] = 0.0
        out[at] = 1.0
        return
    force, turn = model.translation[panel_index, mode], work.elastic[panel_index, 1, mode]
    c, s = model.panel_axis[panel_index, 0], model.panel_axis[panel_index, 1]
    if mode < model.n_axial:
        fx, fy = c * force, s * force
    else:
        fx, fy = -s * force, c * force
    x, y = model.panel_root[panel_index, 0], model.panel_root[panel_index, 1]
    work.column[0], work.column[1], work.column[2] = -fx, -fy, -(x * fy - y * fx + turn)
    _solve(model, work, 0.0)
    _distribute(model, v, work, 0.0, out)
    out[at] += 1.0


@kernel(inline=True)
def flexible_wrench(model, v, work):
    """Q_flex of Eqs. 4 and 53: force (inertial axes) [N] and moment about the base's centre of mass [N m].

    Call after :func:`accelerations` at the same state.
    """
    ax, ay, alpha = work.acceleration[0], work.acceleration[1], work.acceleration[2]
    fx = fy = moment = 0.0
    for i in range(model.omega2.shape[0]):
        c, s = model.panel_axis[i, 0], model.panel_axis[i, 1]
        rx, ry = _root_acceleration(model, i, ax, ay, alpha, v[2] * v[2])
        root = work.root[i]
        hx, hy = root[2], root[3]
        gx, gy = root[0] * rx + hx * alpha + root[5], root[1] * ry + hy * alpha + root[6]
        bx, by = c * gx - s * gy, s * gx + c * gy
        fx -= bx
        fy -= by
        x, y = model.panel_root[i, 0], model.panel_root[i, 1]
        moment -= x * by - y * bx + hx * rx + hy * ry + root[4] * alpha + root[7]
    cb, sb = work.heading[0], work.heading[1]
    return cb * fx - sb * fy, sb * fx + cb * fy, moment


@kernel(inline=True)
def _base_inertia(model, p, v, tau, work, held):
    """Inertia and bias of the base with all arms and panels eliminated into it, or the arms and ``work.held``.

    Returns ``(Hxx, Hxy, Hxz, Hyy, Hyz, Hzz)`` and ``(px, py, pz)`` over base acceleration (base axes) and yaw.
    """
    w2 = v[2] * v[2]
    H, bias = (model.base_mass, 0.0, 0.0, model.base_mass, 0.0, model.base_inertia), (0.0, 0.0, 0.0)
    for arm in range(len(model.arm_first) - 1):
        Mxx, Mxy, Myy, qx, qy, torque = arms.articulate(model, arm, tau, work)
        inertia = (Mxx, Mxy, 0.0, Myy, 0.0, 0.0)
        H, bias = _attach(H, bias, model.arm_mount[arm, 0], model.arm_mount[arm, 1], w2, inertia, (qx, qy, torque))
    start, n_m = N_BASE + len(model.link_mass), model.omega2.shape[1]
    for i in range(model.omega2.shape[0]):
        condensed = panel.condense(model, i, p, v, tau, start + i * n_m, v[2], work)
        root = work.root[i]
        root[0], root[1], root[2], root[3], root[4], root[5], root[6], root[7] = condensed
    if held:
        cb, sb, fx, fy = work.heading[0], work.heading[1], work.held[0], work.held[1]
        return H, (bias[0] - cb * fx - sb * fy, bias[1] + sb * fx - cb * fy, bias[2] - work.held[2])
    for i in range(model.omega2.shape[0]):
        root = work.root[i]
        Mx, My, hx, hy, J, qx, qy, torque = root[0], root[1], root[2], root[3], root[4], root[5], root[6], root[7]
        c, s = model.panel_axis[i, 0], model.panel_axis[i, 1]
        inertia = (
            c * c * Mx + s * s * My, c * s * (Mx - My), c * hx - s * hy, s * s * Mx + c * c * My, s * hx + c * hy, J
        )  # fmt: skip
        load = (c * qx - s * qy, s * qx + c * qy, torque)
        H, bias = _attach(H, bias, model.panel_root[i, 0], model.panel_root[i, 1], w2, inertia, load)
    return H, bias


@kernel(inline=True)
def _attach(H, bias, x, y, w2, inertia, load):
    """Add an appendage at the point (x, y) of the base, base axes, to the base's inertia and bias.

    inertia: the appendage's apparent inertia about that point, in the order of H; load: force and moment that it needs
    there at rest. w2: squared yaw rate.
    """
    Hxx, Hxy, Hxz, Hyy, Hyz, Hzz = H
    px, py, pz = bias
    Mxx, Mxy, hx, Myy, hy, J = inertia
    qx, qy, torque = load
    rx, ry = Mxy * x - Mxx * y, Myy * x - Mxy * y  # M times the point's motion (-y, x) per unit yaw
    qx -= w2 * (Mxx * x + Mxy * y)
    qy -= w2 * (Mxy * x + Myy * y)
    Hzz += x * ry - y * rx + 2.0 * (x * hy - y * hx) + J
    pz += x * qy - y * qx + torque - w2 * (hx * x + hy * y)
    return (Hxx + Mxx, Hxy + Mxy, Hxz + rx + hx, Hyy + Myy, Hyz + ry + hy, Hzz), (px + qx, py + qy, pz)


@kernel(inline=True)
def _solve(model, work, bias):
    """Solve base, object and grasps for ``work.column``; bias 0 gives the linear response to that column alone."""
    rhs, acc = work.column, work.acceleration
    acc[0], acc[1], acc[2] = times(work.base_inv, rhs[0], rhs[1], rhs[2])
    if model.object_mass > 0.0:
        solve_object(model, work, bias)


@kernel(inline=True)
def _distribute(model, v, work, bias, out):
    """Run outward from base and object and write every acceleration, inertial axes."""
    cb, sb = work.heading[0], work.heading[1]
    acc = work.acceleration
    ax, ay, alpha = acc[0], acc[1], acc[2]
    w2 = bias * v[2] * v[2]
    out[0], out[1], out[2] = cb * ax - sb * ay, sb * ax + cb * ay, alpha
    for arm in range(len(model.arm_first) - 1):
        x, y = model.arm_mount[arm, 0], model.arm_mount[arm, 1]
        lamx = lamy = 0.0
        for g in range(len(model.grasp_arm)):
            if model.grasp_arm[g] == arm:
                lamx, lamy = work.grasp[g, 13], work.grasp[g, 14]
        arms.expand(model, arm, ax - alpha * y - w2 * x, ay + alpha * x - w2 * y, alpha, lamx, lamy, bias, work, out)
    start = N_BASE + len(model.link_mass)
    for i in range(model.omega2.shape[0]):
        rx, ry = _root_acceleration(model, i, ax, ay, alpha, w2)
        panel.expand(model, i, rx, ry, alpha, start + i * model.omega2.shape[1], bias, work, out)
    if model.object_mass > 0.0:
        at = len(out) - 3
        out[at], out[at + 1], out[at + 2] = cb * acc[3] - sb * acc[4], sb * acc[3] + cb * acc[4], acc[5]


@kernel(inline=True)
def _root_acceleration(model, i, ax, ay, alpha, w2):
    """Acceleration of a panel's root in panel axes (Eq. 49 differentiated twice)."""
    c, s = model.panel_axis[i, 0], model.panel_axis[i, 1]
    x, y = model.panel_root[i, 0], model.panel_root[i, 1]
    rx, ry = ax - alpha * y - w2 * x, ay + alpha * x - w2 * y
    return c * rx + s * ry, c * ry - s * rx
