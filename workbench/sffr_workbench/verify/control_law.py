"""Checks of the paper's suppression law (Eqs. 16, 20-29, 39): signs, blocks, and which output is passive.

With the error e = q_d - q and a held virtual damping, the panel obeys ``M e_dd + B e_d + K e = -Q_e + Phi``; Phi is
what an error of the estimated damping adds. A transfer function H from Phi to an output is strictly positive real
(SPR), which the proof of the adaptation needs, if H(jw) + H(jw)* > 0 for all w, at infinity times w^2.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import sympy as sp
from scipy.linalg import eigh

from sffr_gym.config.params import load_params
from sffr_gym.physics.beam import one_element_beam
from sffr_gym.types import Array
from sffr_workbench.verify.check import Check, make_check

N = 2  # coordinates of the symbolic proofs: enough for matrices that do not commute
COUNT = "entries"


def checks(quick: bool) -> list[partial[Check]]:
    """List the checks of this module."""
    proofs = map(partial, (damping_sign, error_equation, state_matrix, printed_output, filtered_output_scalar))
    return [*proofs, partial(filtered_output, trials=20 if quick else 200), partial(printed_weight)]


def damping_sign() -> Check:
    """Prove that Eq. 20 takes the power e_d' B e_d out of the error's energy, and Eq. 16 as printed puts it in."""
    s = _Law()
    power = (s.M * s.edd + s.K * s.e).dot(s.ed)  # rate of e_d' M e_d / 2 + e' K e / 2
    damped = (s.B * s.ed).dot(s.ed)
    wrong = 0
    for sign, expected in ((1, -damped), (-1, damped)):  # Eq. 20: B (qd_des - qd); Eq. 16: B (qd - qd_des)
        edd = s.error_acceleration(sign * s.B * s.ed, Q_e=sp.zeros(N, 1))
        wrong += sp.simplify(power.subs(dict(zip(s.edd, edd, strict=True))) - expected) != 0
    return make_check(
        "Eq. 16 and Eq. 20, sign of the virtual damping", "SymPy: power of the error's energy", wrong, 0.0, COUNT,
        "Misprint proved: with Eq. 16 the error's energy grows by e_d' B e_d, with Eq. 20 it falls by as much.",
    )  # fmt: skip


def error_equation() -> Check:
    """Prove that Eqs. 21 and 23 with -Q_e on the right follow from Eqs. 1 and 20."""
    s = _Law()
    edd = s.error_acceleration((s.B - s.B_tilde) * s.ed)
    wrong = 0
    for sign, expected in ((-1, True), (1, False)):
        left = s.M * edd + s.B * s.ed + s.K * s.e
        holds = sp.simplify(left - (sign * s.Q_e + s.B_tilde * s.ed)) == sp.zeros(N, 1)
        wrong += holds != expected
    return make_check(
        "Eqs. 21-23, right-hand side", "SymPy: Eq. 1 under Eq. 20", wrong, 0.0, COUNT,
        "Misprint proved: it is -Q_e (+ the error of B times e_d in Eq. 23); with +Q_e the equation does not hold.",
    )  # fmt: skip


def state_matrix() -> Check:
    """Prove that the rows of A in Eq. 27 are [0, I] and [-M^-1 K, -M^-1 B]."""
    s = _Law()
    edd = s.error_acceleration(s.B * s.ed, Q_e=sp.zeros(N, 1))
    A = sp.Matrix([*s.ed, *edd]).jacobian([*s.e, *s.ed])
    right = sp.Matrix(sp.BlockMatrix([[sp.zeros(N), sp.eye(N)], [-s.M.inv() * s.K, -s.M.inv() * s.B]]))
    regressor, error = sp.diag(*s.ed), s.B_tilde  # what Eq. 27 prints in the place of K and of B
    wrong = sum(entry != 0 for entry in sp.simplify(A - right))
    wrong += sp.simplify(A[N:, :N] + s.M.inv() * regressor) == sp.zeros(N)
    wrong += sp.simplify(A[N:, N:] + s.M.inv() * error) == sp.zeros(N)
    return make_check(
        "Eq. 27, matrix A", "SymPy: Jacobian of the error's motion", wrong, 0.0, COUNT,
        "Misprint proved: block (2,1) has the stiffness, not the regressor; block (2,2) has B, not its error.",
    )  # fmt: skip


def printed_output() -> Check:
    """Prove that Eq. 29 with C = [I 0] forces the lower right block of rho to zero: no rho > 0 exists."""
    rho = sp.Matrix(2 * N, 2 * N, lambda i, j: sp.Symbol(f"r{min(i, j)}{max(i, j)}", real=True))
    B = sp.Matrix.vstack(sp.zeros(N), sp.eye(N))
    C = sp.Matrix.hstack(sp.eye(N), sp.zeros(N))
    solution = sp.solve(list(rho * B - C.T), list(rho.free_symbols), dict=True)
    wrong = int(len(solution) != 1)
    for found in solution:
        direction = sp.Matrix([0] * N + list(sp.symbols(f"v:{N}", real=True)))
        wrong += sp.simplify((direction.T * rho.subs(found) * direction)[0]) != 0
    return make_check(
        "Eq. 29, the printed output Y = e", "SymPy: all rho with rho B = C'", wrong, 0.0, COUNT,
        "Proved: every such rho gives zero energy to all velocities: none is positive definite (relative degree two).",
    )  # fmt: skip


def filtered_output_scalar() -> Check:
    """Prove where Y = e_d + psi e of one coordinate is positive real.

    ``Re H(jw) = (psi k + (b - psi m) w^2) / |k - m w^2 + j w b|^2``.
    """
    m, b, k, psi, w = sp.symbols("m b k psi omega", positive=True)
    H = (sp.I * w + psi) / (k - m * w**2 + sp.I * w * b)
    claimed = (psi * k + (b - psi * m) * w**2) / ((k - m * w**2) ** 2 + (b * w) ** 2)
    real = (H + H.subs(sp.I, -sp.I)) / 2
    wrong = int(sp.simplify(real - claimed) != 0)
    wrong += sp.limit(claimed * w**2, w, sp.oo) != sp.simplify((b - psi * m) / m**2)
    return make_check(
        "Filtered output, one coordinate: SPR if and only if psi < b / m", "SymPy: real part of H(jw)", wrong, 0.0,
        COUNT,
        "The numerator is positive for all w if and only if psi <= b / m; SPR asks for w^2 Re H > 0 at infinity too.",
    )  # fmt: skip


def filtered_output(trials: int, seed: int = 0) -> Check:
    """Check that SPR means psi < lambda_min of ``B v = lambda M v``: a Lyapunov matrix below, a frequency above.

    With x = (K - w^2 M + j w B)^-1 v: ``Re v* H v = psi x* K x + w^2 x* (B - psi M) x``. Below the bound
    ``rho = [[K + psi B, psi M], [psi M, M]]`` satisfies ``rho [0; M^-1] = [psi I; I]`` and
    ``A' rho + rho A = -2 diag(psi K, B - psi M)``.
    """
    rng, wrong = np.random.default_rng(seed), 0
    cases = [_bending()] + [tuple(_positive(rng, n) for _ in range(3)) for n in rng.integers(1, 6, trials)]
    for M, B, K in cases:
        bound = float(eigh(B, M, eigvals_only=True)[0])
        wrong += not _has_lyapunov_matrix(M, B, K, 0.999 * bound)
        direction = eigh(B, M)[1][:, 0]  # the bound's own vector, at high frequency, shows that it is sharp
        wrong += (
            not _real_part(M, B, K, 1.01 * bound, 1.0e4 * np.sqrt(eigh(K, M, eigvals_only=True)[-1]), M @ direction) < 0
        )
    M, B, K = _bending()
    bound = float(eigh(B, M, eigvals_only=True)[0])
    psi = load_params().suppression.psi
    return make_check(
        "Filtered output, matrices: SPR if and only if psi < lambda_min(B, M)",
        "Lyapunov matrix below the bound, frequency response above", wrong, 0.0, "cases",
        f"B v = lambda M v. Panel's bending with B of Table IV: psi < {bound:.4f} 1/s; the shipped psi is {psi:g} 1/s.",
    )  # fmt: skip


def printed_weight() -> Check:
    """Check that the weight M^-1 of Eq. 39 leaves Y = e_d + psi e not positive real for B(0) of Table IV.

    At high frequency ``w^2 (H + H*)`` of ``H = M^-1 (jw + psi) (K - w^2 M + j w B)^-1`` tends to
    ``M^-1 (M^-1 B + B M^-1 - 2 psi) M^-1``.
    """
    M, B, K = _bending()
    least = float(np.linalg.eigvalsh(np.linalg.solve(M, B) + np.linalg.solve(M, B).T)[0]) / 2
    # The claim of the note: no psi > 0 will do. Shown at a finite frequency as well.
    psi, omega = 1.0e-6, 1.0e4
    H = np.linalg.solve(M, (1j * omega + psi) * np.linalg.inv(K - omega**2 * M + 1j * omega * B))
    negative = float(np.linalg.eigvalsh(H + H.conj().T)[0]) < 0
    return make_check(
        "Eq. 39's weight M^-1 with the filtered output", "frequency response", not (least < 0 and negative), 0.0, COUNT,
        f"Proved: SPR would need psi < lambda_min of the symmetric part of M^-1 B = {least:.3f} 1/s < 0. "
        "The proof closes with dB/dt = Gamma diag(e_d) (e_d + psi e), without M^-1: M belongs to rho.",
    )  # fmt: skip


class _Law:
    """Symbols of an elastic system under Eq. 20, and the acceleration of its error."""

    def __init__(self) -> None:
        self.M, self.K, self.B, self.B_tilde = (_symmetric(name) for name in ("m", "k", "b", "t"))
        self.e, self.ed, self.edd, self.Q_e, self.Q_v, self.qdd_des, self.q_des = (
            sp.Matrix(sp.symbols(f"{name}:{N}", real=True))
            for name in ("e", "ed", "edd", "Qe", "Qv", "qdd_des", "q_des")
        )

    def error_acceleration(self, damping: sp.Matrix, Q_e: sp.Matrix | None = None) -> sp.Matrix:
        """Return the error's acceleration ``qdd_des - qdd``.

        ``M qdd + K q = Q_e + Q_v + tau`` with ``tau = M qdd_des + damping + K q_des - Q_v``.
        """
        Q_e = self.Q_e if Q_e is None else Q_e
        tau = self.M * self.qdd_des + damping + self.K * self.q_des - self.Q_v
        qdd = self.M.inv() * (Q_e + self.Q_v + tau - self.K * (self.q_des - self.e))
        return (self.qdd_des - qdd).applyfunc(sp.simplify)


def _symmetric(name: str) -> sp.Matrix:
    return sp.Matrix(N, N, lambda i, j: sp.Symbol(f"{name}{min(i, j)}{max(i, j)}", real=True))


def _bending() -> tuple[Array, Array, Array]:
    """Return M, B, K of the paper's panel in (q5, q6), with B(0) of Table IV."""
    params = load_params()
    shape = one_element_beam(params.panel)
    return shape.M_ff[1:, 1:], np.diag(params.suppression.B0[1:]), shape.K[1:, 1:]


