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

from sffr_gym.compile.angles import Anchor, anchor_shapes, cos_sin_near
from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.linalg import assign, symmetric_inverse, times
from sffr_gym.physics import arms, panel
from sffr_gym.physics.arms import Links, Tips, link_shapes, tip_shapes
from sffr_gym.physics.grasp import Grasps, couple_object, grasp_shapes, solve_object
from sffr_gym.physics.model import first_mode
from sffr_gym.physics.panel import Panels, panel_shapes
from sffr_gym.types import Array


class Yaw(NamedTuple):
    """The base's direction."""

    cos: Array  #: (1,) of the yaw
    sin: Array  #: (1,)
    anchor: Anchor  #: the yaw at the start of a step


class Work(NamedTuple):
    """Memory of one evaluation; what a function leaves here the next one reads. One for each thread."""

    yaw: Yaw  #: direction of the base
    links: Links  #: of all arms
    tips: Tips
    panels: Panels  #: condensed into their roots
    grasps: Grasps  #: the object and the forces on it
    inverse: Array  #: (3, 3) inverse of the base's system
    load: Array  #: (3,) its right-hand side, base axes [N, N, N m]
    acceleration: Array  #: (3,) the base's, base axes [m/s2, m/s2, rad/s2]
    held: Array  #: (3,) Q_flex of the start of a step, inertial axes, under the staggered coupling [N, N, N m]


class Internal(NamedTuple):
    """Internal forces of the robot."""

    q_flex: Array  #: (3,) wrench of the panels on the base, inertial axes [N, N, N m]
    lam_x: Array  #: (n_g,) force of the object on each gripper, base axes [N]
    lam_y: Array  #: (n_g,)


def internal_shapes(model):
    """Shapes of the :class:`Internal` forces of a robot."""
    n_g = len(model.grasp_arm)
    return Internal(q_flex=(3,), lam_x=(n_g,), lam_y=(n_g,))


def work_shapes(model):
    """Shapes of the :class:`Work` of a robot."""
    return Work(
        yaw=Yaw(cos=(1,), sin=(1,), anchor=anchor_shapes(1)),
        links=link_shapes(len(model.link_mass)),
        tips=tip_shapes(len(model.arm_angle)),
        panels=panel_shapes(model),
        grasps=grasp_shapes(len(model.grasp_arm)),
        inverse=(3, 3),
        load=(3,),
        acceleration=(3,),
        held=(3,),
    )


@kernel(inline=False)  # the larger part of all code, called from ten places
def accelerations(model, p, v, tau, work, out, held, refresh):
    """Solve the equations of motion.

    p, v: (n,) positions and velocities; see :mod:`sffr_gym.physics.model`.
    tau: (n,) base wrench (base axes), joint torques, the piezos' modal forces, wrench on the object (inertial axes).
    work: :class:`Work`; out: (n,) accelerations, written.
    held: the base feels ``work.held`` instead of the panels' present reaction, as in Fig. 1.
    refresh: the state is not near that of the last refresh, a step of the integrator away at most.

    Source: Eqs. 2-4 and 40 with the elastic accelerations eliminated, Eq. 8 with the grasp forces solved from the pins,
    whose errors decay at ``model.baumgarte``.
    """
    directions(model, p, v, work, refresh)
    cb, sb = work.yaw.cos[0], work.yaw.sin[0]
    H, bias = _base_inertia(model, p, v, tau, work, held)
    if model.at.object < model.at.end:
        H, bias = couple_object(model, p, v, tau, cb, sb, work.links, work.tips, work.grasps, H, bias, refresh)
    symmetric_inverse(H, work.inverse)
    work.load[0], work.load[1], work.load[2] = tau[0] - bias[0], tau[1] - bias[1], tau[2] - bias[2]
    _solve(model, work, True)
    _distribute(model, v, work, True, out)


