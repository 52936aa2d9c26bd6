"""Compiled loops around the kernels, so that what is timed is thousands of them and not the call from Python."""

from __future__ import annotations

from math import cos, sqrt

from sffr_gym.compile.kernels import entry
from sffr_gym.compile.linalg import assign
from sffr_gym.physics.actuators import generalized_forces, saturate
from sffr_gym.physics.dynamics import accelerations
from sffr_gym.physics.integrator import advance


@entry
def replay(model, forces, period, steps, integrator, work, p, v, every, kept):
    """Advance the plant in place under recorded forces: row k of ``forces`` (n_ticks, n) is held for period k.

    work: :class:`sffr_gym.physics.integrator.StepWork`.
    every: periods between two positions that are written to ``kept`` (rows, n), the first after ``every`` periods.
    """
    for tick in range(len(forces)):
        advance(model, p, v, forces[tick], period, steps, integrator, work)
        if (tick + 1) % every == 0:
            assign(kept[(tick + 1) // every - 1], p)


@entry
def forces_of(model, actuators, commands, applied, forces):
    """Write what the limits leave of commands (n_ticks, n_u) into ``applied``, and its generalised forces (n_ticks, n).

    ``applied`` may be the commands themselves.
    """
    for tick in range(len(commands)):
        saturate(actuators, commands[tick], applied[tick])
        generalized_forces(model, actuators, applied[tick], forces[tick])


@entry
def solve_motion(model, p, v, tau, work, out, count):
    """Solve the equations of motion ``count`` times, each at another heading so that nothing can be left out.

    Arguments as in :func:`sffr_gym.physics.dynamics.accelerations`.
    """
    for _ in range(count):
        p[2] += 1.0e-9
        accelerations(model, p, v, tau, work, out, False, True)


@entry
def multiply_add(x, a, b, passes):
    """Two operations on each of many independent numbers: what the machine can do at best."""
    for _ in range(passes):
        for i in range(len(x)):
            x[i] = x[i] * a + b


@entry
def multiply_add_chain(x, a, b, passes):
    """Two operations on one number, each of which waits for the one before."""
    y = x[0]
    for _ in range(passes):
        for _ in range(len(x)):
            y = y * a + b
    x[0] = y


@entry
def divide(x, a, b, passes):
    """One division of each of many numbers."""
    for _ in range(passes):
        for i in range(len(x)):
            x[i] = a / x[i]


@entry
def square_root(x, a, b, passes):
    """One square root of each of many numbers."""
    for _ in range(passes):
        for i in range(len(x)):
            x[i] = sqrt(x[i])


@entry
def cosine(x, a, b, passes):
    """One cosine of each of many numbers."""
    for _ in range(passes):
        for i in range(len(x)):
            x[i] = cos(x[i])
