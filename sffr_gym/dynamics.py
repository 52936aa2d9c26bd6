"""The rigid-flexible interactive model (Eqs. 1-4, 49-53) with the pinned object (Eq. 8), solved exactly.

Every subsystem is eliminated into the base: an arm leaves an apparent mass at its mount, a panel its condensed inertia at
its root, a grasping arm a spring-like link between base and object. What remains are two 3 x 3 systems::

    base    (M_b + sum B'Y B) xdd_b - sum B'Y O xdd_o = F_b - p_b + sum B'Y r
    object  (M_o + sum O'Y O) xdd_o - sum O'Y B xdd_b = F_o       - sum O'Y r
    grasp   lam = Y (O xdd_o + r - B xdd_b),   Y = Lam^-1

All inner vectors are in base axes; positions, velocities and the result are inertial.
"""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple

import numpy as np

from sffr_gym import arms, panel
from sffr_gym._jit import kernel
from sffr_gym.beam import Array
from sffr_gym.model import N_BASE


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


@kernel(allocates=True)
def workspace(model):
    """Allocate the buffers of :func:`accelerations` for a robot."""
    n_l, n_a, n_g = len(model.link_mass), len(model.arm_mount), len(model.grasp_arm)
    n_p, n_m = model.omega2.shape
    return Work(
        c=np.zeros(n_l), s=np.zeros(n_l), rate=np.zeros(n_l), joint=np.zeros((n_l, 6)), tip=np.zeros((n_a, 9)),
        elastic=np.zeros((n_p, 2, n_m)), root=np.zeros((n_p, 8)), grasp=np.zeros((n_g, 15)),
        base_inv=np.zeros((3, 3)), object_inv=np.zeros((3, 3)), cross=np.zeros((3, 3)),
        acceleration=np.zeros(6), heading=np.zeros(2), column=np.zeros(3),
    )  # fmt: skip


@kernel(inline=True)
def accelerations(model, p, v, tau, work, out):
    """Solve the equations of motion.

    p, v: (n,) positions and velocities; see ``model``.
    tau: (n,) generalised forces: base wrench (base axes), joint torques, modal forces of the piezos, and the wrench of
        the surroundings on the object (inertial axes).
    out: (n,) accelerations, written.

    Source: Eqs. 2-4 and 40 with the elastic accelerations eliminated (coupling ``exact``), Eq. 8 with the grasp forces
    solved from the pins, whose errors decay at ``model.baumgarte``.
    """
    work.heading[0], work.heading[1] = cos(p[2]), sin(p[2])
    arms.link_directions(model, p, v, work)
    H, bias = _base_inertia(model, p, v, tau, work)
    if model.object_mass > 0.0:
        H, bias = _couple_object(model, p, v, tau, work, H, bias)
    _symmetric_inverse(H, work.base_inv)
    work.column[0], work.column[1], work.column[2] = tau[0] - bias[0], tau[1] - bias[1], tau[2] - bias[2]
    _solve(model, work, 1.0)
    _distribute(model, v, work, 1.0, out)


