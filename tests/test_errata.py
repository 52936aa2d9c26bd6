"""Misprints and gaps of the paper that no other test proves; `docs/errata.md` cites each of them."""

import numpy as np
import pytest
import scipy.linalg
import sympy as sp
from case_study import make_config, random_state
from lagrangian import floating_panel
from oracle import Oracle
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import dynamicsymbols

from sffr_gym import load_params
from sffr_gym.physics import monolithic
from sffr_gym.physics.beam import beam
from sffr_gym.physics.each_panel import panel_beams
from sffr_gym.physics.model import pack

PANEL = load_params().panel
B0 = np.array(load_params().suppression.B0)


def case_study_beam(elements=1):
    return beam(PANEL.mass, PANEL.length, PANEL.EI, PANEL.E * PANEL.area, elements)


class TestRigidPart:
    """Eq. 41: base and one link, with coordinates so curved that every term counts."""

    M, m, I0, I1 = sp.symbols("M m I0 I1", positive=True)  # M is the mass of both bodies, as in Eq. 41a
    q = sp.Matrix(dynamicsymbols("q:3"))
    qd = q.diff(dynamicsymbols._t)

    def bodies(self, base):
        """Place of the base and of the link relative to it, and both angular velocities (scalars, of any form)."""
        a, b, c = self.q
        link = sp.Matrix([sp.cos(a + c) + b, sp.sin(b * c)])
        return base, link, a * self.qd[1] + self.qd[0], sp.sin(b) * self.qd[2] + c * self.qd[0]

    def kinetic_energy(self, base):
        """Of both bodies, by their absolute velocities."""
        R, r, w0, w1 = self.bodies(base)
        Rd, rd = R.diff(dynamicsymbols._t), r.diff(dynamicsymbols._t)
        T = self.M * Rd.dot(Rd) / 2 + self.m * (Rd.dot(rd) + rd.dot(rd) / 2)
        return T + self.I0 * w0**2 / 2 + self.I1 * w1**2 / 2

    def lagrange(self, base):
        """Velocity terms of the equations of Lagrange: all of d/dt dT/dqd - dT/dq that has no acceleration."""
        T = self.kinetic_energy(base)
        still = dict.fromkeys(self.qd.diff(dynamicsymbols._t), 0)
        rows = [sp.diff(sp.diff(T, v), dynamicsymbols._t) - sp.diff(T, x) for x, v in zip(self.q, self.qd, strict=True)]
        return sp.Matrix([row.subs(still) for row in rows])

    def printed(self, base, mended):
        """C_1 qd + C_2 of Eqs. 41b and 41c; mended, the last line of 41b has i and j exchanged in its first term."""
        R, r, w0, w1 = self.bodies(base)
        q, qd, n = self.q, self.qd, range(3)

        def turning(x, j):
            return sum((sp.diff(x, q[s], q[j]) * qd[s] for s in n), sp.zeros(2, 1))

        C_1 = sp.zeros(3, 3)
        for i in n:
            for j in n:
                a, b = (j, i) if mended else (i, j)
                entry = self.M * sp.diff(R, q[i]).dot(turning(R, j)) + self.m * sp.diff(r, q[i]).dot(turning(r, j))
                entry += self.m * (turning(R, a).dot(sp.diff(r, q[b])) + sp.diff(R, q[i]).dot(turning(r, j)))
                for inertia, w in ((self.I0, w0), (self.I1, w1)):
                    entry += inertia * (sp.diff(w, qd[i]) * sp.diff(w, q[j]) + w * sp.diff(w, qd[i], q[j]))
                C_1[i, j] = entry
        C_2 = -sp.Matrix([self.I0 * w0 * sp.diff(w0, x) + self.I1 * w1 * sp.diff(w1, x) for x in q])
        return C_1 * qd + C_2

    def inertia(self, base, absolute):
        """H of Eq. 41a, with r from the base's centre of mass or from the inertial origin."""
        R, r, w0, w1 = self.bodies(base)
        place = r + R if absolute else r
        H = sp.zeros(3, 3)
        for i, (q_i, qd_i) in enumerate(zip(self.q, self.qd, strict=True)):
            for j, (q_j, qd_j) in enumerate(zip(self.q, self.qd, strict=True)):
                R_i, R_j, r_i, r_j = sp.diff(R, q_i), sp.diff(R, q_j), sp.diff(place, q_i), sp.diff(place, q_j)
                H[i, j] = self.M * R_i.dot(R_j) + self.m * (r_i.dot(r_j) + r_i.dot(R_j) + r_j.dot(R_i))
                H[i, j] += self.I0 * sp.diff(w0, qd_i) * sp.diff(w0, qd_j)
                H[i, j] += self.I1 * sp.diff(w1, qd_i) * sp.diff(w1, qd_j)
        return H

    def test_r_of_eq_41a_is_relative_to_the_base(self):
        cartesian = sp.Matrix([self.q[0], self.q[1]])
        derived = sp.hessian(self.kinetic_energy(cartesian), list(self.qd))
        assert (derived - self.inertia(cartesian, absolute=False)).expand() == sp.zeros(3, 3)
        assert (derived - self.inertia(cartesian, absolute=True)).expand()[0, 0] != 0

    def test_eq_41b_has_two_indices_exchanged(self):
        polar = self.q[0] * sp.Matrix([sp.cos(self.q[1]), sp.sin(self.q[1])])
        derived = self.lagrange(polar)
        assert (derived - self.printed(polar, mended=True)).expand() == sp.zeros(3, 1)
        harm = self.printed(polar, mended=True) - self.printed(polar, mended=False)
        values = {x: sp.Rational(k, 7) for k, x in enumerate([*self.qd, *self.q, self.M, self.m, self.I0, self.I1], 1)}
        assert sp.N(harm.subs(values)).norm() > 1e-3  # at one place of all is enough

    def test_the_exchange_does_no_harm_in_cartesian_coordinates(self):
        cartesian = sp.Matrix([self.q[0], self.q[1]])
        assert (self.lagrange(cartesian) - self.printed(cartesian, mended=False)).expand() == sp.zeros(3, 1)


