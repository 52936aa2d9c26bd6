"""The object pinned in the grippers (Eq. 8): grasp forces and object eliminated into the base.

Each grasping arm's tip accelerates as ``B xdd_b + Lam lam + b`` and is pinned to the object's ``O xdd_o`` plus its
centripetal part, so that ``lam = Y (O xdd_o + r - B xdd_b)`` with ``Y = Lam^-1``; see ``dynamics`` for the system.
"""

from __future__ import annotations

from typing import NamedTuple

from sffr_gym.compile.angles import Anchor, anchor_shapes, cos_sin_near
from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.linalg import symmetric_inverse, times, times_transposed
from sffr_gym.compile.workspace import Interleaved
from sffr_gym.physics import arms
from sffr_gym.types import Array


class Pins(NamedTuple):
    """The grasps, base axes; ``lam = Y (O xdd_o + r - B xdd_b)``."""

    Y_xx: Array  #: (n_g,) [kg]
    Y_xy: Array  #: (n_g,)
    Y_yy: Array  #: (n_g,)
    B_xx: Array  #: (n_g,) map of the base's motion to the tip
    B_xy: Array  #: (n_g,)
    B_xz: Array  #: (n_g,)
    B_yx: Array  #: (n_g,)
    B_yy: Array  #: (n_g,)
    B_yz: Array  #: (n_g,)
    g_x: Array  #: (n_g,) grasp point from the object's centre of mass [m]; ``O = [1, 0, -g_y; 0, 1, g_x]``
    g_y: Array  #: (n_g,)
    r_x: Array  #: (n_g,) [m/s2]
    r_y: Array  #: (n_g,)
    lam_x: Array  #: (n_g,) force of the object on the tip [N]
    lam_y: Array  #: (n_g,)


class Grasps(NamedTuple):
    """The pinned object and its grasps, base axes."""

    pins: Pins
    cross: Array  #: (3, 3) sum of ``O' Y B``
    inverse: Array  #: (3, 3) inverse of the object's system
    free: Array  #: (3,) the object's acceleration for a base at rest
    acceleration: Array  #: (3,) the object's
    anchor: Anchor  #: its angle relative to the base at the start of a step


def grasp_shapes(n):
    """Shapes of :class:`Grasps` for ``n`` of them."""
    pins = Pins((n,), (n,), (n,), (n,), (n,), (n,), (n,), (n,), (n,), (n,), (n,), (n,), (n,), (n,), (n,))
    return Grasps(
        Interleaved(pins), cross=(3, 3), inverse=(3, 3), free=(3,), acceleration=(3,), anchor=anchor_shapes(1)
    )


