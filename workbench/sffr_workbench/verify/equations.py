"""Checks of the paper's panel equations: each printed one against the derived one, each misprint proved.

Eqs. 44, 45, 47, 48 and 52; then our own arrays of them, ``physics.monolithic.panel_equations``, at random states.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import sympy as sp

from sffr_gym.config.params import load_params
from sffr_gym.physics import monolithic
from sffr_gym.physics.beam import N_TIP, beam, shape_functions
from sffr_workbench.verify.check import Check, make_check
from sffr_workbench.verify.panel_symbols import assembled, clamped, vanishes

F = sp.Rational
COUNT = "entries"  # unit: how many entries disagree


def checks(quick: bool) -> list[partial[Check]]:
    """List the checks of this module."""
    listed = map(partial, (mass_matrix, stiffness, velocity_vector, base_force, shape_derivatives))
    return [*listed, partial(arrays, states=20 if quick else 200)]


def mass_matrix() -> Check:
    """Prove that Eq. 45, with row 2 corrected, is the Hessian of the kinetic energy, and not as printed."""
    p = clamped()
    _, L, m, _, _ = p.numbers
    _, _, delta, q4, q5, q6 = p.q
    S, C = sp.sin(delta), sp.cos(delta)
    inertia = (
        L**2 / 3 + F(2, 3) * L * q4 + q4**2 / 3 + F(13, 35) * q5**2 + L**2 / 105 * q6**2 - F(11, 105) * L * q5 * q6
    )
    upper = [
        [m, 0, -m / 12 * (6 * (L + q4) * S + (6 * q5 - L * q6) * C), m / 2 * C, -m / 2 * S, m * L / 12 * S],
        [m, m / 12 * (6 * (L + q4) * C - (6 * q5 - L * q6) * S), m / 2 * S, m / 2 * C, -m * L / 12 * C],
        [m * inertia, m / 20 * (-7 * q5 + L * q6), m / 20 * (7 * L + 7 * q4), -m / 20 * (L**2 + L * q4)],
        [m / 3, 0, 0],
        [F(13, 35) * m, -F(11, 210) * m * L],
        [m * L**2 / 105],
    ]
    wrong = 0
    for i, row in enumerate(upper):
        for j, entry in enumerate(row, start=i):
            wrong += not (vanishes(p.M[i, j] - entry) and vanishes(p.M[j, i] - entry))
    printed = [m * L / 12 * C, -m * L / 12 * S]  # the row's last two entries: one too many, and neither is right
    wrong += _count_right(p.M[1, 5], printed)
    return make_check(
        "Eq. 45, mass matrix of a panel", "SymPy: Hessian of the kinetic energy", wrong, 0.0, COUNT,
        "Misprint proved: row 2 has one entry too many; its last is -(m L/12) cos(delta), and neither printed one is.",
    )  # fmt: skip


def stiffness() -> Check:
    """Prove that Eq. 47 is the Hessian of the strain energy."""
    p = clamped()
    _, L, _, EA, EI = p.numbers
    K = sp.diag(sp.zeros(3), EA / L, sp.Matrix([[12 * EI / L**3, -6 * EI / L**2], [-6 * EI / L**2, 4 * EI / L]]))
    wrong = sum(not vanishes(entry) for entry in p.K - K)
    return make_check(
        "Eq. 47, stiffness of a panel", "SymPy: Hessian of the strain energy", wrong, 0.0, COUNT, "Right as printed."
    )


def velocity_vector() -> Check:
    """Prove that Eq. 48, rows 3 and 4 corrected and the squares read as those of the rate, follows from Lagrange."""
    p = clamped()
    _, L, m, _, _ = p.numbers
    _, _, delta, q4, q5, q6 = p.q
    rate, v4, v5, v6 = p.qd[2:]
    S, C = sp.sin(delta), sp.cos(delta)
    a, b = 6 * (L + q4), 6 * q5 - L * q6
    va, vb = 6 * v4, 6 * v5 - L * v6
    rest = q4 * v4 / 3 + F(13, 35) * v5 * q5 - F(11, 210) * L * (v6 * q5 + v5 * q6) + L**2 / 105 * v6 * q6

    def rows(square: sp.Expr, third: sp.Expr, fourth: sp.Expr) -> list[sp.Expr]:
        return [
            m * square / 12 * (a * C - b * S) + m * rate / 6 * (va * S + vb * C),
            m * square / 12 * (a * S + b * C) + m * rate / 6 * (-va * C + vb * S),
            -2 * m * rate * (third * v4 + rest),
            m * square * (fourth + q4 / 3) + 2 * m * rate * (F(7, 20) * v5 - L / 20 * v6),
            m * square * (F(13, 35) * q5 - F(11, 210) * L * q6) - 2 * m * rate * F(7, 20) * v4,
            m * square * (L**2 / 105 * q6 - F(11, 210) * L * q5) + 2 * m * rate * L / 20 * v4,
        ]

    wrong = sum(not vanishes(p.Q_v[i] - entry) for i, entry in enumerate(rows(rate**2, L / 3, L / 3)))
    printed = rows(rate**2, F(1, 3), F(1, 3))
    wrong += sum(_count_right(p.Q_v[i], [printed[i]]) for i in (2, 3))
    angle = rows(delta**2, L / 3, L / 3)
    wrong += sum(_count_right(p.Q_v[i], [angle[i]]) for i in (0, 1, 3, 4, 5))
    return make_check(
        "Eq. 48, quadratic velocity vector", "SymPy: equations of Lagrange", wrong, 0.0, COUNT,
        "Misprints proved: L/3 for 1/3 in rows 3 and 4; delta_0^2 is the square of the rate, not of the angle.",
    )  # fmt: skip


def base_force() -> Check:
    """Prove that Eq. 52 is -J_f' Q_e, with V and M those of the base on the panels, but for the sign of M."""
    V, M = sp.symbols("V1L V2L V1R V2R", real=True), sp.symbols("ML MR", real=True)
    beta, l = sp.symbols("beta l", real=True)
    places = [(-l * sp.cos(sp.pi / 3), l * sp.sin(sp.pi / 3)), (-l * sp.cos(sp.pi / 3), -l * sp.sin(sp.pi / 3))]
    angles = [sp.pi / 2, -sp.pi / 2]
    x, y = sp.symbols("x y", real=True)
    Q = sp.zeros(3, 1)
    for i in range(2):
        root = sp.Matrix([x, y]) + _rotation(beta) * sp.Matrix(places[i])
        J_f = sp.Matrix([*root, beta + angles[i]]).jacobian([x, y, beta])  # Eq. 49, rates of the root's pose
        force = _rotation(beta + angles[i]) * sp.Matrix(V[2 * i : 2 * i + 2])  # inertial, as Eq. 45 has it
        Q -= J_f.T * sp.Matrix([*force, M[i]])
    derived = sp.diag(_rotation(beta).T, 1) * Q  # along the base axes
    V1L, V2L, V1R, V2R = V
    levers = -(V2L + V2R) * l * sp.sin(sp.pi / 3) + (V1L - V1R) * l * sp.cos(sp.pi / 3)
    mended = [V2L - V2R, V1R - V1L, -(M[0] + M[1]) + levers]
    wrong = sum(not vanishes(derived[i] - entry) for i, entry in enumerate(mended))
    wrong += _count_right(derived[2], [M[0] + M[1] + levers])
    return make_check(
        "Eq. 52, force of the panels on the base", "SymPy: -J_f' Q_e of Eqs. 4 and 49", wrong, 0.0, COUNT,
        "Forces along the base axes from root forces in the panels' axes. Misprint proved: with V the forces of the "
        "base on the panels, as the first two rows and the levers have them, the moments enter as -(M_R + M_L).",
    )  # fmt: skip


