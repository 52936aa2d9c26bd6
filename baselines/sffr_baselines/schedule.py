"""Schedules of a law's damping: every few control periods a network sees the panels and chooses a factor of it.

``B = B_hat rho**a`` with one number ``a`` in [-1, 1] for each damped coordinate of each panel: whatever the network
says, B is not negative and takes energy out of a panel. Where a law feeds the panels' state back instead, one number
multiplies the feedback of a panel as a whole, which a regulator bears; where it feeds their reaction forward, one more
lowers the share of it. A schedule may yield to the law while the base is off its path. What it sees is made of the
observation, of what the controller believes and of what the law last asked for, in each panel's own axes, so that one
network can serve all panels. With a memory it also sees what earlier decisions saw.
"""

from __future__ import annotations

from math import hypot, inf, log10, sqrt, tanh
from typing import NamedTuple

import numpy as np

from sffr_baselines.panel_reaction import N_BENDING
from sffr_baselines.regulator import deviate, root_acceleration
from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.linalg import length
from sffr_gym.config.params import Params
from sffr_gym.config.sections import Panel
from sffr_gym.physics.beam import N_TIP, clamped_modes, one_element_beam
from sffr_gym.physics.each_panel import of_each_panel
from sffr_gym.types import Array, IntArray

N_MODES = 2  # bending modes of the law's panel of one element
# What is seen of each panel: name, largest magnitude. Modes are coordinates of energy [J^(1/2)] about the quasi-static
# shape, divided by the root of the panel's energy; the acceleration is that of the path across the panel. One that is
# pushed to its other side is a mirror image and seen as such, so that the acceleration is never negative. Products of
# the coordinates say where in their swing the modes are: these decide when a damping takes most. Demands are what the
# law last asked of its actuators over their limits, as log10: above 0 they saturated.
FEATURES = (
    ("mode1_displacement", 1.0),
    ("mode1_rate", 1.0),
    ("mode2_displacement", 1.0),
    ("mode2_rate", 1.0),
    ("log_amplitude", 3.0),
    ("acceleration", 5.0),
    ("acceleration_rate", 5.0),
    ("mode1_potential_less_kinetic", 1.0),
    ("mode1_displacement_by_rate", 1.0),
    ("mode2_potential_less_kinetic", 1.0),
    ("mode2_displacement_by_rate", 1.0),
    ("displacement1_by_displacement2", 1.0),
    ("displacement1_by_rate2", 1.0),
    ("rate1_by_displacement2", 1.0),
    ("rate1_by_rate2", 1.0),
    ("piezo_demand", 2.0),
    ("thruster_or_joint_demand", 2.0),
    ("base_error", 3.0),
)
N_FEATURES = len(FEATURES)
BOUNDS = np.array([bound for _, bound in FEATURES])
LOG_AMPLITUDE, ACCELERATION, ACCELERATION_RATE = range(2 * N_MODES, 2 * N_MODES + 3)  # places of the features
PHASES, CROSSED = 2 * N_MODES + 3, 4 * N_MODES + 3  # where the products begin: of a mode with itself, of both
PIEZO_DEMAND, OTHER_DEMAND, BASE_ERROR = range(N_FEATURES - 3, N_FEATURES)
FAINT = 1.0e-6  # of the energy scale: motion below it has no direction
LEAST_DEMAND = 1.0e-2  # of a limit: less counts as none
OFF_PATH = 3.0e-3  # m, error of the base whose logarithm is 0; on the path AHSC keeps it below 0.7 mm
LEAST_ERROR = 1.0e-3  # of it
SETTLING = 0.5  # s, a rate of the base's error counts as the error that it makes in this time


class Schedule(NamedTuple):
    """What a schedule sees, and the network that decides.

    Attributes:
        hold: control periods from one decision to the next; 0 for no schedule.
        stack: decisions whose features the network sees, this one's and those before; 0 for no schedule.
        rho: largest factor of the damping, or of the panels' feedback; 1 / rho is the smallest.
        tolerance: error of the base [m] at which a decision counts half; infinite if it always counts in full.
        lever: distance [m] at which a turn of the base moves a panel's middle.
        modes: (n_p, 2, 2) amplitudes of the bending modes for tip displacement and slope [kg^(1/2), kg^(1/2) m].
        omega: (n_p, 2) their frequencies [rad/s].
        energy: [J], acceleration: [m/s2], acceleration_rate: [m/s3] at which features have the size 1 (or 0, as logs).
        bounds: (N_FEATURES,) largest magnitudes.
        sizes: (layers + 1,) widths from the input to the output; an input for one panel serves each panel by itself.
        weights: matrix (row by row) and bias of each layer, one after the other.
        relu: hidden layers are rectified, else tanh; squash: the output goes through tanh, else it is clipped.
    """

    hold: int
    stack: int
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
    relu: bool
    squash: bool