@kernel(inline=True)
def stiff_response(model, v, panel_index, mode, work, out):
    """Accelerations that a unit force on one clamped mode causes; call after :func:`accelerations` at the same state.

    Source: a column of the inverse of the condensed mass matrix.
    """
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
    n_modes = model.omega2.shape[1]
    out[N_BASE + len(model.link_mass) + panel_index * n_modes + mode] += 1.0


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
def _base_inertia(model, p, v, tau, work):
    """Inertia and bias of the base with all arms and panels eliminated into it.

    Returns ``(Hxx, Hxy, Hxz, Hyy, Hyz, Hzz)`` and ``(px, py, pz)`` over base acceleration (base axes) and yaw.
    """
    w2 = v[2] * v[2]
    Hxx = Hyy = model.base_mass
    Hzz = model.base_inertia
    Hxy = Hxz = Hyz = 0.0
    px = py = pz = 0.0
    for arm in range(len(model.arm_first) - 1):
        Mxx, Mxy, Myy, qx, qy, torque = arms.articulate(model, arm, tau, work)
        x, y = model.arm_mount[arm, 0], model.arm_mount[arm, 1]
        rx, ry = Mxy * x - Mxx * y, Myy * x - Mxy * y  # M times the mount's motion (-y, x) per unit yaw
        qx -= w2 * (Mxx * x + Mxy * y)
        qy -= w2 * (Mxy * x + Myy * y)
        Hxx += Mxx
        Hxy += Mxy
        Hyy += Myy
        Hxz += rx
        Hyz += ry
        Hzz += x * ry - y * rx
        px += qx
        py += qy
        pz += x * qy - y * qx + torque
    start = N_BASE + len(model.link_mass)
    for i in range(model.omega2.shape[0]):
        condensed = panel.condense(model, i, p, v, tau, start + i * model.omega2.shape[1], v[2], work)
        Mx, My, hx, hy, J, qx, qy, torque = condensed
        root = work.root[i]
        root[0], root[1], root[2], root[3], root[4], root[5], root[6], root[7] = condensed
        c, s = model.panel_axis[i, 0], model.panel_axis[i, 1]
        x, y = model.panel_root[i, 0], model.panel_root[i, 1]
        Mxx, Mxy, Myy = c * c * Mx + s * s * My, c * s * (Mx - My), s * s * Mx + c * c * My
        hx, hy = c * hx - s * hy, s * hx + c * hy
        qx, qy = c * qx - s * qy, s * qx + c * qy
        rx, ry = Mxy * x - Mxx * y, Myy * x - Mxy * y
        qx -= w2 * (Mxx * x + Mxy * y)
        qy -= w2 * (Mxy * x + Myy * y)
        Hxx += Mxx
        Hxy += Mxy
        Hyy += Myy
        Hxz += rx + hx
        Hyz += ry + hy
        Hzz += x * ry - y * rx + 2.0 * (x * hy - y * hx) + J
        px += qx
        py += qy
        pz += x * qy - y * qx + torque - w2 * (hx * x + hy * y)
    return (Hxx, Hxy, Hxz, Hyy, Hyz, Hzz), (px, py, pz)


