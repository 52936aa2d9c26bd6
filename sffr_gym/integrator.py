"""Steps of the plant under held actuator forces: exponential Runge-Kutta (default) and the classical method.

The panels' axial mode (3200 rad/s on the free robot) turns six radians within a control period of 2 ms. ETDRK4 (Cox and
Matthews 2002, a fourth-order method) splits ``xdd = n(p, v) + W f`` into the elastic force ``f`` of the stiff clamped
modes, whose effect ``W`` on all coordinates is frozen during a step, and the slow rest ``n``. The frozen linear part is
solved exactly, undamped when the panel is; ``n`` enters as a polynomial in time. Nothing is damped that is not damped
in the model, and the step is set by the slow motion alone.
"""

from __future__ import annotations

from math import cos, exp, sin, sqrt
from typing import NamedTuple

from sffr_gym._jit import assign, kernel
from sffr_gym.beam import Array
from sffr_gym.dynamics import Work, accelerations, flexible_wrench, stiff_response, workspace
from sffr_gym.lanes import ONE, any_lane, where, zeros
from sffr_gym.model import is_staggered, n_positions

ETDRK4, RK4 = 0, 1
INTEGRATORS = {"etdrk4": ETDRK4, "rk4": RK4}

MAX_SWEEPS = 20
ROTATION_THRESHOLD = 1.0e-3  # couplings of stiff modes below this over a step stay in the explicit part


class StepWork(NamedTuple):
    """Buffers of one step; see :class:`sffr_gym.dynamics.Work`."""

    dynamics: Work
    p: Array  # (4, n) positions at the stages
    v: Array  # (4, n)
    a: Array  # (4, n) slow accelerations at the four stages
    W: Array  # (n_s, n) response to a unit force on each stiff mode
    R: Array  # (n_s, n) W in coupled modes, divided by their squared frequency
    K: Array  # (n_s, n_s) scaled stiffness, then its eigenvalues on the diagonal
    V: Array  # (n_s, n_s) eigenvectors, in columns
    mode: Array  # (n_s, 6) mu^2, eta mu^2 and the transition of half a step; see _transition
    z: Array  # (4, 2, n_s) coupled amplitudes and rates at the stages
    g: Array  # (4, n_s) slow accelerations of the coupled modes
    q_flex: Array  # (3,) the panels' wrench on the base at the start of the last step
    lam: Array  # (n_g, 2) grasp forces there, base axes


@kernel(allocates=True)
def step_workspace(model, one=ONE):
    """Allocate the buffers of :func:`advance` for a robot, or for robots in lanes; see :func:`lanes.zeros`."""
    n, n_s = n_positions(model), len(model.stiff)
    return StepWork(
        dynamics=workspace(model, one), p=zeros(one, (4, n)), v=zeros(one, (4, n)), a=zeros(one, (4, n)),
        W=zeros(one, (n_s, n)), R=zeros(one, (n_s, n)), K=zeros(one, (n_s, n_s)), V=zeros(one, (n_s, n_s)),
        mode=zeros(one, (n_s, 6)), z=zeros(one, (4, 2, n_s)), g=zeros(one, (4, n_s)),
        q_flex=zeros(one, 3), lam=zeros(one, (len(model.grasp_arm), 2)),
    )  # fmt: skip


@kernel(inline=True)
def advance(model, p, v, tau, duration, steps, integrator, work):
    """Advance the plant in place by ``duration`` [s] in equal steps.

    p, v: (n,) positions and velocities; tau: (n,) generalised forces, held; see :func:`dynamics.accelerations`.
    integrator: ``ETDRK4`` or ``RK4``.
    """
    h = duration / steps
    for _ in range(steps):
        if integrator == RK4:
            _rk4(model, p, v, tau, h, work)
        else:
            _etdrk4(model, p, v, tau, h, work)


@kernel(inline=True)
def _rk4(model, p, v, tau, h, work):
    """Classical fourth-order Runge-Kutta; stable only while h times the largest frequency stays below 2.8."""
    n = len(p)
    stage_p, stage_v, a, inner = work.p[0], work.v[0], work.a, work.dynamics
    sum_p, sum_v = work.p[1], work.v[1]
    assign(stage_p, p)
    assign(stage_v, v)
    sum_p[:] = 0.0
    sum_v[:] = 0.0
    for stage in range(4):
        accelerations(model, stage_p, stage_v, tau, inner, a[0], is_staggered(model) and stage > 0, stage == 0)
        if stage == 0:
            _keep_forces(model, v, work)
        weight = h / 6.0 if stage in (0, 3) else h / 3.0
        ahead = h if stage == 2 else 0.5 * h
        for i in range(n):
            sum_p[i] += weight * stage_v[i]
            sum_v[i] += weight * a[0, i]
            stage_p[i] = p[i] + ahead * stage_v[i]
            stage_v[i] = v[i] + ahead * a[0, i]
    for i in range(n):
        p[i] += sum_p[i]
        v[i] += sum_v[i]