@kernel
def directions(model, p, v, work, refresh):
    """Fill the directions of base and links, and the links' angular velocities, in ``work``.

    p, v, refresh: as in :func:`accelerations`.
    """
    work.yaw.cos[0], work.yaw.sin[0] = cos_sin_near(work.yaw.anchor, 0, p[2], refresh)
    arms.link_directions(model, p, v, work.links, refresh)


@kernel
def stiff_response(model, v, panel_index, mode, work, out):
    """Accelerations (n,) that a unit force on one clamped mode causes; call after :func:`accelerations` there.

    Source: a column of the inverse of the condensed mass matrix; under the staggered coupling the mode answers by
    itself.
    """
    at = first_mode(model, panel_index) + mode
    if model.staggered > 0:
        out[:] = 0.0
        out[at] = 1.0
        return
    force, turn = model.translation[panel_index, mode], work.panels.turn[panel_index, mode]
    c, s = model.panel_axis[panel_index, 0], model.panel_axis[panel_index, 1]
    if mode < model.n_axial:
        fx, fy = c * force, s * force
    else:
        fx, fy = -s * force, c * force
    x, y = model.panel_root[panel_index, 0], model.panel_root[panel_index, 1]
    work.load[0], work.load[1], work.load[2] = -fx, -fy, -(x * fy - y * fx + turn)
    _solve(model, work, False)
    _distribute(model, v, work, False, out)
    out[at] += 1.0


@kernel
def flexible_wrench(model, v, work):
    """Q_flex of Eqs. 4 and 53: force (inertial axes) [N] and moment about the base's centre of mass [N m].

    Call after :func:`accelerations` at the same state, whose velocities (n,) are ``v``.
    """
    root = work.panels.root
    ax, ay, alpha = work.acceleration[0], work.acceleration[1], work.acceleration[2]
    fx = fy = moment = 0.0
    for i in range(model.omega2.shape[0]):
        c, s = model.panel_axis[i, 0], model.panel_axis[i, 1]
        rx, ry = _root_acceleration(model, i, ax, ay, alpha, v[2] * v[2])
        hx, hy = root.h_x[i], root.h_y[i]
        gx = root.M_xx[i] * rx + root.M_xy[i] * ry + hx * alpha + root.p_x[i]
        gy = root.M_yy[i] * ry + root.M_xy[i] * rx + hy * alpha + root.p_y[i]
        bx, by = c * gx - s * gy, s * gx + c * gy
        fx -= bx
        fy -= by
        x, y = model.panel_root[i, 0], model.panel_root[i, 1]
        moment -= x * by - y * bx + hx * rx + hy * ry + root.J[i] * alpha + root.moment[i]
    cb, sb = work.yaw.cos[0], work.yaw.sin[0]
    return cb * fx - sb * fy, sb * fx + cb * fy, moment


@kernel
def keep_forces(model, v, work, forces):
    """Keep the internal forces of this evaluation, which the next one overwrites; arguments as before.

    Under the staggered coupling the base feels this Q_flex until the step ends. forces: :class:`Internal`, written.
    """
    forces.q_flex[0], forces.q_flex[1], forces.q_flex[2] = flexible_wrench(model, v, work)
    assign(work.held, forces.q_flex)
    assign(forces.lam_x, work.grasps.pins.lam_x)
    assign(forces.lam_y, work.grasps.pins.lam_y)


