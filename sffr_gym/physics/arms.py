"""Rigid arms (Eqs. 40-43): an articulated-body recursion in base axes, arm by arm, linear in the number of links.

With each link's absolute angular acceleration ``alpha`` as coordinate, a planar revolute joint passes a force and its
own torque only, so that eliminating a link leaves a 2 x 2 apparent mass at its joint. For an arm that grasps the object
the same pass carries the tip's acceleration as a function of the first joint's acceleration ``a`` and the grasp force
``lam``, the Popov-Vereshchagin scheme::

    joint force   f     = M a + p - X' lam
    tip           a_tip = X a + Lam lam + b
"""

from __future__ import annotations

from typing import NamedTuple

from sffr_gym.compile.angles import Anchor, anchor_shapes, cos_sin_near
from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.workspace import Interleaved
from sffr_gym.physics.model import N_BASE
from sffr_gym.types import Array


class Links(NamedTuple):
    """Links of all arms, base axes; the joint equation is ``alpha = alpha0 + (y.lam - h.a) / J``."""

    c: Array  #: (n_l,) cosine and sine of each link's direction
    s: Array  #: (n_l,)
    rate: Array  #: (n_l,) absolute angular velocity [rad/s]
    h_x: Array  #: (n_l,) [kg m] coupling of the joint's acceleration
    h_y: Array  #: (n_l,)
    J_inv: Array  #: (n_l,) [1/(kg m2)] inverse of the apparent inertia about the joint
    alpha0: Array  #: (n_l,) [rad/s2] acceleration of a joint at rest without grasp force
    y_x: Array  #: (n_l,) [m] coupling of the grasp force
    y_y: Array  #: (n_l,)
    anchor: Anchor  #: directions at the start of a step


class Tips(NamedTuple):
    """The map of each arm's tip (n_a,): ``a_tip = X a + Lam lam + b``, base axes."""

    X_xx: Array  #: [-]
    X_xy: Array
    X_yx: Array
    X_yy: Array
    Lam_xx: Array  #: [1/kg]
    Lam_xy: Array
    Lam_yy: Array
    b_x: Array  #: [m/s2]
    b_y: Array


def link_shapes(n):
    """Shapes of :class:`Links` for ``n`` links."""
    return Interleaved(Links(
        c=(n,), s=(n,), rate=(n,), h_x=(n,), h_y=(n,), J_inv=(n,), alpha0=(n,), y_x=(n,), y_y=(n,),
        anchor=anchor_shapes(n),
    ))  # fmt: skip


def tip_shapes(n):
    """Shapes of :class:`Tips` for ``n`` arms."""
    return Interleaved(Tips((n,), (n,), (n,), (n,), (n,), (n,), (n,), (n,), (n,)))


@kernel
def link_directions(model, p, v, links, refresh):
    """Fill the direction of each link in base axes and its absolute angular velocity.

    p, v: (n,) positions and velocities; links: :class:`Links`.
    refresh: compute them alone, instead of from those of the last refresh; see :mod:`sffr_gym.compile.angles`.
    """
    for arm in range(len(model.arm_angle)):
        angle, rate = model.arm_angle[arm], v[2]
        for k in range(model.arm_first[arm], model.arm_first[arm + 1]):
            angle += p[N_BASE + k]
            rate += v[N_BASE + k]
            links.c[k], links.s[k] = cos_sin_near(links.anchor, k, angle, refresh)
            links.rate[k] = rate


@kernel
def articulate(model, arm, tau, links, tips):
    """Eliminate the links of one arm from its tip to its mount.

    tau: (n,) generalised forces; those of the arm's joints are used [N m].
    links: :class:`Links`, whose joint equations :func:`expand` needs are filled; tips: :class:`Tips`, the arm's filled.

    Returns ``(Mxx, Mxy, Myy, px, py, torque)``: apparent mass [kg] and bias [N] at the first joint, and the torque
    [N m] whose reaction the base feels.
    """
    Mxx = Mxy = Myy = px = py = torque = 0.0
    Xxx = Xyy = 1.0
    Xxy = Xyx = 0.0
    Lxx = Lxy = Lyy = bx = by = 0.0
    first = model.arm_first[arm]
    for k in range(model.arm_first[arm + 1] - 1, first - 1, -1):
        c, s, w2 = links.c[k], links.s[k], links.rate[k] * links.rate[k]
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
        links.h_x[k], links.h_y[k], links.J_inv[k], links.alpha0[k] = hx, hy, J_inv, alpha0
        links.y_x[k], links.y_y[k] = yx, yy
    tips.X_xx[arm], tips.X_xy[arm], tips.X_yx[arm], tips.X_yy[arm] = Xxx, Xxy, Xyx, Xyy
    tips.Lam_xx[arm], tips.Lam_xy[arm], tips.Lam_yy[arm] = Lxx, Lxy, Lyy
    tips.b_x[arm], tips.b_y[arm] = bx, by
    return Mxx, Mxy, Myy, px, py, torque


@kernel
def expand(model, arm, ax, ay, alpha_base, lamx, lamy, full, links, out):
    """Run outward from the mount's acceleration and write the joint accelerations of one arm into ``out``.

    ax, ay: acceleration of the mount, base axes [m/s2]; alpha_base: of the base's yaw [rad/s2].
    lamx, lamy: grasp force on the tip, base axes [N].
    full: the accelerations; else the linear response to forces alone.
    links: :class:`Links` after :func:`articulate`; out: (n,) accelerations.
    """
    before = alpha_base
    for k in range(model.arm_first[arm], model.arm_first[arm + 1]):
        forced = links.y_x[k] * lamx + links.y_y[k] * lamy - links.h_x[k] * ax - links.h_y[k] * ay
        alpha = links.J_inv[k] * forced
        w2 = 0.0
        if full:
            alpha = links.alpha0[k] + alpha
            w2 = links.rate[k] * links.rate[k]
        out[N_BASE + k] = alpha - before
        before = alpha
        length = model.link_length[k]
        ax -= length * (alpha * links.s[k] + w2 * links.c[k])
        ay += length * (alpha * links.c[k] - w2 * links.s[k])


@kernel
def tip_motion(model, arm, yaw_rate, links):
    """Position and velocity of an arm's tip relative to the base's centre of mass, base axes.

    yaw_rate: of the base [rad/s]; links: :class:`Links` after :func:`link_directions`.

    Returns ``x, y`` [m] and ``xd, yd`` [m/s]; the velocity is the inertial one less that of the centre of mass.
    """
    x, y = model.arm_mount[arm, 0], model.arm_mount[arm, 1]
    xd, yd = -yaw_rate * y, yaw_rate * x
    for k in range(model.arm_first[arm], model.arm_first[arm + 1]):
        dx, dy = model.link_length[k] * links.c[k], model.link_length[k] * links.s[k]
        x += dx
        y += dy
        xd -= links.rate[k] * dy
        yd += links.rate[k] * dx
    return x, y, xd, yd
