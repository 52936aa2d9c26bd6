"""An active optimum for the panels: linear-quadratic feedback about the quasi-static shape, sampled as the loop is.

Not in the paper. Where virtual damping can only take energy out of a panel, this law pushes and pulls its tip as a
linear-quadratic regulator of the clamped, one-element panel would, and tells what active control can gain at most.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag, expm, solve_discrete_are

from sffr_baselines.suppression import COORDINATES, damped_coordinates
from sffr_gym.compile.kernels import kernel
from sffr_gym.config.params import Params
from sffr_gym.physics.beam import N_TIP, Beam, one_element_beam
from sffr_gym.physics.kinematics import rotation
from sffr_gym.physics.model import Model
from sffr_gym.task.reference import Reference
from sffr_gym.types import Array

BENDING = slice(1, N_TIP)  # the tip's transverse displacement and slope, q5 and q6


class Regulator(NamedTuple):
    """State feedback of each panel's tip about its quasi-static motion; one law for all panels."""

    active: bool  #: whether the law has one; the paper's laws have none
    gain: Array  #: (3, 6) tip force for a unit deviation of the tip's coordinates and of their rates
    shape: Array  #: (3,) tip of a panel at rest whose root accelerates across it by 1 m/s2
    across: Array  #: (n_p, 2) direction across each undeformed panel, reference axes
    lever: Array  #: (n_p,) component of each panel's root along it, from the reference's centre [m]


def make_regulator(prior: Params, model: Model, reference: Reference, effort_weight: float | None) -> Regulator:
    """Design the regulator for what the controller believes.

    Args:
        prior: the controller's parameters.
        model: the same as arrays.
        reference: the formation that the task asks for.
        effort_weight: price of a squared volt, as energy [J/V2]; None for a law without regulator.
    """
    turn = rotation(reference.yaw)
    across = np.column_stack([-model.panel_axis[:, 1], model.panel_axis[:, 0]]) @ turn.T
    root = np.array([reference.base_x, reference.base_y]) + model.panel_root @ turn.T
    return Regulator(
        active=effort_weight is not None,
        gain=np.zeros((N_TIP, 2 * N_TIP)) if effort_weight is None else optimal_gain(prior, effort_weight),
        shape=_quasi_static_shape(one_element_beam(prior.panel)),
        across=across,
        lever=np.asarray((across * root).sum(axis=1)),
    )


def optimal_gain(prior: Params, effort_weight: float) -> Array:
    """Gain (3, 6) that minimises the time integral of a panel's energy and of ``effort_weight`` times squared volts.

    The state is the deviation ``x`` of q5 and q6 from the quasi-static shape and its rate, of the clamped panel
    ``M xdd + D xd + K x = tau``, the force held over each control period; it costs its energy ``x' K x / 2 + xd' M xd /
    2``. The forces are those of the coordinates that the paper's law would damp, q4 left out.

    Args:
        prior: panel, piezos and control period as the controller believes them.
        effort_weight: [J/V2].

    Raises:
        ValueError: if the weight is not positive.
    """
    if not effort_weight > 0.0:
        raise ValueError(f"effort_weight must be positive [J/V2], got {effort_weight}")
    panel, period = one_element_beam(prior.panel), prior.control.period
    driven = [COORDINATES.index(name) for name in damped_coordinates(prior) if name != COORDINATES[0]]
    gain = np.zeros((N_TIP, 2 * N_TIP))
    if not driven:
        return gain
    M, K = panel.M_ff[BENDING, BENDING], panel.K[BENDING, BENDING]
    A, G = sampled_panel(M, prior.panel.strain_rate_damping * K, K, period)
    G = G[:, [k - BENDING.start for k in driven]]
    piezo = prior.actuators.piezo
    volts = piezo.voltage / np.array([piezo.force, piezo.force, piezo.moment])[driven]
    Q, R = block_diag(K, M) / 2.0, effort_weight * np.diag(volts**2)
    P = solve_discrete_are(A, G, Q, R)
    feedback = np.linalg.solve(R + G.T @ P @ G, G.T @ P @ A)
    states = [1, 2, N_TIP + 1, N_TIP + 2]
    gain[np.ix_(driven, states)] = feedback
    return gain


def sampled_panel(M: Array, D: Array, K: Array, period: float) -> tuple[Array, Array]:
    """Exact step of ``M xdd + D xd + K x = tau`` under a held force: ``[x, xd]' = A [x, xd] + G tau``.

    Args:
        M: (n, n) mass.
        D: (n, n) damping.
        K: (n, n) stiffness.
        period: [s].

    Returns:
        ``A`` (2 n, 2 n) and ``G`` (2 n, n).
    """
    n = len(M)
    rates = np.zeros((3 * n, 3 * n))  # of [x, xd, tau]
    rates[:n, n : 2 * n] = np.eye(n)
    rates[n : 2 * n] = np.linalg.solve(M, np.hstack([-K, -D, np.eye(n)]))
    step = expm(period * rates)
    return step[: 2 * n, : 2 * n], step[: 2 * n, 2 * n :]


@kernel
def regulate(law, allocation, at, obs, volts):
    """Add the regulator's piezo voltages of all panels to ``volts`` (n_p n_c,).

    law: a :class:`Regulator`; allocation: (n_p, n_c, 3) volts for a desired tip force.
    at: index map of the observation ``obs`` (n_o,).
    """
    n_p, n_c, _ = allocation.shape
    for i in range(n_p):
        push, push_rate = root_acceleration(law, at, obs, i)
        q, qd = at.elastic + N_TIP * i, at.elastic_rate + N_TIP * i
        for k in range(N_TIP):
            tau = 0.0
            for j in range(N_TIP):
                tau -= law.gain[k, j] * (obs[q + j] - law.shape[j] * push)
                tau -= law.gain[k, N_TIP + j] * (obs[qd + j] - law.shape[j] * push_rate)
            for c in range(n_c):
                volts[i * n_c + c] += allocation[i, c, k] * tau


@kernel
def root_acceleration(law, at, obs, i):
    """Acceleration of the root of panel ``i`` across it [m/s2] under the reference's motion, and its rate [m/s3].

    law: a :class:`Regulator`; at: index map of the observation ``obs`` (n_o,).

    The path's acceleration turns with its velocity, as on a circle, which gives the rate.
    """
    xd, yd, turn = obs[at.reference_velocity], obs[at.reference_velocity + 1], obs[at.reference_turn]
    xdd, ydd = obs[at.reference_acceleration], obs[at.reference_acceleration + 1]
    spin = (xd * ydd - yd * xdd) / (xd * xd + yd * yd) - turn
    nx, ny = law.across[i, 0], law.across[i, 1]
    return nx * xdd + ny * ydd - turn * turn * law.lever[i], spin * (ny * xdd - nx * ydd)


def _quasi_static_shape(panel: Beam) -> Array:
    """Tip (3,) under the inertia of a transverse acceleration of 1 m/s2: ``-K^-1 m_fr``."""
    return np.asarray(-np.linalg.solve(panel.K, panel.S_y), dtype=np.float64)
