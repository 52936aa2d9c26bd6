"""Steps of the plant under held actuator forces, by one of two methods; see :mod:`etdrk4` and :mod:`rk4`."""

from __future__ import annotations

from typing import NamedTuple

from sffr_gym.compile.kernels import kernel
from sffr_gym.physics.dynamics import Internal, Work, internal_shapes, work_shapes
from sffr_gym.physics.etdrk4 import Etdrk4, etdrk4_shapes, etdrk4_step
from sffr_gym.physics.rk4 import Rk4, rk4_shapes, rk4_step

ETDRK4, RK4 = 0, 1
INTEGRATORS = {"etdrk4": ETDRK4, "rk4": RK4}


class StepWork(NamedTuple):
    """Memory of :func:`advance`."""

    dynamics: Work  #: of the equations of motion
    forces: Internal  #: internal forces at the start of the last step
    etdrk4: Etdrk4  #: of the methods
    rk4: Rk4


def step_shapes(model):
    """Shapes of the :class:`StepWork` of a robot."""
    return StepWork(work_shapes(model), internal_shapes(model), etdrk4_shapes(model), rk4_shapes(model))


@kernel
def advance(model, p, v, tau, duration, steps, integrator, work):
    """Advance the plant in place by ``duration`` [s] in ``steps`` equal steps.

    p, v: (n,) positions and velocities; tau: (n,) generalised forces, held; see :func:`dynamics.accelerations`.
    integrator: ``ETDRK4`` or ``RK4``; work: :class:`StepWork`.
    """
    h = duration / steps
    for _ in range(steps):
        if integrator == RK4:
            rk4_step(model, p, v, tau, h, work.dynamics, work.forces, work.rk4)
        else:
            etdrk4_step(model, p, v, tau, h, work.dynamics, work.forces, work.etdrk4)
