"""SciPy's integrators on our own right-hand side, started again in every control period, where the forces jump."""

from __future__ import annotations

from time import perf_counter

import numpy as np
from scipy.integrate import solve_ivp

from sffr_gym.compile.workspace import new_workspace
from sffr_gym.physics.dynamics import work_shapes
from sffr_gym.physics.plant import evaluate
from sffr_gym.types import Array
from sffr_workbench.speed.circle import Controller, Course, Drive, shared_coordinates

ABSOLUTE = (
    1.0e-3  # tolerance of an entry of the state, absolute for relative: entries are of order 1 m, 1 rad, or small
)


class ScipyPlant:
    """The plant, stepped by ``solve_ivp``.

    Args:
        course: where it starts.
        method: of ``solve_ivp``.
        rtol: its relative tolerance.

    Attributes:
        y: (2 n,) positions and velocities.
        evaluations: of the right-hand side so far.
    """

    def __init__(self, course: Course, method: str, rtol: float) -> None:
        self._course, self._method, self._rtol = course, method, rtol
        model, n = course.plant.model, len(course.p)
        self._p, self._v, self._tau, self._rate = np.zeros((4, n))
        self._evaluate = evaluate.bind(
            model, self._p, self._v, self._tau, new_workspace(work_shapes(model)), self._rate, False
        )  # fmt: skip
        self.y = np.concatenate([course.p, course.v])
        self.evaluations = 0

    def advance(self, tau: Array) -> None:
        """Advance by a control period under held generalised forces ``tau`` (n,)."""
        self._tau[:], period = tau, self._course.plant.period
        done = solve_ivp(
            self._rates, (0.0, period), self.y, self._method, t_eval=(period,), first_step=period / 2,
            rtol=self._rtol, atol=self._rtol * ABSOLUTE,
        )  # fmt: skip
        self.y = done.y[:, -1]
        self.evaluations += done.nfev

    def replay(self, forces: Array) -> None:
        """Advance under recorded generalised forces (periods, n)."""
        for tau in forces:
            self.advance(tau)

    def drive(self) -> Drive:
        """Drive the whole course under AHSC; only the integrator's part is timed."""
        course, n, total, rows = self._course, len(self._course.p), 0.0, []
        controller = Controller(course)
        for tick in range(course.ticks):
            controller(tick, self.y[:n], self.y[n:])
            start = perf_counter()
            self.advance(controller.tau)
            total += perf_counter() - start
            if (tick + 1) % course.every == 0:
                rows.append(self.y[:n])
        return Drive(total, *shared_coordinates(course, np.array(rows)))

    def _rates(self, t: float, y: Array) -> Array:
        self._p[:], self._v[:] = np.split(y, 2)
        self._evaluate()
        return np.concatenate([self._v, self._rate])