@pytest.mark.parametrize("seed", [0, 1])
def test_base_feels_the_opposite_of_eq_4(seed):
    """With (Q_e)_r of Eq. 2's first row, H qdd + C = Q - sum J_f' (Q_e)_r; with the printed plus it fails."""
    oracle, params = Oracle(make_config()), load_params()
    model, shape, n = pack(params), panel_beams(params)[0], oracle.n_rigid
    z, zd, Q = random_state(oracle, seed)
    zdd = oracle.acceleration(z, zd, Q, damping=False)
    reaction = np.zeros(n)
    for i, (qf, qfd, qfdd) in enumerate(zip(*(x[n:].reshape(2, 3) for x in (z, zd, zdd)), strict=True)):
        J_f, Jd_qd = monolithic.root_jacobian(model, z[:n], zd[:n], i)
        p = monolithic.panel_equations(shape, z[2] + monolithic.panel_angle(model, i), zd[2], qf, qfd)
        reaction += J_f.T @ (p.m_rr @ (J_f @ zdd[:n] + Jd_qd) + p.m_rf @ qfdd - p.Q_vr)
    H, C = monolithic.rigid_equations(model, z[:n], zd[:n])
    left = H @ zdd[:n] + C - Q[:n]
    np.testing.assert_allclose(left, -reaction, rtol=0, atol=1e-9 * np.abs(left).max())
    assert np.abs(reaction).max() > 1.0


def test_elastic_error_is_driven_by_the_root():
    """Eqs. 21 to 24 for the elastic rows: M_ff edd + B ed + K e = m_fr qdd_r, which is neither Q_e nor zero."""
    p = floating_panel()
    M, K, Q_v = p.M, p.K[3:, 3:], p.Q_v[3:, :]
    q_f, qd_f, B = sp.Matrix(p.q[3:]), sp.Matrix(p.qd[3:]), sp.diag(*sp.symbols("B4:7", positive=True))
    qdd_r, qdd_f = sp.Matrix(sp.symbols("ax ay alpha", real=True)), sp.Matrix(sp.symbols("qdd4:7", real=True))
    tau = -B * qd_f - Q_v  # Eq. 20 with a desired elastic motion of zero
    second_row = M[3:, :3] * qdd_r + M[3:, 3:] * qdd_f + K * q_f - Q_v - tau  # of Eq. 2; zero, as nothing else acts
    left = M[3:, 3:] * -qdd_f + B * -qd_f + K * -q_f
    assert (left - (M[3:, :3] * qdd_r - second_row)).expand() == sp.zeros(3, 1)
    assert not (M[3:, :3] * qdd_r).is_zero_matrix