class ScheduleWork(NamedTuple):
    """Memory of a decision."""

    hidden: Array  #: (2, width) two layers in turn
    decision: Array  #: (n_p 4,) outputs


def make_schedule(prior: Params) -> Schedule:
    """Return a schedule that never decides, with all that its features take from what the controller believes."""
    path, n_p = prior.path, prior.n_panels
    modes, omega = zip(*of_each_panel(prior, _bending_modes), strict=True)
    reaches = zip(prior.panel.mounts, prior.panel.each, strict=True)
    return Schedule(
        hold=0,
        stack=0,
        rho=1.0,
        tolerance=inf,
        lever=max((hypot(*mount.root) + 0.5 * panel.length for mount, panel in reaches), default=0.0),
        modes=np.array(modes)[:n_p],
        omega=np.array(omega)[:n_p],
        energy=prior.reward.vibration.scale,
        acceleration=path.acceleration,
        acceleration_rate=path.acceleration_rate,
        bounds=BOUNDS.copy(),
        sizes=np.zeros(2, dtype=np.int64),
        weights=np.zeros(0),
        relu=False,
        squash=False,
    )


def _bending_modes(panel: Panel) -> tuple[Array, Array]:
    """Return a panel's :attr:`Schedule.modes` (2, 2) and ``omega`` (2,)."""
    element = one_element_beam(panel)
    modes = clamped_modes(element, axial_cut=np.inf, bending_cut=np.inf)
    bending = slice(modes.n_axial, None)
    return (modes.shapes.T @ element.M_ff)[bending, 1:], modes.omega[bending]


def schedule_shapes(law):
    """Shapes of the :class:`ScheduleWork` of a :class:`closed_loop.Law`."""
    n_p, width = len(law.allocation), 1
    for k in range(len(law.schedule.sizes)):
        width = max(width, law.schedule.sizes[k])
    return ScheduleWork(hidden=(2, width), decision=(n_p * (N_TIP + 1),))


@kernel
def decisions_of_panel(law):
    """Return how many numbers a schedule chooses for each panel.

    One for each damped coordinate, or for the regulator's feedback, and one for a reaction that is fed forward.
    """
    count = 1 if law.reaction.active else 0
    if law.regulator.active:
        return count + 1
    for k in range(N_TIP):
        if law.suppression.damped[k] > 0.0:
            count += 1
    return count


@kernel
def base_off_path(law, obs):
    """Error of the base [m], where turns count as the shifts and rates as the errors that they make."""
    schedule, at = law.schedule, law.at
    e, ed = at.base_error, at.base_error_rate
    shift = length(obs[e], obs[e + 1]) + schedule.lever * abs(obs[at.yaw_error])
    drift = length(obs[ed], obs[ed + 1]) + schedule.lever * abs(obs[at.yaw_error_rate])
    return shift + SETTLING * drift


@kernel
def see(law, obs, demand, seen):
    """Put the features of an observation before those of earlier ones, panel by panel in the order of ``FEATURES``.

    law: :class:`closed_loop.Law`; obs: (n_o,); demand: (n_p + 1,) and seen: (n_p stack N_FEATURES,), which is changed,
    see :class:`control_law.LawState`.
    """
    n_p = len(law.allocation)
    width = len(seen) // n_p
    for i in range(n_p):
        for k in range((i + 1) * width - 1, i * width + N_FEATURES - 1, -1):
            seen[k] = seen[k - N_FEATURES]
    _write_features(law, obs, demand, seen)