@kernel(inline=True)
def _couple_object(model, p, v, tau, work, H, bias):
    """Add the grasps to the base's system and eliminate the object; see the module's equations."""
    cb, sb = work.heading[0], work.heading[1]
    at = len(p) - 3
    wo2 = v[at + 2] * v[at + 2]
    w2, kappa = v[2] * v[2], model.baumgarte
    # Object relative to the base, and its rotation, in base axes.
    dx, dy = p[at] - p[0], p[at + 1] - p[1]
    dxd, dyd = v[at] - v[0], v[at + 1] - v[1]
    dx, dy, dxd, dyd = cb * dx + sb * dy, cb * dy - sb * dx, cb * dxd + sb * dyd, cb * dyd - sb * dxd
    cp, sp = cos(p[at + 2] - p[2]), sin(p[at + 2] - p[2])
    cross = work.cross
    cross[:] = 0.0
    Hxx, Hxy, Hxz, Hyy, Hyz, Hzz = H
    px, py, pz = bias
    Oxx = Oyy = model.object_mass
    Ozz = model.object_inertia
    Oxy = Oxz = Oyz = 0.0
    qx, qy, qz = cb * tau[at] + sb * tau[at + 1], cb * tau[at + 1] - sb * tau[at], tau[at + 2]
    for g in range(len(model.grasp_arm)):
        arm = model.grasp_arm[g]
        tip, grasp = work.tip[arm], work.grasp[g]
        gx, gy = model.grasp_point[g, 0], model.grasp_point[g, 1]
        gx, gy = cp * gx - sp * gy, sp * gx + cp * gy
        x, y = model.arm_mount[arm, 0], model.arm_mount[arm, 1]
        tx, ty, txd, tyd = arms.tip_motion(model, arm, v[2], work)
        gap_x, gap_y = tx - dx - gx, ty - dy - gy
        gap_xd, gap_yd = txd - dxd + v[at + 2] * gy, tyd - dyd - v[at + 2] * gx
        # Tip map to the base's motion: B = [X, X (-y, x)], and the remainder r of the pin's acceleration equation.
        Xxx, Xxy, Xyx, Xyy = tip[0], tip[1], tip[2], tip[3]
        Bxz, Byz = Xxy * x - Xxx * y, Xyy * x - Xyx * y
        rx = -wo2 * gx - tip[7] + w2 * (Xxx * x + Xxy * y) - kappa * (2.0 * gap_xd + kappa * gap_x)
        ry = -wo2 * gy - tip[8] + w2 * (Xyx * x + Xyy * y) - kappa * (2.0 * gap_yd + kappa * gap_y)
        det = 1.0 / (tip[4] * tip[6] - tip[5] * tip[5])
        Yxx, Yxy, Yyy = tip[6] * det, -tip[5] * det, tip[4] * det
        grasp[0], grasp[1], grasp[2] = Yxx, Yxy, Yyy
        grasp[3], grasp[4], grasp[5], grasp[6], grasp[7], grasp[8] = Xxx, Xxy, Bxz, Xyx, Xyy, Byz
        grasp[9], grasp[10], grasp[11], grasp[12] = -gy, gx, rx, ry
        # Y B, Y O, Y r
        Pxx, Pxy, Pxz = Yxx * Xxx + Yxy * Xyx, Yxx * Xxy + Yxy * Xyy, Yxx * Bxz + Yxy * Byz
        Pyx, Pyy, Pyz = Yxy * Xxx + Yyy * Xyx, Yxy * Xxy + Yyy * Xyy, Yxy * Bxz + Yyy * Byz
        sx, sy = Yxx * rx + Yxy * ry, Yxy * rx + Yyy * ry
        Yxz, Yyz = Yxy * gx - Yxx * gy, Yyy * gx - Yxy * gy
        Hxx += Xxx * Pxx + Xyx * Pyx
        Hxy += Xxx * Pxy + Xyx * Pyy
        Hxz += Xxx * Pxz + Xyx * Pyz
        Hyy += Xxy * Pxy + Xyy * Pyy
        Hyz += Xxy * Pxz + Xyy * Pyz
        Hzz += Bxz * Pxz + Byz * Pyz
        px -= Xxx * sx + Xyx * sy
        py -= Xxy * sx + Xyy * sy
        pz -= Bxz * sx + Byz * sy
        Oxx += Yxx
        Oxy += Yxy
        Oyy += Yyy
        Oxz += Yxz
        Oyz += Yyz
        Ozz += gx * Yyz - gy * Yxz
        qx -= sx
        qy -= sy
        qz -= gx * sy - gy * sx
        cross[0, 0] += Pxx
        cross[0, 1] += Pxy
        cross[0, 2] += Pxz
        cross[1, 0] += Pyx
        cross[1, 1] += Pyy
        cross[1, 2] += Pyz
        cross[2, 0] += gx * Pyx - gy * Pxx
        cross[2, 1] += gx * Pyy - gy * Pxy
        cross[2, 2] += gx * Pyz - gy * Pxz
    inv = work.object_inv
    _symmetric_inverse((Oxx, Oxy, Oxz, Oyy, Oyz, Ozz), inv)
    # Free part of the object's acceleration, kept for _solve; then the object's Schur complement.
    fx = inv[0, 0] * qx + inv[0, 1] * qy + inv[0, 2] * qz
    fy = inv[1, 0] * qx + inv[1, 1] * qy + inv[1, 2] * qz
    fz = inv[2, 0] * qx + inv[2, 1] * qy + inv[2, 2] * qz
    work.acceleration[3], work.acceleration[4], work.acceleration[5] = fx, fy, fz
    ux, uy, uz = _schur_column(inv, cross, 0)
    Hxx -= cross[0, 0] * ux + cross[1, 0] * uy + cross[2, 0] * uz
    ux, uy, uz = _schur_column(inv, cross, 1)
    Hxy -= cross[0, 0] * ux + cross[1, 0] * uy + cross[2, 0] * uz
    Hyy -= cross[0, 1] * ux + cross[1, 1] * uy + cross[2, 1] * uz
    ux, uy, uz = _schur_column(inv, cross, 2)
    Hxz -= cross[0, 0] * ux + cross[1, 0] * uy + cross[2, 0] * uz
    Hyz -= cross[0, 1] * ux + cross[1, 1] * uy + cross[2, 1] * uz
    Hzz -= cross[0, 2] * ux + cross[1, 2] * uy + cross[2, 2] * uz
    px -= cross[0, 0] * fx + cross[1, 0] * fy + cross[2, 0] * fz
    py -= cross[0, 1] * fx + cross[1, 1] * fy + cross[2, 1] * fz
    pz -= cross[0, 2] * fx + cross[1, 2] * fy + cross[2, 2] * fz
    return (Hxx, Hxy, Hxz, Hyy, Hyz, Hzz), (px, py, pz)