@kernel
def couple_object(model, p, v, tau, cb, sb, links, tips, grasps, H, bias, refresh):
    """Add the grasps to the base's system and eliminate the object; see the module's equations.

    p, v, tau: (n,) positions, velocities and generalised forces; cb, sb: cosine and sine of the yaw.
    links: :class:`arms.Links`; tips: :class:`arms.Tips`; grasps: :class:`Grasps`, written.
    H, bias: inertia (6 entries of a symmetric matrix) and bias (3) of the base's system; returned with the object in.
    refresh: see :func:`arms.link_directions`.
    """
    at = model.at.object
    wo2 = v[at + 2] * v[at + 2]
    w2, kappa = v[2] * v[2], model.baumgarte
    # Object relative to the base, and its rotation, in base axes.
    dx, dy = p[at] - p[0], p[at + 1] - p[1]
    dxd, dyd = v[at] - v[0], v[at + 1] - v[1]
    dx, dy, dxd, dyd = cb * dx + sb * dy, cb * dy - sb * dx, cb * dxd + sb * dyd, cb * dyd - sb * dxd
    cp, sp = cos_sin_near(grasps.anchor, 0, p[at + 2] - p[2], refresh)
    pins, cross = grasps.pins, grasps.cross
    cross[:] = 0.0
    Hxx, Hxy, Hxz, Hyy, Hyz, Hzz = H
    px, py, pz = bias
    Oxx = Oyy = model.object_mass
    Ozz = model.object_inertia
    Oxy = Oxz = Oyz = 0.0
    qx, qy, qz = cb * tau[at] + sb * tau[at + 1], cb * tau[at + 1] - sb * tau[at], tau[at + 2]
    for g in range(len(model.grasp_arm)):
        arm = model.grasp_arm[g]
        gx, gy = model.grasp_point[g, 0], model.grasp_point[g, 1]
        gx, gy = cp * gx - sp * gy, sp * gx + cp * gy
        x, y = model.arm_mount[arm, 0], model.arm_mount[arm, 1]
        tx, ty, txd, tyd = arms.tip_motion(model, arm, v[2], links)
        gap_x, gap_y = tx - dx - gx, ty - dy - gy
        gap_xd, gap_yd = txd - dxd + v[at + 2] * gy, tyd - dyd - v[at + 2] * gx
        # Tip map to the base's motion: B = [X, X (-y, x)], and the remainder r of the pin's acceleration equation.
        Xxx, Xxy, Xyx, Xyy = tips.X_xx[arm], tips.X_xy[arm], tips.X_yx[arm], tips.X_yy[arm]
        Bxz, Byz = Xxy * x - Xxx * y, Xyy * x - Xyx * y
        rx = -wo2 * gx - tips.b_x[arm] + w2 * (Xxx * x + Xxy * y) - kappa * (2.0 * gap_xd + kappa * gap_x)
        ry = -wo2 * gy - tips.b_y[arm] + w2 * (Xyx * x + Xyy * y) - kappa * (2.0 * gap_yd + kappa * gap_y)
        Lxx, Lxy, Lyy = tips.Lam_xx[arm], tips.Lam_xy[arm], tips.Lam_yy[arm]
        det = 1.0 / (Lxx * Lyy - Lxy * Lxy)
        Yxx, Yxy, Yyy = Lyy * det, -Lxy * det, Lxx * det
        pins.Y_xx[g], pins.Y_xy[g], pins.Y_yy[g] = Yxx, Yxy, Yyy
        pins.B_xx[g], pins.B_xy[g], pins.B_xz[g] = Xxx, Xxy, Bxz
        pins.B_yx[g], pins.B_yy[g], pins.B_yz[g] = Xyx, Xyy, Byz
        pins.g_x[g], pins.g_y[g], pins.r_x[g], pins.r_y[g] = gx, gy, rx, ry
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
    inv = grasps.inverse
    symmetric_inverse((Oxx, Oxy, Oxz, Oyy, Oyz, Ozz), inv)
    # Free part of the object's acceleration, kept for solve; then the object's Schur complement.
    fx, fy, fz = times(inv, qx, qy, qz)
    grasps.free[0], grasps.free[1], grasps.free[2] = fx, fy, fz
    sx, sy, sz = times_transposed(cross, *times(inv, cross[0, 0], cross[1, 0], cross[2, 0]))
    tx, ty, tz = times_transposed(cross, *times(inv, cross[0, 1], cross[1, 1], cross[2, 1]))
    _, _, uz = times_transposed(cross, *times(inv, cross[0, 2], cross[1, 2], cross[2, 2]))
    gx, gy, gz = times_transposed(cross, fx, fy, fz)
    return (Hxx - sx, Hxy - sy, Hxz - sz, Hyy - ty, Hyz - tz, Hzz - uz), (px - gx, py - gy, pz - gz)


@kernel
def solve_object(model, ax, ay, az, full, grasps):
    """Acceleration of the object and grasp forces, into ``grasps``.

    ax, ay, az: the base's acceleration, base axes [m/s2], and of its yaw [rad/s2].
    full: the accelerations; else the linear response to the base's motion alone.
    """
    pins = grasps.pins
    ox, oy, oz = times(grasps.inverse, *times(grasps.cross, ax, ay, az))
    if full:
        ox, oy, oz = ox + grasps.free[0], oy + grasps.free[1], oz + grasps.free[2]
    grasps.acceleration[0], grasps.acceleration[1], grasps.acceleration[2] = ox, oy, oz
    for g in range(len(model.grasp_arm)):
        dx, dy = ox - pins.g_y[g] * oz, oy + pins.g_x[g] * oz
        if full:
            dx, dy = dx + pins.r_x[g], dy + pins.r_y[g]
        dx = dx - pins.B_xx[g] * ax - pins.B_xy[g] * ay - pins.B_xz[g] * az
        dy = dy - pins.B_yx[g] * ax - pins.B_yy[g] * ay - pins.B_yz[g] * az
        pins.lam_x[g] = pins.Y_xx[g] * dx + pins.Y_xy[g] * dy
        pins.lam_y[g] = pins.Y_xy[g] * dx + pins.Y_yy[g] * dy
