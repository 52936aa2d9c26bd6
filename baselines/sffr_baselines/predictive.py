"""Model predictive control of the panels under the limits of their piezos: what the regulator would do if it knew them.

The model, the weights and, beyond the horizon, the law are the regulator's (:mod:`sffr_baselines.regulator`). Its own
volts ``-K x`` are optimal while no limit is met, so that the unknowns are deviations ``d`` of the volts from those that
it would apply along its own trajectory: with ``P`` of the same Riccati equation and ``S = R + G'PG`` the cost of all
time to come is ``x'Px`` plus the sum of ``c'Sc`` over the periods, ``c = d + K (x - x_lqr)``, a quadratic form of
``d`` alone, ``d'Hd`` (the closed-loop paradigm). Deviations are held over blocks of periods that grow towards the
horizon (move blocking), and the mean volts of each block must keep the limits: a box for each ``d``. Where no mean
exceeds a limit the solution is ``d = 0``, without any search; otherwise a fast gradient method finds it, whose matrix
is always the same.

Sources: Rossiter, Kouvaritakis and Rice, *A numerically robust state-space approach to stable-predictive control
strategies* (1998); Scokaert and Rawlings, *Constrained linear quadratic regulation* (1998); Richter, Jones and Morari,
*Computational complexity certification for real-time model-predictive control with input constraints based on the fast
gradient method* (2012).
"""

from __future__ import annotations

from math import ceil, log, pi, sqrt
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag, eigvalsh, solve_discrete_are

from sffr_baselines.panel_reaction import BENDING, N_BENDING
from sffr_baselines.regulator import sampled_bending, with_panel, worth_of_effort
from sffr_baselines.settings import RegulatorWeights
from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.lanes import any_lane, where
from sffr_gym.config.params import Params
from sffr_gym.config.sections import Panel
from sffr_gym.physics.beam import clamped_modes, one_element_beam
from sffr_gym.physics.each_panel import of_each_panel
from sffr_gym.types import Array

HOLDS_A_CYCLE = 480  # solutions during a swing of the first mode
BLOCKS = (1, 2, 4, 8, *[16] * 20)  # their lengths in holds: two thirds of a swing; a longer horizon changes nothing
ACCURACY = 1.0e-6  # of a solution, by the method's rate of convergence
MOST_STEPS = 500  # of the method: a price of volts that needs more is next to nothing
NO_REACH = 1.0e-9  # of the strongest channel


class Predictive(NamedTuple):
    """The constant parts of each panel's problem, in unknowns ``z = d / scale`` that make the Hessian's diagonal even.

    The volts of channels that bend a panel alike, or opposite to each other, are one unknown of ``n_g`` in each block.
    """

    hold: int  #: control periods from one solution to the next; 0 for a law without
    steps: int  #: of the fast gradient method
    momentum: float  #: of it
    share: Array  #: (n_p, n_c, n_g) 1 or -1 where a channel has that unknown, else 0
    scale: Array  #: (n_p, n) volts for a unit of each unknown
    regulator: Array  #: (n_p, n, 4) the regulator's mean volts in each block, for a unit deviation of q5, q6 and rates
    hessian: Array  #: (n_p, n, n) with the largest eigenvalue 1
    limit: float  #: of a channel [V]


class Plan(NamedTuple):
    """Memory of a solution."""

    low: Array  #: (n,) bounds of the unknowns
    high: Array  #: (n,)
    guess: Array  #: (n,) extrapolated unknowns
    slope: Array  #: (n,) of the cost there
    found: Array  #: (n,)


def plan_shapes(predictive):
    """Shapes of the :class:`Plan` of a :class:`Predictive`."""
    n = predictive.scale.shape[1]
    return Plan((n,), (n,), (n,), (n,), (n,))


def no_prediction(n_p: int, n_c: int) -> Predictive:
    """Return that of a law without, for so many panels and channels of each."""
    share, scale = np.zeros((n_p, n_c, 0)), np.zeros((n_p, 0))
    regulator, hessian = np.zeros((n_p, 0, 2 * N_BENDING)), np.zeros((n_p, 0, 0))
    return Predictive(0, 0, 0.0, share, scale, regulator, hessian, 0.0)


