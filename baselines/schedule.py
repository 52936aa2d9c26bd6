"""Schedules of the virtual damping: every few control periods a network sees the panels and chooses a factor of it.

``B = B_hat rho**a`` with one number ``a`` in [-1, 1] for each damped coordinate of each panel: whatever the network
says, B is not negative and takes energy out of a panel. A schedule may yield to the law while the base is off its path.
What it sees is made of the observation and of what the controller believes, in each panel's own axes, so that one
network can serve all panels.
"""

from __future__ import annotations

from math import hypot, inf, log10, sqrt, tanh
from typing import NamedTuple

import numpy as np

from baselines.regulator import root_acceleration
from sffr_gym._jit import kernel
from sffr_gym.beam import N_TIP, Array, beam, clamped_modes
from sffr_gym.model import IntArray
from sffr_gym.params import Params

N_MODES = 2  # bending modes of the law's panel of one element
# What is seen of each panel: name, largest magnitude. Modes are coordinates of energy [J^(1/2)] about the quasi-static
# shape, divided by the root of the panel's energy; the acceleration is that of the path across the panel. One that is
# pushed to its other side is a mirror image and seen as such, so that the acceleration is never negative.
FEATURES = (
    ("mode1_displacement", 1.0),
    ("mode1_rate", 1.0),
    ("mode2_displacement", 1.0),
    ("mode2_rate", 1.0),
    ("log_amplitude", 3.0),
    ("acceleration", 5.0),
    ("acceleration_rate", 5.0),
)
N_FEATURES = len(FEATURES)
BOUNDS = np.array([bound for _, bound in FEATURES])
LOG_AMPLITUDE = 2 * N_MODES  # place of the feature
FAINT = 1.0e-6  # of the energy scale: motion below it has no direction
SETTLING = 0.5  # s, a rate of the base's error counts as the error that it makes in this time


class Schedule(NamedTuple):
    """What a schedule sees, and the network that decides.

    Attributes:
        hold: control periods from one decision to the next; 0 for no schedule.
        rho: largest factor of the virtual damping; 1 / rho is the smallest.
        tolerance: error of the base [m] at which a decision counts half; infinite if it always counts in full.
        lever: distance [m] at which a turn of the base moves a panel's middle.
        modes: (2, 2) amplitudes of the bending modes for tip displacement and slope [kg^(1/2), kg^(1/2) m].
        omega: (2,) their frequencies [rad/s].
        energy: [J], acceleration: [m/s2], acceleration_rate: [m/s3] at which features have the size 1 (or 0, as logs).
        bounds: (N_FEATURES,) largest magnitudes.
        sizes: (layers + 1,) widths from the input to the output; an input for one panel serves each panel by itself.
        weights: matrix (row by row) and bias of each layer, one after the other.
        relu: 1 for rectified hidden layers, 0 for tanh; squash: 1 if the output goes through tanh, 0 if it is clipped.
    """

    hold: int
    rho: float
    tolerance: float
    lever: float
    modes: Array
    omega: Array
    energy: float
    acceleration: float
    acceleration_rate: float
    bounds: Array
    sizes: IntArray
    weights: Array
    relu: float
    squash: float


class ScheduleWork(NamedTuple):
    """Buffers of a decision: features of all panels, hidden layers (2, width), outputs."""

    seen: Array
    hidden: Array
    decision: Array


def make_schedule(prior: Params) -> Schedule:
    """A schedule that never decides, with all that is needed to see what the controller believes."""
    panel, path = prior.panel, prior.path
    element = beam(panel.mass, panel.length, panel.EI, panel.E * panel.area, elements=1)
    modes = clamped_modes(element, axial_cut=np.inf, bending_cut=np.inf)
    bending = slice(modes.n_axial, None)
    return Schedule(
        hold=0,
        rho=1.0,
        tolerance=inf,
        lever=max((hypot(*mount.root) for mount in panel.mounts), default=0.0) + 0.5 * panel.length,
        modes=np.ascontiguousarray((modes.shapes.T @ element.M_ff)[bending, 1:]),
        omega=modes.omega[bending].copy(),
        energy=prior.reward.vibration.scale,
        acceleration=path.speed**2 / path.radius,
        acceleration_rate=path.speed**3 / path.radius**2,
        bounds=BOUNDS.copy(),
        sizes=np.zeros(2, dtype=np.int64),
        weights=np.zeros(0),
        relu=0.0,
        squash=0.0,
    )