@kernel(inline=True)
def _etdrk4(model, p, v, tau, h, work):
    """One step of ETDRK4 in the form of polynomial forcing.

    Stages: half a step under the slow accelerations of the start, half a step under those of that stage, a whole step
    by way of the first half; then the quadratic through the slow accelerations at 0, h/2 and h.
    """
    P, V, a, g, z = work.p, work.v, work.a, work.g, work.z
    half = 0.5 * h
    assign(P[0], p)
    assign(V[0], v)
    for stage in range(4):
        if stage == 3:
            for i in range(len(p)):
                a[3, i] = 2.0 * a[2, i] - a[0, i]
            for j in range(len(model.stiff)):
                g[3, j] = 2.0 * g[2, j] - g[0, j]
        if stage > 0:
            start, forcing = (1, 3) if stage == 3 else (0, stage - 1)
            _constant_forcing(
                P[start], V[start], z[start], a[forcing], g[forcing], half, work, P[stage], V[stage], z[stage]
            )
        held = is_staggered(model) and stage > 0
        accelerations(model, P[stage], V[stage], tau, work.dynamics, a[stage], held, stage == 0)
        if stage == 0:
            _keep_forces(model, v, work)
            _freeze(model, p, v, half, work)
        _slow_part(model, stage, work)
    _quadratic_forcing(p, v, h, work)


@kernel(inline=True)
def _keep_forces(model, v, work):
    """Keep the internal forces of the first evaluation, whose buffers the next ones overwrite.

    Under the staggered coupling the base feels this Q_flex until the step ends.
    """
    work.q_flex[0], work.q_flex[1], work.q_flex[2] = flexible_wrench(model, v, work.dynamics)
    assign(work.dynamics.held, work.q_flex)
    for g in range(len(model.grasp_arm)):
        work.lam[g, 0], work.lam[g, 1] = work.dynamics.grasp[g, 13], work.dynamics.grasp[g, 14]


@kernel(inline=True)
def _freeze(model, p, v, half, work):
    """Freeze the stiff modes' response at the start of a step and solve their coupled oscillation.

    With ``z = V' Omega s`` of the stiff amplitudes s, the frozen part is ``zdd = -mu^2 (z + eta zd)``, and its effect
    on all coordinates ``sum_j R_j zdd_j``.
    """
    n_s = len(model.stiff)
    W, K, V, R, z, omega = work.W, work.K, work.V, work.R, work.z, model.stiff_omega
    for j in range(n_s):
        stiff_response(model, v, model.stiff[j, 0], model.stiff[j, 1], work.dynamics, W[j])
    for j in range(n_s):
        for k in range(n_s):
            K[j, k] = omega[j] * W[j, model.stiff[k, 2]] * omega[k]
    _jacobi(K, V, ROTATION_THRESHOLD / (half * half))
    for j in range(n_s):
        mu2 = K[j, j]
        _transition(mu2, model.eta * mu2, half, work.mode[j])
        R[j, :] = 0.0
        z[0, 0, j] = z[0, 1, j] = 0.0
        for k in range(n_s):
            weight = V[k, j] * omega[k]
            z[0, 0, j] += weight * p[model.stiff[k, 2]]
            z[0, 1, j] += weight * v[model.stiff[k, 2]]
            weight /= mu2
            for c in range(len(p)):
                R[j, c] += weight * W[k, c]
        # Exact by definition; what _jacobi left coupled belongs to the slow part.
        for k in range(n_s):
            R[j, model.stiff[k, 2]] = V[k, j] / omega[k]


@kernel(inline=True)
def _transition(mu2, damping, duration, mode):
    """State transition of ``zdd + damping zd + mu2 z = 0`` over ``duration``, stored behind mu2 and damping."""
    sigma = 0.5 * damping
    discriminant = mu2 - sigma * sigma
    rate = sqrt(abs(discriminant))
    decay = exp(-sigma * duration)
    c, s = decay * cos(rate * duration), where(rate > 0.0, decay * sin(rate * duration) / rate, decay * duration)
    over = discriminant < 0.0
    if any_lane(over):  # an overdamped mode: exponents together, so that neither overflows
        slow, fast = exp((rate - sigma) * duration), exp(-(rate + sigma) * duration)
        c, s = where(over, 0.5 * (slow + fast), c), where(over, 0.5 * (slow - fast) / rate, s)
    mode[0], mode[1] = mu2, damping
    mode[2], mode[3], mode[4], mode[5] = c + sigma * s, s, -mu2 * s, c - sigma * s


@kernel(inline=True)
def _slow_part(model, stage, work):
    """Take the frozen part out of the accelerations of a stage."""
    a, g, z = work.a[stage], work.g[stage], work.z[stage]
    for j in range(len(work.mode)):
        force = work.mode[j, 0] * z[0, j] + work.mode[j, 1] * z[1, j]
        for c in range(len(a)):
            a[c] += work.R[j, c] * force
    for j in range(len(work.mode)):
        g[j] = 0.0
        for k in range(len(work.mode)):
            g[j] += work.V[k, j] * model.stiff_omega[k] * a[model.stiff[k, 2]]


