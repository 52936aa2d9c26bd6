"""ETDRK4, the default integrator: an exponential Runge-Kutta method of fourth order (Cox and Matthews 2002).

The panels' axial mode (3200 rad/s on the free robot) turns six radians within a control period of 2 ms. The method
splits ``xdd = n(p, v) + W f`` into the elastic force ``f`` of the stiff clamped modes, whose effect ``W`` on all
coordinates is frozen during a step, and the slow rest ``n``. The frozen linear part is solved exactly, undamped when
the panel is; ``n`` enters as a polynomial in time. Nothing is damped that is not damped in the model, and the step is
set by the slow motion alone.
"""

from __future__ import annotations

from typing import NamedTuple

from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.linalg import assign
from sffr_gym.physics.dynamics import accelerations, keep_forces
from sffr_gym.physics.stiff_modes import Frozen, freeze, frozen_shapes, take_out
from sffr_gym.types import Array

STAGES = 4


class Etdrk4(NamedTuple):
    """Memory of a step; n_s is the number of all clamped modes, of which the stiff ones use the first places."""

    p: Array  #: (4, n) positions and velocities at the stages
    v: Array  #: (4, n)
    a: Array  #: (4, n) slow accelerations there
    z: Array  #: (4, n_s) amplitudes and rates of the coupled stiff modes there
    zd: Array  #: (4, n_s)
    g: Array  #: (4, n_s) their slow accelerations
    stiff: Frozen  #: the frozen part


def etdrk4_shapes(model):
    """Shapes of the :class:`Etdrk4` of a robot, whichever of its modes are stiff."""
    n, n_s = model.at.end, model.omega2.size
    return Etdrk4(
        p=(STAGES, n), v=(STAGES, n), a=(STAGES, n), z=(STAGES, n_s), zd=(STAGES, n_s), g=(STAGES, n_s),
        stiff=frozen_shapes(model),
    )  # fmt: skip


@kernel
def etdrk4_step(model, p, v, tau, h, work, forces, step):
    """Advance the plant in place by one step, in the form of polynomial forcing.

    p, v: (n,) positions and velocities; tau: (n,) generalised forces, held; h: step [s].
    work: :class:`sffr_gym.physics.dynamics.Work`; forces: its :class:`sffr_gym.physics.dynamics.Internal`, written.
    step: :class:`Etdrk4`.
    """
    half = 0.5 * h
    for stage in range(STAGES):
        if stage == 0:  # the start
            assign(step.p[0], p)
            assign(step.v[0], v)
        elif stage == 1:  # half a step on, under the slow accelerations of the start
            _constant_forcing(model, step, 0, half, 0, 1)
        elif stage == 2:  # half a step on again, under those of stage 1
            _constant_forcing(model, step, 0, half, 1, 2)
        else:  # a whole step on, from stage 1 under 2 a(stage 2) - a(start)
            _extrapolate(step.a)
            _extrapolate(step.g)
            _constant_forcing(model, step, 1, half, 3, 3)
        held = model.staggered > 0 and stage > 0
        accelerations(model, step.p[stage], step.v[stage], tau, work, step.a[stage], held, stage == 0)
        if stage == 0:
            keep_forces(model, v, work, forces)
            freeze(model, p, v, half, work, step.stiff, step.z[0], step.zd[0])
        take_out(model, step.stiff, step.z[stage], step.zd[stage], step.a[stage], step.g[stage])
    _quadratic_forcing(model, p, v, h, step)


@kernel
def _extrapolate(a):
    """Write ``2 a[2] - a[0]`` into row 3 of ``a`` (4, n)."""
    for c in range(a.shape[1]):
        a[3, c] = 2.0 * a[2, c] - a[0, c]


@kernel
def _constant_forcing(model, step, start, duration, forcing, end):
    """Solve the frozen linear part exactly over ``duration`` [s], the slow accelerations held.

    step: :class:`Etdrk4`; start, end: stages; forcing: the stage whose slow accelerations act.
    """
    p, v, a, z, zd, g = step.p[start], step.v[start], step.a[forcing], step.z[start], step.zd[start], step.g[forcing]
    p_end, v_end, z_end, zd_end = step.p[end], step.v[end], step.z[end], step.zd[end]
    oscillators = step.stiff.oscillators
    square = 0.5 * duration * duration
    for c in range(len(p)):
        p_end[c] = p[c] + duration * v[c] + square * a[c]
        v_end[c] = v[c] + duration * a[c]
    for j in range(len(model.stiff.omega)):
        R = step.stiff.R[j]
        rest = g[j] / oscillators.mu2[j]
        dz, dzd = z[j] - rest, zd[j]
        z_end[j] = rest + oscillators.zz[j] * dz + oscillators.zv[j] * dzd
        zd_end[j] = oscillators.vz[j] * dz + oscillators.vv[j] * dzd
        shift = z_end[j] - z[j] - duration * dzd - square * g[j]
        kick = zd_end[j] - dzd - duration * g[j]
        for c in range(len(p)):
            p_end[c] += R[c] * shift
            v_end[c] += R[c] * kick


@kernel
def _quadratic_forcing(model, p, v, h, step):
    """Solve the frozen linear part over the whole step ``h`` [s] under the quadratic through the stages; in place.

    p, v: (n,) positions and velocities; step: :class:`Etdrk4`, all stages filled.
    """
    a, g, z, zd, oscillators = step.a, step.g, step.z[0], step.zd[0], step.stiff.oscillators
    square = h * h
    for c in range(len(p)):
        middle = 0.5 * (a[1, c] + a[2, c])
        first, second = 4.0 * middle - 3.0 * a[0, c] - a[3, c], 2.0 * (a[0, c] + a[3, c]) - 4.0 * middle
        p[c] += h * v[c] + square * (a[0, c] / 2.0 + first / 6.0 + second / 12.0)
        v[c] += h * (a[0, c] + first / 2.0 + second / 3.0)
    for j in range(len(model.stiff.omega)):
        R, mu2, damping = step.stiff.R[j], oscillators.mu2[j], oscillators.damping[j]
        middle = 0.5 * (g[1, j] + g[2, j])
        first = (4.0 * middle - 3.0 * g[0, j] - g[3, j]) / h
        second = (2.0 * (g[0, j] + g[3, j]) - 4.0 * middle) / square
        # Particular solution A + B t + C t^2, then the transition of a whole step as that of a half squared.
        C = second / mu2
        B = (first - 2.0 * damping * C) / mu2
        A = (g[0, j] - damping * B - 2.0 * C) / mu2
        dz, dzd = z[j] - A, zd[j] - B
        for _ in range(2):
            dz, dzd = (
                oscillators.zz[j] * dz + oscillators.zv[j] * dzd,
                oscillators.vz[j] * dz + oscillators.vv[j] * dzd,
            )
        impulse = h * (g[0, j] + h * (first / 2.0 + h * second / 3.0))
        travel = square * (g[0, j] / 2.0 + h * (first / 6.0 + h * second / 12.0))
        shift = A + h * (B + h * C) + dz - z[j] - h * zd[j] - travel
        kick = B + 2.0 * h * C + dzd - zd[j] - impulse
        for c in range(len(p)):
            p[c] += R[c] * shift
            v[c] += R[c] * kick