@kernel(allocates=True)
def schedule_workspace(law):
    """Allocate the buffers of :func:`reschedule` for a :class:`closed_loop.Law`."""
    n_p = len(law.allocation)
    width = np.max(law.schedule.sizes)
    return ScheduleWork(np.zeros(n_p * N_FEATURES), np.zeros((2, width)), np.zeros(n_p * N_TIP))


@kernel(inline=True)
def look(law, obs, seen):
    """Write what a schedule sees, (n_p N_FEATURES,), panel by panel in the order of ``FEATURES``."""
    schedule, n_p = law.schedule, len(law.allocation)
    for i in range(n_p):
        at, energy = i * N_FEATURES, 0.0
        q = law.layout.elastic + N_TIP * i
        qd = law.layout.elastic + N_TIP * (n_p + i)
        push, push_rate = root_acceleration(law.regulator, obs, law.layout.reference, i)
        side = -1.0 if push < 0.0 else 1.0
        for m in range(N_MODES):
            x = xd = 0.0
            for j in range(1, N_TIP):
                x += schedule.modes[m, j - 1] * (obs[q + j] - law.regulator.shape[j] * push)
                xd += schedule.modes[m, j - 1] * (obs[qd + j] - law.regulator.shape[j] * push_rate)
            x *= schedule.omega[m]
            energy += 0.5 * (x * x + xd * xd)
            seen[at + 2 * m], seen[at + 2 * m + 1] = x, xd
        size = sqrt(2.0 * (energy + FAINT * schedule.energy))
        for k in range(2 * N_MODES):
            seen[at + k] *= side / size
        seen[at + LOG_AMPLITUDE] = 0.5 * log10(energy / schedule.energy + FAINT)
        seen[at + LOG_AMPLITUDE + 1] = side * push / schedule.acceleration
        seen[at + LOG_AMPLITUDE + 2] = side * push_rate / schedule.acceleration_rate
        for k in range(N_FEATURES):
            seen[at + k] = min(max(seen[at + k], -schedule.bounds[k]), schedule.bounds[k])


@kernel(inline=True)
def stretch(law, obs, decision, factor):
    """Write the factors ``rho**(w a)`` (n_p, 3) for decisions ``a`` (n_p n_d,): one for each damped coordinate.

    The weight ``w`` is 1 on the path, and falls to 0 with the error of the base over the schedule's tolerance: while
    the base is thrown about, the panels are driven and not in the free vibration that a schedule knows.
    """
    schedule, b = law.schedule, law.layout.base
    shift = sqrt(obs[b] * obs[b] + obs[b + 1] * obs[b + 1]) + schedule.lever * abs(obs[b + 2])
    drift = sqrt(obs[b + 3] * obs[b + 3] + obs[b + 4] * obs[b + 4]) + schedule.lever * abs(obs[b + 5])
    error = (shift + SETTLING * drift) / schedule.tolerance
    weight = 1.0 / (1.0 + error * error)
    at = 0
    for i in range(len(law.allocation)):
        for k in range(N_TIP):
            factor[i, k] = 1.0
            if law.suppression.damped[k] > 0.0:
                factor[i, k] = schedule.rho ** (weight * min(max(decision[at], -1.0), 1.0))
                at += 1


@kernel
def reschedule(law, obs, work, factor):
    """Let the network choose the factors (n_p, 3) of the virtual damping for an observation.

    Not inlined, since it is called seldom, and its code would slow down the loop around it.
    """
    schedule = law.schedule
    look(law, obs, work.seen)
    n_in, n_out = schedule.sizes[0], schedule.sizes[-1]
    for block in range(len(work.seen) // n_in):
        _propagate(
            schedule, work.seen[block * n_in : (block + 1) * n_in], work.hidden,
            work.decision[block * n_out : (block + 1) * n_out],
        )  # fmt: skip
    stretch(law, obs, work.decision, factor)


@kernel(inline=True)
def _propagate(schedule, seen, hidden, decision):
    """Write the network's output."""
    sizes, weights = schedule.sizes, schedule.weights
    last, at = len(sizes) - 2, 0
    for layer in range(last + 1):
        n_in, n_out = sizes[layer], sizes[layer + 1]
        for row in range(n_out):
            value = weights[at + n_out * n_in + row]
            for k in range(n_in):
                value += weights[at + row * n_in + k] * (seen[k] if layer == 0 else hidden[(layer - 1) % 2, k])
            if layer < last:
                hidden[layer % 2, row] = max(value, 0.0) if schedule.relu > 0.0 else tanh(value)
            else:
                decision[row] = tanh(value) if schedule.squash > 0.0 else min(max(value, -1.0), 1.0)
        at += n_out * (n_in + 1)
