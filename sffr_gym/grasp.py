"""The object pinned in the grippers (Eq. 8): grasp forces and object eliminated into the base.

Each grasping arm's tip accelerates as ``B xdd_b + Lam lam + b`` and is pinned to the object's ``O xdd_o`` plus its
centripetal part, so that ``lam = Y (O xdd_o + r - B xdd_b)`` with ``Y = Lam^-1``; see ``dynamics`` for the system.
"""

from __future__ import annotations

from sffr_gym import arms
from sffr_gym._jit import kernel
from sffr_gym.angles import cos_sin_near
from sffr_gym.linalg import symmetric_inverse, times, times_transposed


@kernel(inline=True)
def couple_object(model, p, v, tau, work, H, bias, anew):
    """Add the grasps to the base's system and eliminate the object; see the module's equations."""
    cb, sb = work.heading[0], work.heading[1]
    at = len(p) - 3
    wo2 = v[at + 2] * v[at + 2]
    w2, kappa = v[2] * v[2], model.baumgarte
    # Object relative to the base, and its rotation, in base axes.
    dx, dy = p[at] - p[0], p[at + 1] - p[1]
    dxd, dyd = v[at] - v[0], v[at + 1] - v[1]
    dx, dy, dxd, dyd = cb * dx + sb * dy, cb * dy - sb * dx, cb * dxd + sb * dyd, cb * dyd - sb * dxd
    cp, sp = cos_sin_near(work.anchor[len(model.link_mass) + 1], p[at + 2] - p[2], anew)
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
    symmetric_inverse((Oxx, Oxy, Oxz, Oyy, Oyz, Ozz), inv)
    # Free part of the object's acceleration, kept for solve; then the object's Schur complement.
    fx, fy, fz = times(inv, qx, qy, qz)
    work.acceleration[3], work.acceleration[4], work.acceleration[5] = fx, fy, fz
    sx, sy, sz = times_transposed(cross, *times(inv, cross[0, 0], cross[1, 0], cross[2, 0]))
    tx, ty, tz = times_transposed(cross, *times(inv, cross[0, 1], cross[1, 1], cross[2, 1]))
    _, _, uz = times_transposed(cross, *times(inv, cross[0, 2], cross[1, 2], cross[2, 2]))
    gx, gy, gz = times_transposed(cross, fx, fy, fz)
    return (Hxx - sx, Hxy - sy, Hxz - sz, Hyy - ty, Hyz - tz, Hzz - uz), (px - gx, py - gy, pz - gz)


@kernel(inline=True)
def solve_object(model, work, bias):
    """Acceleration of the object and grasp forces for the base's acceleration in ``work.acceleration``.

    bias: 1 for the accelerations, 0 for the linear response to the base's motion alone.
    """
    acc = work.acceleration
    ax, ay, az = acc[0], acc[1], acc[2]
    ox, oy, oz = times(work.object_inv, *times(work.cross, ax, ay, az))
    ox, oy, oz = ox + bias * acc[3], oy + bias * acc[4], oz + bias * acc[5]
    acc[3], acc[4], acc[5] = ox, oy, oz
    for g in range(len(model.grasp_arm)):
        grasp = work.grasp[g]
        dx = ox + grasp[9] * oz + bias * grasp[11] - grasp[3] * ax - grasp[4] * ay - grasp[5] * az
        dy = oy + grasp[10] * oz + bias * grasp[12] - grasp[6] * ax - grasp[7] * ay - grasp[8] * az
        grasp[13] = grasp[0] * dx + grasp[1] * dy
        grasp[14] = grasp[1] * dx + grasp[2] * dy
