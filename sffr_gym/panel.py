"""A flexible panel (Eqs. 44-48) in its clamped modes: floating frame, exact inertial coupling.

In modal amplitudes ``m_ff`` is the identity and ``K_ff`` diagonal, so the elastic equations solve themselves. With the
axial amplitudes ``a``, the bending ones ``b``, the root's acceleration ``(ax, ay)`` in panel axes and ``alpha`` of its
angle, the corrected Eqs. 45 and 48 read::

    add = f_a - S_x ax + alpha G'b          f_a = tau - w2 (a + eta ad) + w^2 (c_x + a) + 2 w G'bd
    bdd = f_b - S_y ay - alpha (c_y + G a)  f_b = tau - w2 (b + eta bd) + w^2 b - 2 w G ad

and the root feels the condensed inertia of the second row of Eq. 2, which :func:`condense` returns.
"""

from __future__ import annotations

from sffr_gym._jit import kernel


@kernel(inline=True)
def condense(model, i, p, v, tau, start, yaw_rate, work):
    """Eliminate the elastic accelerations of panel ``i`` (the RFIM's second row).

    start: index of the panel's first amplitude in ``p, v, tau``; yaw_rate: angular velocity of the root [rad/s].

    Returns ``(Mxx, Myy, hx, hy, J, px, py, moment)``, panel axes, about the root: force ``M a + h alpha + p`` and
    moment
    ``h.a + J alpha + moment`` that the base exerts on the panel. ``work.elastic`` keeps ``f`` and the rotation
    coupling.
    """
    n_a, n_m = model.n_axial, model.omega2.shape[1]
    w, w2 = yaw_rate, yaw_rate * yaw_rate
    mass, first, second = model.panel_inertia[i, 0], model.panel_inertia[i, 1], model.panel_inertia[i, 2]
    omega2, damping, gyro = model.omega2[i], model.damping[i], model.gyro[i]
    translation, rotation = model.translation[i], model.rotation[i]
    f, turn = work.elastic[i, 0], work.elastic[i, 1]

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
    return Mxx, Myy, hx, hy, J, px, py, moment


@kernel(inline=True)
def expand(model, i, ax, ay, alpha, start, bias, work, out):
    """Write the modal accelerations of panel ``i`` into ``out``, from its root's acceleration in panel axes.

    bias: 1 for the accelerations, 0 for the linear response to a change of the root's acceleration alone.
    """
    f, turn, translation = work.elastic[i, 0], work.elastic[i, 1], model.translation[i]
    for j in range(model.omega2.shape[1]):
        root = ax if j < model.n_axial else ay
        out[start + j] = bias * f[j] - translation[j] * root - turn[j] * alpha
