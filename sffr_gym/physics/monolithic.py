"""The paper's equations assembled as one system ``M zdd + h = Q``, in plain NumPy (Eqs. 2, 4, 40, 41, 45, 48-50).

``z = [q, q_f of each panel]`` in nodal elastic coordinates. This is the readable form: the kernels of ``dynamics``
solve the same equations by elimination, and the tests hold the two against each other and against the Lagrangian.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sffr_gym.physics.beam import Beam
from sffr_gym.physics.kinematics import arm_points, base_point, perpendicular, rotation
from sffr_gym.physics.model import N_BASE, Model
from sffr_gym.types import Array


class PanelEquations(NamedTuple):
    """Eq. 2 of one panel in the inertial axes: mass blocks and quadratic velocity vector."""

    m_rr: Array  #: (3, 3) over root acceleration and angle
    m_rf: Array  #: (3, n_f)
    m_ff: Array  #: (n_f, n_f)
    Q_vr: Array  #: (3,)
    Q_vf: Array  #: (n_f,)


def panel_equations(beam: Beam, delta: float, delta_d: float, qf: Array, qfd: Array) -> PanelEquations:
    """Return the mass matrix and quadratic velocity vector of a floating panel.

    Source: Eqs. 45 and 48 for any number of elements, with the misprints of rows 2 (45) and 3, 4 (48) mended.

    Args:
        beam: the panel's shape integrals.
        delta: angle of the panel's x axis from the inertial one [rad].
        delta_d: its rate [rad/s].
        qf: (n_f,) nodal elastic coordinates [m, rad].
        qfd: (n_f,) their rates [m/s, rad/s].
    """
    R, dR = rotation(delta), rotation(delta + np.pi / 2)  # dR = dR/d(delta)
    first = np.array([beam.first_moment + beam.S_x @ qf, beam.S_y @ qf])  # integral of rho a (x + u, w)
    first_d = np.array([beam.S_x @ qfd, beam.S_y @ qfd])
    turn = beam.c_y + (beam.N - beam.N.T) @ qf  # integral of rho a [(x + u) W - w U]
    m_rr = beam.mass * np.eye(3)
    m_rr[:2, 2] = m_rr[2, :2] = dR @ first
    m_rr[2, 2] = beam.second_moment + 2 * beam.c_x @ qf + qf @ beam.M_ff @ qf
    m_rf = np.vstack([R @ np.vstack([beam.S_x, beam.S_y]), turn])
    Q_vr = np.empty(3)
    Q_vr[:2] = delta_d**2 * R @ first - 2 * delta_d * dR @ first_d
    Q_vr[2] = -2 * delta_d * (beam.c_x @ qfd + qf @ beam.M_ff @ qfd)
    Q_vf = delta_d**2 * (beam.c_x + beam.M_ff @ qf) - 2 * delta_d * (beam.N - beam.N.T) @ qfd
    return PanelEquations(m_rr, m_rf, beam.M_ff, Q_vr, Q_vf)


def rigid_equations(model: Model, q: Array, qd: Array) -> tuple[Array, Array]:
    """Return H (n, n) and the vector of quadratic velocity terms C (n,) of base and arms (Eqs. 40 and 41)."""
    n = N_BASE + len(model.link_mass)
    H, C = np.zeros((n, n)), np.zeros(n)
    bodies = [(base_point(model, q, qd, np.zeros(2)), model.base_mass, model.base_inertia)]
    for arm in range(len(model.arm_mount)):
        links = range(model.arm_first[arm], model.arm_first[arm + 1])
        centres, _ = arm_points(model, q, qd, arm)
        bodies += [(c, model.link_mass[k], model.link_inertia[k]) for c, k in zip(centres, links, strict=True)]
    for point, mass, inertia in bodies:
        H += mass * point.J.T @ point.J + inertia * np.outer(point.w, point.w)
        C += mass * point.J.T @ point.Jd_qd
    return H, C


def assemble(model: Model, beams: Sequence[Beam], q: Array, qd: Array, qf: Array, qfd: Array) -> tuple[Array, Array]:
    """Return mass matrix M (N, N) and bias h (N,) of the whole robot, elastic and damping forces included in h.

    Args:
        model: the robot.
        beams: each panel's shape integrals.
        q: (n,) rigid coordinates [m, rad].
        qd: (n,) their rates [m/s, rad/s].
        qf: (n_p, n_f) elastic coordinates [m, rad].
        qfd: (n_p, n_f) their rates [m/s, rad/s].
    """
    n, (n_p, n_f) = len(q), qf.shape
    M, h = np.zeros((n + n_p * n_f, n + n_p * n_f)), np.zeros(n + n_p * n_f)
    M[:n, :n], h[:n] = rigid_equations(model, q, qd)
    for i in range(n_p):
        elastic = slice(n + i * n_f, n + (i + 1) * n_f)
        J_f, Jd_qd = root_jacobian(model, q, qd, i)
        panel = panel_equations(beams[i], q[2] + panel_angle(model, i), qd[2], qf[i], qfd[i])
        M[:n, :n] += J_f.T @ panel.m_rr @ J_f
        M[:n, elastic] = J_f.T @ panel.m_rf
        M[elastic, :n] = M[:n, elastic].T
        M[elastic, elastic] = panel.m_ff
        h[:n] += J_f.T @ (panel.m_rr @ Jd_qd - panel.Q_vr)
        h[elastic] = panel.m_rf.T @ Jd_qd - panel.Q_vf + beams[i].K @ (qf[i] + model.eta * qfd[i])
    return M, h


def root_jacobian(model: Model, q: Array, qd: Array, i: int) -> tuple[Array, Array]:
    """Return J_f (3, n) of a panel's root pose, and its acceleration (3,) at qdd = 0 (Eqs. 4 and 49)."""
    root = base_point(model, q, qd, model.panel_root[i])
    return np.vstack([root.J, root.w]), np.append(root.Jd_qd, 0.0)


def panel_angle(model: Model, i: int) -> float:
    """Return the angle of a panel's x axis in the base frame [rad]."""
    return float(np.arctan2(model.panel_axis[i, 1], model.panel_axis[i, 0]))


def constraint_jacobian(model: Model, q: Array, qd: Array, x_obj: Array) -> tuple[Array, Array]:
    """Return J (2 n_g, n + 3) over ``[qd, xd_obj]`` of the tips' gaps to their grasp points, and the gaps (2 n_g,)."""
    n, n_g = len(q), len(model.grasp_arm)
    J, gap = np.zeros((2 * n_g, n + 3)), np.zeros(2 * n_g)
    for g in range(n_g):
        _, tip = arm_points(model, q, qd, int(model.grasp_arm[g]))
        r = rotation(x_obj[2]) @ model.grasp_point[g]
        rows = slice(2 * g, 2 * g + 2)
        J[rows, :n] = tip.J
        J[rows, n : n + 2] = -np.eye(2)
        J[rows, n + 2] = -perpendicular(r)
        gap[rows] = tip.x - x_obj[:2] - r
    return J, gap