@kernel
def _write_features(law, obs, demand, seen):
    """Write the features of an observation at the beginning of each panel's; arguments as for :func:`see`."""
    schedule, n_p = law.schedule, len(law.allocation)
    off_path = log10(base_off_path(law, obs) / OFF_PATH + LEAST_ERROR)
    for i in range(n_p):
        first = i * (len(seen) // n_p)
        own, energy = seen[first : first + N_FEATURES], 0.0
        push, push_rate = root_acceleration(law.regulator, law.at, obs, i)
        side = -1.0 if push < 0.0 else 1.0
        deviation = own[CROSSED : CROSSED + 2 * N_BENDING]  # until the products are written there
        deviate(law.regulator, law.at, obs, i, deviation)
        for m in range(N_MODES):
            x = xd = 0.0
            for j in range(N_BENDING):
                x += schedule.modes[i, m, j] * deviation[j]
                xd += schedule.modes[i, m, j] * deviation[N_BENDING + j]
            x *= schedule.omega[i, m]
            energy += 0.5 * (x * x + xd * xd)
            own[2 * m], own[2 * m + 1] = x, xd
        size = sqrt(2.0 * (energy + FAINT * schedule.energy))
        for k in range(2 * N_MODES):
            own[k] *= side / size
        _write_products(own)
        own[LOG_AMPLITUDE] = 0.5 * log10(energy / schedule.energy + FAINT)
        own[ACCELERATION] = side * push / schedule.acceleration
        own[ACCELERATION_RATE] = side * push_rate / schedule.acceleration_rate
        own[PIEZO_DEMAND] = log10(demand[i] + LEAST_DEMAND)
        own[OTHER_DEMAND] = log10(demand[n_p] + LEAST_DEMAND)
        own[BASE_ERROR] = off_path
        for k in range(N_FEATURES):
            own[k] = min(max(own[k], -schedule.bounds[k]), schedule.bounds[k])


@kernel
def _write_products(own):
    """Write what the products of a panel's coordinates are, of unit energy in all; own: (N_FEATURES,)."""
    for m in range(N_MODES):
        x, xd = own[2 * m], own[2 * m + 1]
        own[PHASES + 2 * m], own[PHASES + 2 * m + 1] = x * x - xd * xd, 2.0 * x * xd
    for j in range(N_MODES):
        for k in range(N_MODES):
            own[CROSSED + N_MODES * j + k] = 2.0 * own[j] * own[2 + k]


@kernel
def apply_decision(law, obs, decision, factor, share):
    """Write the factors ``rho**(w a)`` (n_p, 3) for decisions ``a`` (n_p n_d,) of :func:`decisions_of_panel`.

    A regulator's counts for both bending coordinates. The one of the reaction sets the ``share`` (n_p,) of it, at most
    1: ``rho**min(w a, 0)``.

    The weight ``w`` is 1 on the path, and falls to 0 with the error of the base over the schedule's tolerance: while
    the base is thrown about, the panels are driven and not in the free vibration that a schedule knows.
    """
    schedule = law.schedule
    error = base_off_path(law, obs) / schedule.tolerance
    weight = 1.0 / (1.0 + error * error)
    count = 0
    for i in range(len(law.allocation)):
        for k in range(N_TIP):
            factor[i, k] = 1.0
            if law.suppression.damped[k] > 0.0 and not law.regulator.active:
                factor[i, k] = schedule.rho ** (weight * min(max(decision[count], -1.0), 1.0))
                count += 1
        if law.regulator.active:
            factor[i, 1] = factor[i, 2] = schedule.rho ** (weight * min(max(decision[count], -1.0), 1.0))
            count += 1
        share[i] = 1.0
        if law.reaction.active:
            share[i] = schedule.rho ** (weight * min(max(decision[count], -1.0), 0.0))
            count += 1


@kernel(inline=False)
def update_schedule(law, obs, state, work):
    """Let the network choose ``state.factor`` (n_p, 3) and ``state.share`` (n_p,) for an observation.

    law: :class:`control_law.Law`; state: its :class:`control_law.LawState`; work: :class:`ScheduleWork`.

    Not inlined, since it is called seldom, and its code would slow down the loop around it.
    """
    schedule = law.schedule
    see(law, obs, state.demand, state.seen)
    n_in, n_out = schedule.sizes[0], schedule.sizes[-1]
    for block in range(len(state.seen) // n_in):
        seen = state.seen[block * n_in : (block + 1) * n_in]
        _propagate(schedule, seen, work.hidden, work.decision[block * n_out : (block + 1) * n_out])
    apply_decision(law, obs, work.decision, state.factor, state.share)


@kernel
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
                hidden[layer % 2, row] = max(value, 0.0) if schedule.relu else tanh(value)
            else:
                decision[row] = tanh(value) if schedule.squash else value
        at += n_out * (n_in + 1)