@kernel
def _base_inertia(model, p, v, tau, work, held):
    """Inertia and bias of the base with all arms and panels eliminated into it, or the arms and ``work.held``.

    Returns ``(Hxx, Hxy, Hxz, Hyy, Hyz, Hzz)`` and ``(px, py, pz)`` over base acceleration (base axes) and yaw.
    """
    panels, w2 = work.panels, v[2] * v[2]
    H, bias = (model.base_mass, 0.0, 0.0, model.base_mass, 0.0, model.base_inertia), (0.0, 0.0, 0.0)
    for arm in range(len(model.arm_angle)):
        Mxx, Mxy, Myy, qx, qy, torque = arms.articulate(model, arm, tau, work.links, work.tips)
        inertia = (Mxx, Mxy, 0.0, Myy, 0.0, 0.0)
        H, bias = _attach(H, bias, model.arm_mount[arm, 0], model.arm_mount[arm, 1], w2, inertia, (qx, qy, torque))
    for i in range(model.omega2.shape[0]):
        panel.condense(model, i, p, v, tau, v[2], panels)
    if held:
        cb, sb, fx, fy = work.yaw.cos[0], work.yaw.sin[0], work.held[0], work.held[1]
        return H, (bias[0] - cb * fx - sb * fy, bias[1] + sb * fx - cb * fy, bias[2] - work.held[2])
    root = panels.root
    for i in range(model.omega2.shape[0]):
        Mx, Mxy, My, hx, hy, J = root.M_xx[i], root.M_xy[i], root.M_yy[i], root.h_x[i], root.h_y[i], root.J[i]
        qx, qy, torque = root.p_x[i], root.p_y[i], root.moment[i]
        c, s = model.panel_axis[i, 0], model.panel_axis[i, 1]
        inertia = (
            c * c * Mx + s * s * My - 2.0 * c * s * Mxy, c * s * (Mx - My) + (c * c - s * s) * Mxy, c * hx - s * hy,
            s * s * Mx + c * c * My + 2.0 * c * s * Mxy, s * hx + c * hy, J,
        )  # fmt: skip
        load = (c * qx - s * qy, s * qx + c * qy, torque)
        H, bias = _attach(H, bias, model.panel_root[i, 0], model.panel_root[i, 1], w2, inertia, load)
    return H, bias


@kernel
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


@kernel
def _solve(model, work, full):
    """Solve base, object and grasps for ``work.load``.

    full: the accelerations; else the linear response to that load alone.
    """
    load, acceleration = work.load, work.acceleration
    acceleration[0], acceleration[1], acceleration[2] = times(work.inverse, load[0], load[1], load[2])
    if model.at.object < model.at.end:
        solve_object(model, acceleration[0], acceleration[1], acceleration[2], full, work.grasps)


@kernel
def _distribute(model, v, work, full, out):
    """Run outward from base and object and write every acceleration (n,), inertial axes; ``full`` as in ``_solve``."""
    cb, sb = work.yaw.cos[0], work.yaw.sin[0]
    ax, ay, alpha = work.acceleration[0], work.acceleration[1], work.acceleration[2]
    w2 = 0.0
    if full:
        w2 = v[2] * v[2]
    out[0], out[1], out[2] = cb * ax - sb * ay, sb * ax + cb * ay, alpha
    for arm in range(len(model.arm_angle)):
        x, y = model.arm_mount[arm, 0], model.arm_mount[arm, 1]
        lamx = lamy = 0.0
        for g in range(len(model.grasp_arm)):
            if model.grasp_arm[g] == arm:
                lamx, lamy = work.grasps.pins.lam_x[g], work.grasps.pins.lam_y[g]
        arms.expand(
            model, arm, ax - alpha * y - w2 * x, ay + alpha * x - w2 * y, alpha, lamx, lamy, full, work.links, out
        )
    for i in range(model.omega2.shape[0]):
        rx, ry = _root_acceleration(model, i, ax, ay, alpha, w2)
        panel.expand(model, i, rx, ry, alpha, full, work.panels, out)
    if model.at.object < model.at.end:
        at, acceleration = model.at.object, work.grasps.acceleration
        out[at] = cb * acceleration[0] - sb * acceleration[1]
        out[at + 1] = sb * acceleration[0] + cb * acceleration[1]
        out[at + 2] = acceleration[2]


@kernel
def _root_acceleration(model, i, ax, ay, alpha, w2):
    """Acceleration of a panel's root in panel axes (Eq. 49 differentiated twice)."""
    c, s = model.panel_axis[i, 0], model.panel_axis[i, 1]
    x, y = model.panel_root[i, 0], model.panel_root[i, 1]
    rx, ry = ax - alpha * y - w2 * x, ay + alpha * x - w2 * y
    return c * rx + s * ry, c * ry - s * rx