def test_calm_panels_still_push_on_the_base():
    """After Eq. 18: a panel at rest in its quasi-static shape needs the force that accelerates its mass."""
    shape, acceleration = case_study_beam(), np.array([0.3, -0.2])
    for delta in (0.0, 0.7, -2.1):
        still = monolithic.panel_equations(shape, delta, 0.0, np.zeros(3), np.zeros(3))
        qdd_r = np.append(acceleration, 0.0)
        bent = -np.linalg.solve(shape.K, still.m_rf.T @ qdd_r)
        p = monolithic.panel_equations(shape, delta, 0.0, bent, np.zeros(3))
        np.testing.assert_allclose(p.m_rf.T @ qdd_r + shape.K @ bent, 0.0, atol=1e-12)  # no vibration
        np.testing.assert_allclose((p.m_rr @ qdd_r - p.Q_vr)[:2], PANEL.mass * acceleration, rtol=1e-12)


def test_state_of_eq_26_is_stacked():
    """A of Eq. 27 belongs to X = [e; ed]. In the printed order e1, ed1, e2, ... the error does not obey it."""
    shape = case_study_beam()
    M_inv, B, zero = np.linalg.inv(shape.M_ff), np.diag(B0), np.zeros((3, 3))
    A = np.block([[zero, np.eye(3)], [-M_inv @ shape.K, -M_inv @ B]])
    e, ed = np.random.default_rng(0).normal(size=(2, 3))
    edd = -M_inv @ (shape.K @ e + B @ ed)
    np.testing.assert_allclose(A @ np.append(e, ed), np.append(ed, edd))
    interleaved = [0, 3, 1, 4, 2, 5]
    assert not np.allclose(A @ np.append(e, ed)[interleaved], np.append(ed, edd)[interleaved])


def test_adapted_damping_need_not_become_the_desired_one():
    """Eq. 36 is zero for X = 0 whatever the error of B: the deflection fades, and B stops wherever it then is."""
    m, k, psi, gain = 1.0, 4.0, 0.1, 5.0

    def motion(_, state):
        e, ed, B = state
        return [ed, -(B * ed + k * e) / m, gain * ed * (ed + psi * e)]  # Eq. 39 in the form whose proof closes

    ends = [solve_ivp(motion, (0.0, 100.0), [0.3, 0.0, B], rtol=1e-9, atol=1e-12).y[:, -1] for B in (0.5, 1.0)]
    for e, ed, _ in ends:
        assert abs(e) + abs(ed) < 1e-6
    assert ends[1][2] > ends[0][2] + 0.2


def test_one_voltage_cannot_make_the_law():
    """Eq. 15 with K_PZ (m x 1) has rank one; Eq. 20 asks for forces on the tip in every direction."""
    rng = np.random.default_rng(0)
    wanted = -B0[:, None] * rng.normal(size=(3, 50))
    assert np.linalg.matrix_rank(wanted) == 3
    K_PZ = rng.normal(size=(3, 1))
    assert np.linalg.matrix_rank(K_PZ @ rng.normal(size=(1, 50))) == 1


def test_patch_at_the_tip_hardly_bends_the_panel():
    """A patch makes opposite moments at its ends, whose work is by the slope that the mode gains between them."""
    shape = case_study_beam(elements=20)
    bending = np.delete(np.arange(60), np.s_[::3])
    first = scipy.linalg.eigh(shape.K[np.ix_(bending, bending)], shape.M_ff[np.ix_(bending, bending)])[1][:, 0]
    slope = np.append(0.0, first[1::2])
    at_root, at_tip = slope[2] - slope[0], slope[-1] - slope[-3]  # a tenth of the length each
    assert abs(at_tip) < 0.03 * abs(at_root)


def test_thickness_that_table_i_implies():
    """A rectangle of area a with E I = EI is 1.58 mm thick, half of it 0.79 mm; density and size give 8.96 kg."""
    thickness = np.sqrt(12.0 * PANEL.EI / (PANEL.E * PANEL.area))
    assert thickness / 2 == pytest.approx(0.79e-3, abs=5e-6)
    assert PANEL.area / thickness == pytest.approx(1.01, abs=5e-3)  # m wide
    assert 1400.0 * PANEL.area * PANEL.length == pytest.approx(8.96)
    assert PANEL.mass == 9.0


def test_damping_of_table_iv():
    """B(0) as a part of the critical damping of the clamped modes (two of bending, the axial one); the panel's own."""
    shape = case_study_beam()
    squares, modes = scipy.linalg.eigh(shape.K, shape.M_ff)
    omega = np.sqrt(squares)
    ratio = np.diag(modes.T @ np.diag(B0) @ modes) / (2.0 * omega)
    np.testing.assert_allclose(ratio, [0.720, 1.334, 0.206], atol=1e-3)
    strain_rate = PANEL.strain_rate_damping * omega / 2.0
    np.testing.assert_allclose(strain_rate, [1.15e-5, 1.135e-4, 0.0495], rtol=5e-3)
