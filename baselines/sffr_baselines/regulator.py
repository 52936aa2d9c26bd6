"""Active feedback of the panels: a linear-quadratic regulator about the quasi-static shape, sampled as the loop is.

Not in the paper. Where virtual damping can only take energy out of a panel, this law pushes and pulls its tip as a
linear-quadratic regulator of the clamped, one-element panel would. It knows no limit of the volts but in their price.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag, expm, solve_discrete_are, solve_discrete_lyapunov

from sffr_baselines.panel_reaction import BENDING, N_BENDING
from sffr_baselines.settings import RegulatorWeights
from sffr_baselines.suppression import COORDINATES, damped_coordinates
from sffr_gym.compile.kernels import kernel
from sffr_gym.config.params import Params
from sffr_gym.config.sections import PANEL_KEYS, Panel
from sffr_gym.physics.actuators import LEAST_REACH
from sffr_gym.physics.beam import N_TIP, Beam, clamped_modes, one_element_beam
from sffr_gym.physics.each_panel import of_each_panel
from sffr_gym.physics.kinematics import rotation
from sffr_gym.physics.model import Model
from sffr_gym.task.observation import reference_turning
from sffr_gym.task.reference import Reference
from sffr_gym.task.score import WEIGHTS
from sffr_gym.types import Array

HALVINGS = 60  # of a virtual damping that is unstable
STANDSTILL = 1.0e-12  # m2/s2: a path slower than a micrometre a second has no direction that could turn


class Regulator(NamedTuple):
    """State feedback of each panel's tip about its quasi-static motion."""

    active: bool  #: whether the law has one; the paper's laws have none
    gain: Array  #: (n_p, n_c, 4) volts of a panel's channels for a unit deviation of q5, q6 and of their rates
    shape: Array  #: (n_p, 3) tip of a panel at rest whose root accelerates across it by 1 m/s2
    across: Array  #: (n_p, 2) direction across each undeformed panel, reference axes
    lever: Array  #: (n_p,) component of each panel's root along it, from the reference's centre [m]
    turned: Array  #: (n_p, 3) tip of a panel at rest that is turned about its root by 1 rad/s2
    reach: Array  #: (n_p,) component of each panel's root along the panel, from the reference's centre [m]


def make_regulator(
    prior: Params, model: Model, reference: Reference, K_PZ: Array, weights: RegulatorWeights | None
) -> Regulator:
    """Design the regulator for what the controller believes.

    Args:
        prior: the controller's parameters.
        model: the same as arrays.
        reference: the formation that the task asks for.
        K_PZ: (n_p, 3, n_c) tip forces for a volt on each channel.
        weights: of what it minimises; None for a law without regulator.
    """
    turn = rotation(reference.yaw)
    across = np.column_stack([-model.panel_axis[:, 1], model.panel_axis[:, 0]]) @ turn.T
    root = np.array([reference.base_x, reference.base_y]) + model.panel_root @ turn.T
    n_p, _, n_c = K_PZ.shape
    gain = np.zeros((n_p, n_c, 2 * N_BENDING))
    if weights is not None and n_p:
        reached = {panel.numbers: force for panel, force in zip(prior.panel.each, K_PZ, strict=True)}

        def design(panel: Panel) -> Array:
            """Return the gain of a panel, as if all were like it."""
            own, force = with_panel(prior, panel), reached[panel.numbers]
            return optimal_gain(own, force, weights.effort * worth_of_effort(own, force, weights.swing))

        gain = np.array(of_each_panel(prior, design))
    beams = of_each_panel(prior, one_element_beam)
    return Regulator(
        active=weights is not None,
        gain=gain,
        shape=np.array([_deflected(beam, beam.S_y) for beam in beams])[:n_p],
        across=across,
        lever=np.asarray((across * root).sum(axis=1)),
        turned=np.array([_deflected(beam, beam.c_y) for beam in beams])[:n_p],
        reach=np.asarray((model.panel_axis @ turn.T * root).sum(axis=1)),
    )


def with_panel(prior: Params, panel: Panel) -> Params:
    """Return the parameters of a robot all of whose panels are like one."""
    if any(mount.own for mount in panel.mounts):
        mounts = tuple(mount.model_copy(update=dict.fromkeys(PANEL_KEYS)) for mount in panel.mounts)
        panel = panel.model_copy(update={"mounts": mounts})
    return prior.model_copy(update={"panel": panel})


def optimal_gain(prior: Params, K_PZ: Array, effort_weight: float) -> Array:
    """Return the gain (n_c, 4) that minimises the time integral of a panel's energy and of weighted squared volts.

    The state is the deviation ``x`` of q5 and q6 from the quasi-static shape and its rate, of the clamped panel
    ``M xdd + D xd + K x = K_PZ v``, the volts held over each control period; it costs its energy ``x' K x / 2 + xd' M
    xd / 2``. What the channels do along the panel is left out.

    Args:
        prior: panel and control period as the controller believes them, all panels alike.
        K_PZ: (3, n_c) tip forces for a volt on each channel.
        effort_weight: price of a squared volt over a second, as energy over a second [J/V2].

    Raises:
        ValueError: if the weight is not positive.
    """
    if not effort_weight > 0.0:
        raise ValueError(f"effort_weight must be positive [J/V2], got {effort_weight}")
    M, K, A, G = sampled_bending(prior)
    G, Q, R = G @ K_PZ[BENDING], block_diag(K, M) / 2.0, effort_weight * np.eye(K_PZ.shape[1])
    P = solve_discrete_are(A, G, Q, R)
    return np.asarray(np.linalg.solve(R + G.T @ P @ G, G.T @ P @ A), dtype=np.float64)