def make_predictive(prior: Params, K_PZ: Array, weights: RegulatorWeights) -> Predictive:
    """Set up the problem for what the controller believes.

    Args:
        prior: the controller's parameters.
        K_PZ: (n_p, 3, n_c) tip forces for a volt on each channel.
        weights: of the regulator that it extends.
    """
    n_p, _, n_c = K_PZ.shape
    share = alike(K_PZ[0]) if n_p else np.zeros((n_c, 0))
    if not share.any():
        return no_prediction(n_p, n_c)
    hold = cycle_hold(prior)
    forces = {panel.numbers: force for panel, force in zip(prior.panel.each, K_PZ, strict=True)}

    def own(panel: Panel) -> tuple[Array, Array, Array, float]:
        """Return scale, regulator, scaled Hessian and the root of its conditioning of one panel."""
        robot, force = with_panel(prior, panel), forces[panel.numbers]
        effort = weights.effort * worth_of_effort(robot, force, weights.swing)
        hessian, regulator = problem(robot, force @ share, effort * share.T @ share, hold)
        scale = 1.0 / np.sqrt(np.diag(hessian))
        scaled = scale[:, None] * hessian * scale
        values = eigvalsh(scaled)
        return scale, regulator, scaled / values[-1], sqrt(values[0] / values[-1])

    scales, regulators, hessians, roots = zip(*of_each_panel(prior, own), strict=True)
    root = min(roots)  # the rate of the panel whose problem is the worst conditioned holds for all
    return Predictive(
        hold=hold,
        steps=min(ceil(-log(ACCURACY) / root), MOST_STEPS),
        momentum=(1.0 - root) / (1.0 + root),
        share=np.tile(share, (n_p, 1, 1)),
        scale=np.array(scales),
        regulator=np.array(regulators),
        hessian=np.array(hessians),
        limit=prior.actuators.piezo.voltage,
    )


def cycle_hold(prior: Params) -> int:
    """Return how many control periods a solution is held for: a part of a swing of the first mode, one at least."""
    modes = of_each_panel(prior, lambda panel: clamped_modes(one_element_beam(panel), 0.0, np.inf))
    fastest = max(float(each.omega[0]) for each in modes)
    return max(1, round(2.0 * pi / fastest / HOLDS_A_CYCLE / prior.control.period))


def alike(K_PZ: Array) -> Array:
    """Return which channels share an unknown (n_c, n_g), 1 or -1: those that bend a panel alike, or opposite.

    Their volts are the same at the optimum, or opposite, since the cost is strictly convex. A channel that does not
    bend a panel has none.

    Args:
        K_PZ: (3, n_c) tip forces for a volt on each channel.
    """
    bends = K_PZ[BENDING]
    tiny = NO_REACH * max(float(np.abs(bends).max()), 1.0e-300)
    found: list[Array] = []
    columns: list[Array] = []
    for c, own in enumerate(bends.T):
        if np.abs(own).max() <= tiny:
            continue
        for known, column in zip(found, columns, strict=True):
            sign = 1.0 if known @ own > 0.0 else -1.0
            if np.abs(own - sign * known).max() <= tiny:
                column[c] = sign
                break
        else:
            found.append(own)
            columns.append(np.eye(bends.shape[1])[c])
    return np.column_stack(columns) if columns else np.zeros((bends.shape[1], 0))