@kernel(inline=True)
def _schur_column(inv, cross, j):
    """Column ``j`` of ``inv @ cross``."""
    x, y, z = cross[0, j], cross[1, j], cross[2, j]
    return (
        inv[0, 0] * x + inv[0, 1] * y + inv[0, 2] * z,
        inv[1, 0] * x + inv[1, 1] * y + inv[1, 2] * z,
        inv[2, 0] * x + inv[2, 1] * y + inv[2, 2] * z,
    )


@kernel(inline=True)
def _solve(model, work, bias):
    """Solve base, object and grasps for ``work.column``; bias 0 gives the linear response to that column alone."""
    inv, rhs, acc = work.base_inv, work.column, work.acceleration
    ax = inv[0, 0] * rhs[0] + inv[0, 1] * rhs[1] + inv[0, 2] * rhs[2]
    ay = inv[1, 0] * rhs[0] + inv[1, 1] * rhs[1] + inv[1, 2] * rhs[2]
    az = inv[2, 0] * rhs[0] + inv[2, 1] * rhs[1] + inv[2, 2] * rhs[2]
    acc[0], acc[1], acc[2] = ax, ay, az
    if model.object_mass == 0.0:
        return
    inv, cross = work.object_inv, work.cross
    qx = cross[0, 0] * ax + cross[0, 1] * ay + cross[0, 2] * az
    qy = cross[1, 0] * ax + cross[1, 1] * ay + cross[1, 2] * az
    qz = cross[2, 0] * ax + cross[2, 1] * ay + cross[2, 2] * az
    ox = bias * acc[3] + inv[0, 0] * qx + inv[0, 1] * qy + inv[0, 2] * qz
    oy = bias * acc[4] + inv[1, 0] * qx + inv[1, 1] * qy + inv[1, 2] * qz
    oz = bias * acc[5] + inv[2, 0] * qx + inv[2, 1] * qy + inv[2, 2] * qz
    acc[3], acc[4], acc[5] = ox, oy, oz
    for g in range(len(model.grasp_arm)):
        grasp = work.grasp[g]
        dx = ox + grasp[9] * oz + bias * grasp[11] - grasp[3] * ax - grasp[4] * ay - grasp[5] * az
        dy = oy + grasp[10] * oz + bias * grasp[12] - grasp[6] * ax - grasp[7] * ay - grasp[8] * az
        grasp[13] = grasp[0] * dx + grasp[1] * dy
        grasp[14] = grasp[1] * dx + grasp[2] * dy


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


@kernel(inline=True)
def _symmetric_inverse(A, out):
    """Invert a symmetric 3 x 3 matrix given as ``(xx, xy, xz, yy, yz, zz)`` by its adjugate."""
    xx, xy, xz, yy, yz, zz = A
    cxx, cxy, cxz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    det = 1.0 / (xx * cxx + xy * cxy + xz * cxz)
    out[0, 0], out[1, 1], out[2, 2] = cxx * det, (xx * zz - xz * xz) * det, (xx * yy - xy * xy) * det
    out[0, 1] = out[1, 0] = cxy * det
    out[0, 2] = out[2, 0] = cxz * det
    out[1, 2] = out[2, 1] = (xy * xz - xx * yz) * det