def worth_of_effort(prior: Params, K_PZ: Array, swing: float) -> float:
    """Return what a squared volt over a second is worth in the score, as energy over a second [J/V2].

    The score weighs vibration and effort by what they are under AHSC. Of a clamped panel that swings in its first mode,
    damped by B(0) through the channels, both follow from the energy at the start: the worth is the ratio of their
    integrals times that of their weights in the score. Where channels are too weak for B(0) at that swing, or the
    sampled loop cannot run it, so much less of it acts.

    Args:
        prior: panel, virtual damping, limits and control period as the controller believes them.
        K_PZ: (3, n_c) tip forces for a volt on each channel.
        swing: amplitude of the tip [m].
    """
    M, K, A, G = sampled_bending(prior)
    panel, driven = one_element_beam(prior.panel), damped_coordinates(prior)
    modes = clamped_modes(panel, 0.0, np.inf)
    shape = swing * modes.shapes[BENDING, 0] / modes.shapes[BENDING.start, 0]
    allocation = np.linalg.pinv(K_PZ, rcond=LEAST_REACH)[:, BENDING]
    B = np.diag([B if name in driven else 0.0 for B, name in zip(prior.suppression.B0, COORDINATES, strict=True)])
    B = B[BENDING, BENDING]
    if not (allocation @ B).any():  # nothing to go by: critical damping
        B = 2.0 * modes.omega[0] * M
    B *= min(1.0, prior.actuators.piezo.voltage / np.abs(allocation @ B @ (modes.omega[0] * shape)).max())
    for _ in range(HALVINGS):
        volts = allocation @ np.hstack([np.zeros_like(M), B])
        damped = A - G @ K_PZ[BENDING] @ volts
        if np.abs(np.linalg.eigvals(damped)).max() < 1.0:
            break
        B /= 2.0
    energy, effort = (solve_discrete_lyapunov(damped.T, cost) for cost in (block_diag(K, M) / 2.0, volts.T @ volts))
    start = np.append(shape, np.zeros(N_BENDING))
    weights = WEIGHTS["piezo_effort"] / WEIGHTS["vibration"]
    return float(weights * (start @ energy @ start) / (start @ effort @ start))


def sampled_bending(prior: Params) -> tuple[Array, Array, Array, Array]:
    """Return mass and stiffness (2, 2) of q5 and q6, and the exact step of them under held forces."""
    panel = one_element_beam(prior.panel)
    M, K = panel.M_ff[BENDING, BENDING], panel.K[BENDING, BENDING]
    return M, K, *sampled_panel(M, prior.panel.strain_rate_damping * K, K, prior.control.period)


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
def deviate(law, at, obs, i, x):
    """Write the deviation of q5, q6 of panel ``i`` and of their rates from the quasi-static motion into ``x`` (4,).

    law: a :class:`Regulator`; at: index map of the observation ``obs`` (n_o,).
    """
    push, push_rate = root_acceleration(law, at, obs, i)
    spin, spin_rate = reference_turning(at, obs)
    q, qd = at.elastic + N_TIP * i + 1, at.elastic_rate + N_TIP * i + 1
    for j in range(N_BENDING):
        x[j] = obs[q + j] - law.shape[i, 1 + j] * push - law.turned[i, 1 + j] * spin
        x[N_BENDING + j] = obs[qd + j] - law.shape[i, 1 + j] * push_rate - law.turned[i, 1 + j] * spin_rate


@kernel
def regulate(law, i, x, volts):
    """Add the regulator's voltages (n_c,) of panel ``i`` for its deviation ``x`` (4,); law: a :class:`Regulator`."""
    for j in range(N_BENDING):
        for c in range(len(volts)):
            volts[c] -= law.gain[i, c, j] * x[j] + law.gain[i, c, N_BENDING + j] * x[N_BENDING + j]


@kernel
def root_acceleration(law, at, obs, i):
    """Acceleration of the root of panel ``i`` across it [m/s2] under the reference's motion, and its rate [m/s3].

    law: a :class:`Regulator`; at: index map of the observation ``obs`` (n_o,).

    A circle's acceleration turns with its velocity, which gives the rate; on other paths the jerk is observed.
    """
    xd, yd, turn = obs[at.reference_velocity], obs[at.reference_velocity + 1], obs[at.reference_turn]
    xdd, ydd = obs[at.reference_acceleration], obs[at.reference_acceleration + 1]
    nx, ny = law.across[i, 0], law.across[i, 1]
    if at.reference_jerk < at.end:
        alpha, alpha_rate = reference_turning(at, obs)
        push = nx * xdd + ny * ydd - turn * turn * law.lever[i] + alpha * law.reach[i]
        jx, jy = obs[at.reference_jerk] + turn * ydd, obs[at.reference_jerk + 1] - turn * xdd  # seen from the axes
        return push, nx * jx + ny * jy - 2.0 * turn * alpha * law.lever[i] + alpha_rate * law.reach[i]
    spin = (xd * ydd - yd * xdd) / max(xd * xd + yd * yd, STANDSTILL) - turn
    return nx * xdd + ny * ydd - turn * turn * law.lever[i], spin * (ny * xdd - nx * ydd)


def _deflected(panel: Beam, inertia: Array) -> Array:
    """Tip (3,) under the inertia (3,) of a unit acceleration of the root: ``-K^-1 m_fr``."""
    return np.asarray(-np.linalg.solve(panel.K, inertia), dtype=np.float64)
