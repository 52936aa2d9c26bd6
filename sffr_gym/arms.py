"""Rigid arms (Eqs. 40-43): an articulated-body recursion in base axes, arm by arm, linear in the number of links.

With each link's absolute angular acceleration ``alpha`` as coordinate, a planar revolute joint passes a force and its
own torque only, so that eliminating a link leaves a 2 x 2 apparent mass at its joint. For an arm that grasps the
object the same pass carries the tip's acceleration as a function of the first joint's acceleration ``a`` and the grasp
force
``lam``, the Popov-Vereshchagin scheme::

    joint force   f     = M a + p - X' lam
    tip           a_tip = X a + Lam lam + b
"""

from __future__ import annotations

from sffr_gym._jit import kernel
from sffr_gym.angles import cos_sin_near
from sffr_gym.model import N_BASE


@kernel(inline=True)
def link_directions(model, p, v, work, anew):
    """Fill the direction (cosine, sine) of each link in base axes and its absolute angular velocity.

    anew: compute them alone, instead of from those of the last time that was anew; see :mod:`angles`.
    """
    for arm in range(len(model.arm_first) - 1):
        angle, rate = model.arm_mount[arm, 2], v[2]
        for k in range(model.arm_first[arm], model.arm_first[arm + 1]):
            angle += p[N_BASE + k]
            rate += v[N_BASE + k]
            work.c[k], work.s[k] = cos_sin_near(work.anchor[k], angle, anew)
            work.rate[k] = rate


@kernel(inline=True)
def articulate(model, arm, tau, work):
    """Eliminate the links of one arm from its tip to its mount.

    tau: (n,) generalised forces; those of the arm's joints are used [N m].

    Leaves in ``work`` the joint rows ``h, J_inv, alpha0, y`` that :func:`expand` needs and returns
    ``(Mxx, Mxy, Myy, px, py, torque)``: apparent mass and bias at the first joint, and the torque whose reaction the
    base feels. ``work.X, work.Lam, work.b`` of the arm hold the tip's map.
    """
    Mxx = Mxy = Myy = px = py = torque = 0.0
    Xxx = Xyy = 1.0
    Xxy = Xyx = 0.0
    Lxx = Lxy = Lyy = bx = by = 0.0
    first = model.arm_first[arm]
    for k in range(model.arm_first[arm + 1] - 1, first - 1, -1):
        c, s, w2 = work.c[k], work.s[k], work.rate[k] * work.rate[k]
        length, com, mass = model.link_length[k], model.link_com[k], model.link_mass[k]
        # The child hangs at the far end, whose acceleration is a + alpha l n - w2 l u with u = (c, s), n = (-s, c).
        Mnx, Mny = Mxy * c - Mxx * s, Myy * c - Mxy * s
        px -= w2 * length * (Mxx * c + Mxy * s)
        py -= w2 * length * (Mxy * c + Myy * s)
        hx = length * Mnx - mass * com * s
        hy = length * Mny + mass * com * c
        J = length * length * (c * Mny - s * Mnx) + model.link_inertia[k] + mass * com * com
        moment = length * (c * py - s * px) + torque
        Mxx += mass
        Myy += mass
        px -= mass * com * w2 * c
        py -= mass * com * w2 * s
        # Joint equation: alpha = alpha0 + (y.lam - h.a) / J.
        torque = tau[N_BASE + k]
        J_inv = 1.0 / J
        alpha0 = (torque - moment) * J_inv
        yx, yy = length * (Xxy * c - Xxx * s), length * (Xyy * c - Xyx * s)
        bx += yx * alpha0 - w2 * length * (Xxx * c + Xxy * s)
        by += yy * alpha0 - w2 * length * (Xyx * c + Xyy * s)
        Lxx += yx * yx * J_inv
        Lxy += yx * yy * J_inv
        Lyy += yy * yy * J_inv
        gx, gy = hx * J_inv, hy * J_inv
        Xxx -= yx * gx
        Xxy -= yx * gy
        Xyx -= yy * gx
        Xyy -= yy * gy
        Mxx -= hx * gx
        Mxy -= hx * gy
        Myy -= hy * gy
        px += hx * alpha0
        py += hy * alpha0
        joint = work.joint[k]
        joint[0], joint[1], joint[2], joint[3], joint[4], joint[5] = hx, hy, J_inv, alpha0, yx, yy
    tip = work.tip[arm]
    tip[0], tip[1], tip[2], tip[3] = Xxx, Xxy, Xyx, Xyy
    tip[4], tip[5], tip[6], tip[7], tip[8] = Lxx, Lxy, Lyy, bx, by
    return Mxx, Mxy, Myy, px, py, torque


@kernel(inline=True)
def expand(model, arm, ax, ay, alpha_base, lamx, lamy, bias, work, out):
    """Run outward from the mount's acceleration and write the joint accelerations of one arm into ``out``.

    ax, ay: acceleration of the mount, base axes [m/s2]; alpha_base: of the base's yaw [rad/s2].
    lamx, lamy: grasp force on the tip, base axes [N].
    bias: 1 for the accelerations, 0 for the linear response to forces alone.
    """
    before = alpha_base
    for k in range(model.arm_first[arm], model.arm_first[arm + 1]):
        joint = work.joint[k]
        alpha = bias * joint[3] + joint[2] * (joint[4] * lamx + joint[5] * lamy - joint[0] * ax - joint[1] * ay)
        out[N_BASE + k] = alpha - before
        before = alpha
        length, w2 = model.link_length[k], bias * work.rate[k] * work.rate[k]
        ax -= length * (alpha * work.s[k] + w2 * work.c[k])
        ay += length * (alpha * work.c[k] - w2 * work.s[k])


@kernel(inline=True)
def tip_motion(model, arm, yaw_rate, work):
    """Position and velocity of an arm's tip relative to the base's centre of mass, base axes.

    Returns ``x, y`` [m] and ``xd, yd`` [m/s]; the velocity is the inertial one less that of the centre of mass.
    """
    x, y = model.arm_mount[arm, 0], model.arm_mount[arm, 1]
    xd, yd = -yaw_rate * y, yaw_rate * x
    for k in range(model.arm_first[arm], model.arm_first[arm + 1]):
        dx, dy = model.link_length[k] * work.c[k], model.link_length[k] * work.s[k]
        x += dx
        y += dy
        xd -= work.rate[k] * dy
        yd += work.rate[k] * dx
    return x, y, xd, yd
