"""The plant's kernels as Python calls them, prepared once for a robot."""

from __future__ import annotations

import numpy as np

from sffr_gym.compile.kernels import entry
from sffr_gym.compile.workspace import new_workspace
from sffr_gym.physics.dynamics import accelerations
from sffr_gym.physics.integrator import advance, step_shapes
from sffr_gym.physics.model import Model, steps_in
from sffr_gym.types import Array


@entry
def advance_plant(model, p, v, tau, duration, steps, integrator, work):
    """Advance the plant; see :func:`sffr_gym.physics.integrator.advance`."""
    advance(model, p, v, tau, duration, steps, integrator, work)


@entry
def evaluate(model, p, v, tau, work, out, held):
    """Solve the equations of motion anywhere; see :func:`sffr_gym.physics.dynamics.accelerations`."""
    accelerations(model, p, v, tau, work, out, held, True)


class Plant:
    """Prepared calls of a robot's kernels, and the memory that they work in.

    Args:
        model: the robot.
        integrator: see ``integrator``.

    Attributes:
        work: memory of the integrator; the equations of motion leave their parts in it.
    """

    def __init__(self, model: Model, integrator: int) -> None:
        self.work = new_workspace(step_shapes(model))
        self._model, self._integrator = model, integrator
        self._p, self._v, self._tau, self._a = (np.zeros(model.at.end) for _ in range(4))
        self._evaluate = evaluate.bind(model, self._p, self._v, self._tau, self.work.dynamics, self._a, False)
        self._advance, self._duration = self._evaluate, 0.0  # another call as soon as a duration is known

    def accelerations(self, p: Array, v: Array, tau: Array) -> Array:
        """Return the accelerations (n,) of a state under generalised forces (n,)."""
        self._p[:], self._v[:], self._tau[:] = p, v, tau
        self._evaluate()
        return self._a.copy()

    def advance(self, p: Array, v: Array, tau: Array, duration: float) -> tuple[Array, Array]:
        """Return the state (n,), (n,) after a duration [s] under held generalised forces (n,)."""
        if duration != self._duration:
            held, steps = (self._p, self._v, self._tau, duration), steps_in(self._model, duration)
            self._advance = advance_plant.bind(self._model, *held, steps, self._integrator, self.work)
            self._duration = duration
        self._p[:], self._v[:], self._tau[:] = p, v, tau
        self._advance()
        return self._p.copy(), self._v.copy()