def arrays(states: int, seed: int = 0) -> Check:
    """Check our panel equations for 1, 2, 3 and 5 elements against the derived element, summed."""
    panel, rng, worst = load_params().panel, np.random.default_rng(seed), 0.0
    numbers = (panel.mass, panel.length, panel.E * panel.area, panel.EI)
    for elements in (1, 2, 3, 5):
        shape = beam(panel.mass, panel.length, panel.EI, panel.E * panel.area, elements)
        for _ in range(states):
            qf, qfd = rng.uniform(-1.0, 1.0, (2, N_TIP * elements))
            delta, delta_d = rng.uniform(-3.0, 3.0, 2)
            ours = monolithic.panel_equations(shape, delta, delta_d, qf, qfd)
            M, K, Q_v = assembled(numbers, elements, delta, delta_d, qf, qfd)
            blocks = [(ours.m_rr, M[:3, :3]), (ours.m_rf, M[:3, 3:]), (ours.m_ff, M[3:, 3:])]
            blocks += [(ours.Q_vr, Q_v[:3]), (ours.Q_vf, Q_v[3:]), (shape.K, K[3:, 3:])]
            worst = max(worst, *(np.abs(a - b).max() / np.abs(b).max() for a, b in blocks))
    return make_check(
        "Eqs. 45, 47, 48 as computed, 1 to 5 elements", "SymPy's element, summed, at random states", worst, 1.0e-12, "",
        f"{states} states each; relative to the largest entry of each block. Rounding alone.",
    )  # fmt: skip


def shape_derivatives() -> Check:
    """Check the derivatives of Eq. 44 as computed, which strain and the piezo patches need, by complex steps."""
    tiny, length, worst = 1.0e-30, 0.7, 0.0
    for xi in np.linspace(0.0, 1.0, 11):
        dU, dW, d2W = shape_functions(xi, length)[2:]
        stepped = shape_functions(xi + 1j * tiny, length)  # polynomials
        U_x, W_x, _, W_xx, _ = (each.imag / tiny / length for each in stepped)
        worst = max(worst, *(np.abs(a - b).max() for a, b in ((dU, U_x), (dW, W_x), (d2W, W_xx))))
    return make_check(
        "Eq. 44, dU/dx, dW/dx and d2W/dx2 as computed", "complex steps of U, W and dW/dx", worst, 1.0e-12, "",
        f"Eleven places of an element of {length:g} m. Rounding alone.",
    )  # fmt: skip


def _count_right(derived: sp.Expr, printed: Sequence[sp.Expr]) -> int:
    """Count the entries that are called misprints and are right after all."""
    return sum(vanishes(derived - entry) for entry in printed)


def _rotation(angle: sp.Expr) -> sp.Matrix:
    return sp.Matrix([[sp.cos(angle), -sp.sin(angle)], [sp.sin(angle), sp.cos(angle)]])