def problem(prior: Params, K_PZ: Array, R: Array, hold: int) -> tuple[Array, Array]:
    """Return the Hessian (n, n) and the regulator's mean volts (n, 4) of each block for a unit of the state.

    Args:
        prior: panel and control period as the controller believes them.
        K_PZ: (3, n_g) tip forces for a volt of each unknown.
        R: (n_g, n_g) price of their squares over a second [J/V2].
        hold: control periods of the shortest block.
    """
    M, K, A, G = sampled_bending(prior)
    G = G @ K_PZ[BENDING]
    n_x, n_g = G.shape
    n = len(BLOCKS) * n_g
    P = solve_discrete_are(A, G, block_diag(K, M) / 2.0, R)
    S = R + G.T @ P @ G
    gain = np.linalg.solve(S, G.T @ P @ A)
    # A hold of the deviation [x - x_lqr, d]: what it costs, and where it leads.
    step = np.block([[A, G], [np.zeros((n_g, n_x)), np.eye(n_g)]])
    off = np.hstack([gain, np.eye(n_g)])
    price, held = np.zeros((n_x + n_g, n_x + n_g)), np.eye(n_x + n_g)
    # The same of the regulator's own trajectory, and its mean volts.
    closed, own, mean = A - G @ gain, np.eye(n_x), np.zeros((n_g, n_x))
    for _ in range(hold):
        price += held.T @ off.T @ S @ off @ held
        mean -= gain @ own / hold
        held, own = step @ held, closed @ own
    hessian, regulator = np.zeros((n, n)), np.zeros((n, n_x))
    deviation, free = np.zeros((n_x, n)), np.eye(n_x)
    for block, holds in enumerate(BLOCKS):
        rows = slice(block * n_g, (block + 1) * n_g)
        unknown = np.zeros((n_g, n))
        unknown[:, rows] = np.eye(n_g)
        for _ in range(holds):
            both = np.vstack([deviation, unknown])
            hessian += both.T @ price @ both
            deviation = (held @ both)[:n_x]
            regulator[rows] += mean @ free / holds
            free = own @ free
    return hessian, regulator


@kernel
def predict(law, i, x, wait, plan, work, volts):
    """Add to the regulator's ``volts`` (n_c,) of panel ``i`` what its limits ask for, and keep these limits.

    law: :class:`Predictive`; x: (4,) deviation of q5, q6 and their rates from the quasi-static motion.
    wait: control periods until the next solution; plan: (n,) the last one, changed in place; work: :class:`Plan`.
    """
    excess = 0.0
    for k in range(len(plan)):
        mean = 0.0
        for j in range(len(x)):
            mean += law.regulator[i, k, j] * x[j]
        work.low[k], work.high[k] = (-law.limit - mean) / law.scale[i, k], (law.limit - mean) / law.scale[i, k]
        excess = max(excess, abs(mean) - law.limit)
    due = wait <= 0.0
    limited = where(due, excess, -1.0) > 0.0
    if any_lane(limited):
        solve(law.hessian[i], law.steps, law.momentum, plan, work)
    for k in range(len(plan)):
        plan[k] = where(limited, work.found[k], where(due, 0.0, plan[k]))
    n_c, n_g = law.share.shape[1:]
    for c in range(n_c):
        for g in range(n_g):
            volts[c] += law.share[i, c, g] * law.scale[i, g] * plan[g]
        volts[c] = min(max(volts[c], -law.limit), law.limit)


@kernel(inline=False)
def solve(hessian, steps, momentum, start, work):
    """Write the ``work.found`` (n,) between ``work.low`` and ``work.high`` that minimises ``z' hessian z / 2``.

    hessian: (n, n) symmetric, positive definite, largest eigenvalue 1; start: (n,) where to begin.
    steps, momentum: how often to go down the slope, and how far to extrapolate (Nesterov's constant scheme).
    """
    n = len(start)
    for k in range(n):
        work.found[k] = min(max(start[k], work.low[k]), work.high[k])
        work.guess[k] = work.found[k]
    for _ in range(steps):
        for k in range(n):
            work.slope[k] = 0.0
        for j in range(n):
            guess = work.guess[j]
            for k in range(n):
                work.slope[k] += hessian[j, k] * guess
        for k in range(n):
            better = min(max(work.guess[k] - work.slope[k], work.low[k]), work.high[k])
            work.guess[k] = better + momentum * (better - work.found[k])
            work.found[k] = better
