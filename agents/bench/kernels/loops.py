"""Compiled loops around the kernels, so that what is timed is thousands of them and not the call from Python."""

from __future__ import annotations

from sffr_gym._jit import assign, kernel
from sffr_gym.actuators import generalized_forces
from sffr_gym.dynamics import accelerations
from sffr_gym.integrator import advance
from sffr_gym.task import view


@kernel
def replay(model, forces, period, steps, integrator, work, p, v, every, kept):
    """Advance the plant in place under recorded forces: row k of ``forces`` (n_ticks, n) is held for period k.

    every: periods between two positions that are written to ``kept`` (rows, n), the first after ``every`` periods.
    """
    for tick in range(len(forces)):
        advance(model, p, v, forces[tick], period, steps, integrator, work)
        if (tick + 1) % every == 0:
            assign(kept[(tick + 1) // every - 1], p)


@kernel
def forces_of(model, actuators, applied, forces):
    """Write the generalised forces (n_ticks, n) of applied commands (n_ticks, n_u)."""
    for tick in range(len(applied)):
        generalized_forces(model, actuators, applied[tick], forces[tick])


@kernel
def solve_motion(model, p, v, tau, work, out, count):
    """Solve the equations of motion ``count`` times, each at another heading so that nothing can be left out."""
    for _ in range(count):
        p[2] += 1.0e-9
        accelerations(model, p, v, tau, work, out)


@kernel
def observe_often(robot, reference, p, v, buffers, obs, signals, count):
    """Observe and measure a state ``count`` times, each at another time."""
    for k in range(count):
        view(robot, reference, k * robot.period, p, v, buffers, obs, signals)
