"""The classical Runge-Kutta method of fourth order, beside which the default integrator is measured."""

from __future__ import annotations

from typing import NamedTuple

from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.linalg import assign
from sffr_gym.physics.dynamics import accelerations, keep_forces
from sffr_gym.types import Array


class Rk4(NamedTuple):
    """Memory of a step, (n,) each."""

    p: Array  #: positions and velocities at the present stage
    v: Array
    a: Array  #: accelerations there
    sum_p: Array  #: weighted sums of the rates
    sum_v: Array


def rk4_shapes(model):
    """Shapes of the :class:`Rk4` of a robot."""
    n = model.at.end
    return Rk4((n,), (n,), (n,), (n,), (n,))


@kernel
def rk4_step(model, p, v, tau, h, work, forces, step):
    """Advance the plant in place by one step; stable only while ``h`` times the largest frequency stays below 2.8.

    p, v: (n,) positions and velocities; tau: (n,) generalised forces, held; h: step [s].
    work: :class:`sffr_gym.physics.dynamics.Work`; forces: its :class:`sffr_gym.physics.dynamics.Internal`, written.
    step: :class:`Rk4`.
    """
    assign(step.p, p)
    assign(step.v, v)
    step.sum_p[:] = 0.0
    step.sum_v[:] = 0.0
    for stage in range(4):
        accelerations(model, step.p, step.v, tau, work, step.a, model.staggered > 0 and stage > 0, stage == 0)
        if stage == 0:
            keep_forces(model, v, work, forces)
        weight = h / 6.0 if stage in (0, 3) else h / 3.0
        ahead = h if stage == 2 else 0.5 * h
        for i in range(len(p)):
            step.sum_p[i] += weight * step.v[i]
            step.sum_v[i] += weight * step.a[i]
            step.p[i] = p[i] + ahead * step.v[i]
            step.v[i] = v[i] + ahead * step.a[i]
    for i in range(len(p)):
        p[i] += step.sum_p[i]
        v[i] += step.sum_v[i]