def _positive(rng: np.random.Generator, n: int) -> Array:
    root = rng.normal(size=(n, n))
    return root @ root.T + 0.1 * np.eye(n)


def _has_lyapunov_matrix(M: Array, B: Array, K: Array, psi: float) -> bool:
    """Return whether the rho of :func:`filtered_output` is positive definite and proves the system SPR."""
    n = len(M)
    zero, identity = np.zeros((n, n)), np.eye(n)
    A = np.block([[zero, identity], [-np.linalg.solve(M, K), -np.linalg.solve(M, B)]])
    rho = np.block([[K + psi * B, psi * M], [psi * M, M]])
    Q = -(A.T @ rho + rho @ A)
    output = rho @ np.vstack([zero, np.linalg.inv(M)])
    ties = np.allclose(output, np.vstack([psi * identity, identity]), rtol=0, atol=1e-9)
    claimed = 2 * np.block([[psi * K, zero], [zero, B - psi * M]])
    agrees = np.allclose(Q, claimed, rtol=0, atol=1e-9 * np.abs(rho).max() * max(1.0, np.abs(A).max()))
    return ties and agrees and np.linalg.eigvalsh(rho)[0] > 0 and np.linalg.eigvalsh(claimed)[0] > 0


def _real_part(M: Array, B: Array, K: Array, psi: float, omega: float, v: Array) -> float:
    """Return Re v* H(jw) v, times w^2."""
    x = np.linalg.solve(K - omega**2 * M + 1j * omega * B, v)
    return float(np.real(np.conj(v) @ ((1j * omega + psi) * x))) * omega**2
