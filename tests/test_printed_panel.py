"""The paper's panel matrices (Eqs. 45, 47, 48), misprints included, against those derived from the energies."""

import sympy as sp
from lagrangian import floating_panel


def reduced(difference: sp.Expr, angle: sp.Symbol) -> sp.Expr:
    """A polynomial in the sine and cosine of one angle in its only form without squares of the sine.

    It is zero if and only if the difference is, and found in a tenth of the time that ``simplify`` takes.
    """
    S, C = sp.sin(angle), sp.cos(angle)
    powers = sp.Poly(sp.expand(difference), S, C).rem(sp.Poly(S**2 + C**2 - 1, S, C))
    return powers.as_expr()


class TestPrintedPanel:
    """The paper's panel matrices against those derived from the energies, in symbols."""

    def test_mass_matrix_is_eq_45_corrected(self) -> None:
        """Eq. 45, every entry, with one misprint."""
        p = floating_panel()
        m, L = p.m, p.L
        _, _, delta, q4, q5, q6 = p.q
        S, C = sp.sin(delta), sp.cos(delta)
        inertia = L**2 / 3 + sp.Rational(2, 3) * L * q4 + q4**2 / 3 + sp.Rational(13, 35) * q5**2
        inertia += L**2 / 105 * q6**2 - sp.Rational(11, 105) * L * q5 * q6
        upper = [
            [m, 0, -m / 12 * (6 * (L + q4) * S + (6 * q5 - L * q6) * C), m / 2 * C, -m / 2 * S, m * L / 12 * S],
            # Misprint: the printed row ends with (m L / 12) C and -(m L / 12) S; it is one entry, -(m L / 12) C.
            [m, m / 12 * (6 * (L + q4) * C - (6 * q5 - L * q6) * S), m / 2 * S, m / 2 * C, -m * L / 12 * C],
            [m * inertia, m / 20 * (-7 * q5 + L * q6), m / 20 * (7 * L + 7 * q4), -m / 20 * (L**2 + L * q4)],
            [m / 3, 0, 0],
            [sp.Rational(13, 35) * m, -sp.Rational(11, 210) * m * L],
            [m * L**2 / 105],
        ]
        for row, entries in enumerate(upper):
            for offset, entry in enumerate(entries):
                column = row + offset
                assert reduced(p.M[row, column] - entry, delta) == 0, (row, column)
                assert reduced(p.M[column, row] - entry, delta) == 0, (column, row)

    def test_stiffness_is_eq_47(self) -> None:
        """Eq. 47 as printed."""
        p = floating_panel()
        EA, EI, L = p.EA, p.EI, p.L
        K = sp.diag(sp.zeros(3), EA / L, sp.Matrix([[12 * EI / L**3, -6 * EI / L**2], [-6 * EI / L**2, 4 * EI / L]]))
        assert sp.simplify(p.K - K) == sp.zeros(6)

    def test_velocity_vector_is_eq_48_corrected(self) -> None:
        """Eq. 48 with two misprints; delta_0^2 is read as the square of the rate throughout."""
        p = floating_panel()
        m, L, rate_ = p.m, p.L, p.qd[2]
        _, _, delta, q4, q5, q6 = p.q
        v4, v5, v6 = p.qd[3:]
        S, C, F = sp.sin(delta), sp.cos(delta), sp.Rational
        a, b = 6 * (L + q4), 6 * q5 - L * q6
        va, vb = 6 * v4, 6 * v5 - L * v6
        rest = q4 * v4 / 3 + F(13, 35) * v5 * q5 - F(11, 210) * L * (v6 * q5 + v5 * q6) + L**2 / 105 * v6 * q6
        rows = [
            m * rate_**2 / 12 * (a * C - b * S) + m * rate_ / 6 * (va * S + vb * C),
            m * rate_**2 / 12 * (a * S + b * C) + m * rate_ / 6 * (-va * C + vb * S),
            -2 * m * rate_ * (L / 3 * v4 + rest),  # misprint: 1/3 for L/3
            m * rate_**2 * (L / 3 + q4 / 3) + 2 * m * rate_ * (F(7, 20) * v5 - L / 20 * v6),  # misprint: 1/3 for L/3
            m * rate_**2 * (F(13, 35) * q5 - F(11, 210) * L * q6) + 2 * m * rate_ * (-F(7, 20) * v4),
            m * rate_**2 * (L**2 / 105 * q6 - F(11, 210) * L * q5) + 2 * m * rate_ * (L / 20 * v4),
        ]
        for row, entry in enumerate(rows):
            assert reduced(p.Q_v[row] - entry, delta) == 0, row
        printed = [-2 * m * rate_ * (v4 / 3 + rest), rows[3] + m * rate_**2 * (1 - L) / 3]
        for row, entry in zip((2, 3), printed, strict=True):
            assert reduced(p.Q_v[row] - entry, delta) != 0, row
