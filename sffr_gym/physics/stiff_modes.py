"""The stiff clamped modes of a step: their response at its start, frozen, and the exact solution of what that makes.

With ``z = V' Omega s`` of the stiff amplitudes ``s`` the frozen part is ``zdd = -mu^2 (z + eta zd)``, uncoupled, and
its effect on all coordinates ``sum_j R_j zdd_j``.
"""

from __future__ import annotations

from math import cos, exp, sin, sqrt
from typing import NamedTuple

from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.lanes import any_lane, where
from sffr_gym.compile.workspace import Interleaved
from sffr_gym.physics.dynamics import stiff_response
from sffr_gym.types import Array

MAX_SWEEPS = 20
ROTATION_THRESHOLD = 1.0e-3  # couplings of stiff modes below this over a step stay in the explicit part


class Oscillators(NamedTuple):
    """The uncoupled oscillators of the frozen part; all (n_s,)."""

    mu2: Array  #: squared frequencies [rad2/s2]
    damping: Array  #: ``eta mu2`` [1/s]
    zz: Array  #: transition over half a step, ``z' = zz z + zv zd`` and ``zd' = vz z + vv zd``
    zv: Array
    vz: Array
    vv: Array


class Frozen(NamedTuple):
    """Memory of the frozen part; n_s is the number of all clamped modes, the stiff ones use the first places."""

    W: Array  #: (n_s, n) response of all coordinates to a unit force on each stiff mode
    K: Array  #: (n_s, n_s) scaled stiffness, then its eigenvalues on the diagonal
    V: Array  #: (n_s, n_s) its eigenvectors, in columns
    R: Array  #: (n_s, n) response in coupled modes, divided by their squared frequency
    oscillators: Oscillators  #: the coupled modes


def frozen_shapes(model):
    """Shapes of the :class:`Frozen` of a robot, whichever of its modes are stiff."""
    n, n_s = model.at.end, model.omega2.size
    return Frozen(
        W=(n_s, n), K=(n_s, n_s), V=(n_s, n_s), R=(n_s, n),
        oscillators=Interleaved(Oscillators((n_s,), (n_s,), (n_s,), (n_s,), (n_s,), (n_s,))),
    )  # fmt: skip


@kernel
def freeze(model, p, v, half, work, modes, z, zd):
    """Freeze the stiff modes' response at the start of a step and solve their coupled oscillation.

    p, v: (n,) positions and velocities; half: half of the step [s].
    work: :class:`sffr_gym.physics.dynamics.Work` after ``accelerations`` there; modes: :class:`Frozen`, written.
    z, zd: (n_s,) amplitudes and rates of the coupled modes, written.
    """
    stiff, n_s = model.stiff, len(model.stiff.omega)
    W, K, V, R, omega = modes.W, modes.K, modes.V, modes.R, stiff.omega
    for j in range(n_s):
        stiff_response(model, v, stiff.panel[j], stiff.mode[j], work, W[j])
    for j in range(n_s):
        for k in range(n_s):
            K[j, k] = omega[j] * W[j, stiff.at[k]] * omega[k]
    _jacobi(K, V, n_s, ROTATION_THRESHOLD / (half * half))
    for j in range(n_s):
        mu2 = K[j, j]
        _transition(mu2, model.eta * mu2, half, modes.oscillators, j)
        R[j, :] = 0.0
        z[j] = zd[j] = 0.0
        for k in range(n_s):
            weight = V[k, j] * omega[k]
            z[j] += weight * p[stiff.at[k]]
            zd[j] += weight * v[stiff.at[k]]
            weight /= mu2
            for c in range(len(p)):
                R[j, c] += weight * W[k, c]
        # Exact by definition; what _jacobi left coupled belongs to the slow part.
        for k in range(n_s):
            R[j, stiff.at[k]] = V[k, j] / omega[k]


@kernel
def take_out(model, modes, z, zd, a, g):
    """Take the frozen part out of the accelerations ``a`` (n,); what is left of them in coupled modes is ``g`` (n_s,).

    modes: :class:`Frozen`; z, zd: (n_s,) amplitudes and rates of the coupled modes.
    """
    oscillators, stiff, n_s = modes.oscillators, model.stiff, len(model.stiff.omega)
    for j in range(n_s):
        force = oscillators.mu2[j] * z[j] + oscillators.damping[j] * zd[j]
        for c in range(len(a)):
            a[c] += modes.R[j, c] * force
    for j in range(n_s):
        g[j] = 0.0
        for k in range(n_s):
            g[j] += modes.V[k, j] * stiff.omega[k] * a[stiff.at[k]]


@kernel
def _transition(mu2, damping, duration, oscillators, j):
    """Fill oscillator ``j``: the state transition of ``zdd + damping zd + mu2 z = 0`` over ``duration`` [s]."""
    sigma = 0.5 * damping
    discriminant = mu2 - sigma * sigma
    rate = sqrt(abs(discriminant))
    decay = exp(-sigma * duration)
    c, s = decay * cos(rate * duration), where(rate > 0.0, decay * sin(rate * duration) / rate, decay * duration)
    over = discriminant < 0.0
    if any_lane(over):  # an overdamped mode: exponents together, so that neither overflows
        slow, fast = exp((rate - sigma) * duration), exp(-(rate + sigma) * duration)
        c, s = where(over, 0.5 * (slow + fast), c), where(over, 0.5 * (slow - fast) / rate, s)
    oscillators.mu2[j], oscillators.damping[j] = mu2, damping
    oscillators.zz[j], oscillators.zv[j] = c + sigma * s, s
    oscillators.vz[j], oscillators.vv[j] = -mu2 * s, c - sigma * s


@kernel
def _jacobi(A, V, n, threshold):
    """Diagonalise the first ``n`` rows and columns of a symmetric matrix in place; its eigenvectors go into ``V``.

    By cyclic Jacobi rotations, until no coupling exceeds ``threshold``.
    """
    for i in range(n):
        for j in range(n):
            V[i, j] = 1.0 if i == j else 0.0
    for _ in range(MAX_SWEEPS):
        rotated = False
        for i in range(n - 1):
            for j in range(i + 1, n):
                coupled = abs(A[i, j]) > threshold
                if any_lane(coupled):
                    _rotate(A, V, n, i, j, coupled)
                    rotated = True
        if not rotated:
            return


@kernel
def _rotate(A, V, n, i, j, coupled):
    """One Jacobi rotation that makes ``A[i, j]`` zero (Golub and Van Loan, Matrix Computations, sec. 8.5).

    coupled: where this is false nothing turns.
    """
    ratio = 0.5 * (A[j, j] - A[i, i]) / A[i, j]
    t = 1.0 / (abs(ratio) + sqrt(ratio * ratio + 1.0))
    t = where(coupled, where(ratio < 0.0, -t, t), 0.0)
    c = 1.0 / sqrt(t * t + 1.0)
    s = t * c
    for k in range(n):
        A[k, i], A[k, j] = c * A[k, i] - s * A[k, j], s * A[k, i] + c * A[k, j]
    for k in range(n):
        A[i, k], A[j, k] = c * A[i, k] - s * A[j, k], s * A[i, k] + c * A[j, k]
        V[k, i], V[k, j] = c * V[k, i] - s * V[k, j], s * V[k, i] + c * V[k, j]
