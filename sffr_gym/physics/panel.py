"""A flexible panel (Eqs. 44-48) in its clamped modes: floating frame, exact inertial coupling.

In modal amplitudes ``m_ff`` is the identity and ``K_ff`` diagonal, so the elastic equations solve themselves. With the
axial amplitudes ``a``, the bending ones ``b``, the root's acceleration ``(ax, ay)`` in panel axes and ``alpha`` of its
angle, the corrected Eqs. 45 and 48 read::

    add = f_a - S_x ax + alpha G'b          f_a = tau - w2 (a + eta ad) + w^2 (c_x + a) + 2 w G'bd
    bdd = f_b - S_y ay - alpha (c_y + G a)  f_b = tau - w2 (b + eta bd) + w^2 b - 2 w G ad

and the root feels the condensed inertia of the second row of Eq. 2, which :func:`condense` returns.
"""

from __future__ import annotations

from typing import NamedTuple

from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.workspace import Interleaved
from sffr_gym.physics.foreshortening import Bent, bent_shapes, condense_bent
from sffr_gym.physics.model import first_mode
from sffr_gym.types import Array


class Roots(NamedTuple):
    """What the base feels of each panel, in the panel's own axes, about its root.

    It exerts the force ``M a + h alpha + p`` and the moment ``h.a + J alpha + moment``.
    """

    M_xx: Array  #: (n_p,) apparent masses [kg]
    M_xy: Array  #: (n_p,) 0 of a linear panel
    M_yy: Array  #: (n_p,)
    h_x: Array  #: (n_p,) coupling of translation and rotation [kg m]
    h_y: Array  #: (n_p,)
    J: Array  #: (n_p,) apparent inertia [kg m2]
    p_x: Array  #: (n_p,) force [N] and moment [N m] at rest
    p_y: Array  #: (n_p,)
    moment: Array  #: (n_p,)


class Panels(NamedTuple):
    """Panels with their elastic accelerations eliminated."""

    f: Array  #: (n_p, n_m) modal forces [kg^(1/2) m/s2]
    turn: Array  #: (n_p, n_m) rotation coupling of each mode [kg^(1/2) m]
    along: Array  #: (n_p, n_m) acceleration of each mode for one of the root along a foreshortened panel, and across it
    across: Array  #: (n_p, n_m)
    bent: Bent  #: memory of a foreshortened panel
    root: Roots


def panel_shapes(model):
    """Shapes of the :class:`Panels` of a robot."""
    n_p, n_m = model.omega2.shape
    n_slow = model.foreshortening.tip.shape[1]  # there is room for these where a panel has fewer
    n_m = max(n_m, n_slow)
    n_b = n_m if n_slow else 0
    roots = Roots((n_p,), (n_p,), (n_p,), (n_p,), (n_p,), (n_p,), (n_p,), (n_p,), (n_p,))
    return Panels(
        f=(n_p, n_m), turn=(n_p, n_m), along=(n_p, n_b), across=(n_p, n_b), bent=bent_shapes(model),
        root=Interleaved(roots),
    )  # fmt: skip


@kernel
def condense(model, i, p, v, tau, yaw_rate, panels):
    """Eliminate the elastic accelerations of panel ``i`` into ``panels`` (the RFIM's second row).

    p, v, tau: (n,) positions, velocities and generalised forces; yaw_rate: angular velocity of the root [rad/s].
    panels: :class:`Panels`, whose row ``i`` is written.
    """
    if model.foreshortening.tip.shape[1] > 0:
        condense_bent(model, i, p, v, tau, yaw_rate, panels)
        return
    n_a, n_m, start = model.n_axial, model.omega2.shape[1], first_mode(model, i)
    w, w2 = yaw_rate, yaw_rate * yaw_rate
    mass, first, second = model.panel_mass[i], model.panel_first_moment[i], model.panel_second_moment[i]
    omega2, damping, gyro = model.omega2[i], model.damping[i], model.gyro[i]
    translation, rotation = model.translation[i], model.rotation[i]
    f, turn = panels.f[i], panels.turn[i]

    Mxx = Myy = mass
    first_x, first_y, first_xd, first_yd = first, 0.0, 0.0, 0.0
    J, coriolis = second, 0.0
    hx = hy = px = py = moment = 0.0
    for j in range(n_m):
        a, ad = p[start + j], v[start + j]
        f[j] = tau[start + j] - omega2[j] * a - damping[j] * ad + w2 * a
        J += a * a
        coriolis += a * ad
        if j < n_a:  # rotation column of m_fr: -G'b for axial modes, c_y + G a for bending modes
            f[j] += w2 * rotation[j]
            turn[j] = 0.0
            first_x += translation[j] * a
            first_xd += translation[j] * ad
            J += 2.0 * rotation[j] * a
            coriolis += rotation[j] * ad
        else:
            turn[j] = rotation[j]
            first_y += translation[j] * a
            first_yd += translation[j] * ad
    for j in range(n_a, n_m):
        for k in range(n_a):
            g = gyro[j - n_a, k]
            turn[k] -= g * p[start + j]
            turn[j] += g * p[start + k]
            f[k] += 2.0 * w * g * v[start + j]
            f[j] -= 2.0 * w * g * v[start + k]
    for j in range(n_m):
        J -= turn[j] * turn[j]
        moment += turn[j] * f[j]
        if j < n_a:
            Mxx -= translation[j] * translation[j]
            hx -= translation[j] * turn[j]
            px += translation[j] * f[j]
        else:
            Myy -= translation[j] * translation[j]
            hy -= translation[j] * turn[j]
            py += translation[j] * f[j]
    hx -= first_y
    hy += first_x
    px -= w2 * first_x + 2.0 * w * first_yd
    py += 2.0 * w * first_xd - w2 * first_y
    moment += 2.0 * w * coriolis
    root = panels.root
    root.M_xx[i], root.M_xy[i], root.M_yy[i], root.h_x[i], root.h_y[i], root.J[i] = Mxx, 0.0, Myy, hx, hy, J
    root.p_x[i], root.p_y[i], root.moment[i] = px, py, moment


@kernel
def expand(model, i, ax, ay, alpha, full, panels, out):
    """Write the modal accelerations of panel ``i`` into ``out`` (n,).

    ax, ay, alpha: acceleration of the root, panel axes [m/s2], and angular acceleration [rad/s2].
    full: the accelerations; else the linear response to a change of the root's acceleration alone.
    panels: :class:`Panels` after :func:`condense`.
    """
    f, turn, translation, start = panels.f[i], panels.turn[i], model.translation[i], first_mode(model, i)
    if model.foreshortening.tip.shape[1] > 0:
        for j in range(model.omega2.shape[1]):
            force = f[j] if full else 0.0
            out[start + j] = force + panels.along[i, j] * ax - panels.across[i, j] * ay - turn[j] * alpha
        return
    for j in range(model.omega2.shape[1]):
        root = ax if j < model.n_axial else ay
        force = f[j] if full else 0.0
        out[start + j] = force - translation[j] * root - turn[j] * alpha