@kernel(inline=True)
def _constant_forcing(p, v, z, a, g, duration, work, p_end, v_end, z_end):
    """Solve the frozen linear part exactly over half a step, the slow accelerations ``a`` (``g`` in z) held."""
    square = 0.5 * duration * duration
    for c in range(len(p)):
        p_end[c] = p[c] + duration * v[c] + square * a[c]
        v_end[c] = v[c] + duration * a[c]
    for j in range(len(work.mode)):
        mode, R = work.mode[j], work.R[j]
        rest = g[j] / mode[0]
        dz, zd = z[0, j] - rest, z[1, j]
        z_end[0, j] = rest + mode[2] * dz + mode[3] * zd
        z_end[1, j] = mode[4] * dz + mode[5] * zd
        shift = z_end[0, j] - z[0, j] - duration * zd - square * g[j]
        kick = z_end[1, j] - zd - duration * g[j]
        for c in range(len(p)):
            p_end[c] += R[c] * shift
            v_end[c] += R[c] * kick


@kernel(inline=True)
def _quadratic_forcing(p, v, h, work):
    """Solve the frozen linear part over the whole step under the quadratic through the stages; in place."""
    a, g, z = work.a, work.g, work.z[0]
    square = h * h
    for c in range(len(p)):
        middle = 0.5 * (a[1, c] + a[2, c])
        first, second = 4.0 * middle - 3.0 * a[0, c] - a[3, c], 2.0 * (a[0, c] + a[3, c]) - 4.0 * middle
        p[c] += h * v[c] + square * (a[0, c] / 2.0 + first / 6.0 + second / 12.0)
        v[c] += h * (a[0, c] + first / 2.0 + second / 3.0)
    for j in range(len(work.mode)):
        mode, R = work.mode[j], work.R[j]
        mu2, damping = mode[0], mode[1]
        middle = 0.5 * (g[1, j] + g[2, j])
        first, second = (
            (4.0 * middle - 3.0 * g[0, j] - g[3, j]) / h,
            (2.0 * (g[0, j] + g[3, j]) - 4.0 * middle) / square,
        )
        # Particular solution A + B t + C t^2, then the transition of a whole step as that of a half squared.
        C = second / mu2
        B = (first - 2.0 * damping * C) / mu2
        A = (g[0, j] - damping * B - 2.0 * C) / mu2
        dz, dzd = z[0, j] - A, z[1, j] - B
        for _ in range(2):
            dz, dzd = mode[2] * dz + mode[3] * dzd, mode[4] * dz + mode[5] * dzd
        impulse = h * (g[0, j] + h * (first / 2.0 + h * second / 3.0))
        travel = square * (g[0, j] / 2.0 + h * (first / 6.0 + h * second / 12.0))
        shift = A + h * (B + h * C) + dz - z[0, j] - h * z[1, j] - travel
        kick = B + 2.0 * h * C + dzd - z[1, j] - impulse
        for c in range(len(p)):
            p[c] += R[c] * shift
            v[c] += R[c] * kick


@kernel(inline=True)
def _jacobi(A, V, threshold):
    """Diagonalise a symmetric matrix in place by cyclic Jacobi rotations until no coupling exceeds ``threshold``."""
    n = len(A)
    for i in range(n):
        for j in range(n):
            V[i, j] = 1.0 if i == j else 0.0
    for _ in range(MAX_SWEEPS):
        rotated = False
        for i in range(n - 1):
            for j in range(i + 1, n):
                coupled = abs(A[i, j]) > threshold
                if any_lane(coupled):
                    _rotate(A, V, i, j, coupled)
                    rotated = True
        if not rotated:
            return


@kernel(inline=True)
def _rotate(A, V, i, j, coupled):
    """One Jacobi rotation that makes ``A[i, j]`` zero (Golub and Van Loan, Matrix Computations, sec. 8.5).

    coupled: where this is false nothing turns.
    """
    ratio = 0.5 * (A[j, j] - A[i, i]) / A[i, j]
    t = 1.0 / (abs(ratio) + sqrt(ratio * ratio + 1.0))
    t = where(coupled, where(ratio < 0.0, -t, t), 0.0)
    c = 1.0 / sqrt(t * t + 1.0)
    s = t * c
    for k in range(len(A)):
        A[k, i], A[k, j] = c * A[k, i] - s * A[k, j], s * A[k, i] + c * A[k, j]
    for k in range(len(A)):
        A[i, k], A[j, k] = c * A[i, k] - s * A[j, k], s * A[i, k] + c * A[j, k]
        V[k, i], V[k, j] = c * V[k, i] - s * V[k, j], s * V[k, i] + c * V[k, j]
