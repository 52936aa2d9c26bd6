"""Which virtual damping a sampled loop can run: a clamped panel under ``tau = -B qd_tip``, held over each period.

Between two samples the panel is linear, so that its state after a period is the matrix exponential times the state
before, less what the held force did. The loop is stable if no eigenvalue of that map lies outside the unit circle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from sffr_gym.physics.beam import N_TIP
from sffr_gym.physics.model import Model, tip_rows
from sffr_gym.types import Array

MARGIN = 1.0e-9  # growth per period above 1 that rounding may cause: an undamped panel without control keeps 1
FAINT = 1.0e-6  # of the damping that stops a free tip within a sample: too little to matter
HALVINGS = 50  # of an interval in which the loop becomes unstable


def sampled_growth(model: Model, B: ArrayLike, damped: ArrayLike, period: float) -> Array:
    """Return the growth of a panel's vibration per control period under a sampled virtual damping; stable up to 1.

    The spectral radius of the map from one sample to the next, with all modes of the model and the strain-rate
    damping; the root is clamped; of panels that differ the fastest growth.

    Args:
        model: the robot, with at least one panel.
        B: (..., 3) virtual damping of the tip's axial, transverse and slope coordinate [N s/m, N s/m, N m s/rad].
        damped: (3,) 1 for each coordinate that the law damps, else 0.
        period: control period, over which the force is held [s].

    Returns:
        (...) spectral radii; without modes 0.

    Raises:
        ValueError: for a period that is not positive, or a model without panels.
    """
    if not period > 0.0:
        raise ValueError(f"period must be a positive number of seconds, got {period}")
    if len(model.omega2) == 0:
        raise ValueError("the robot has no panels, so there is nothing to damp")
    gains = (np.asarray(B, dtype=np.float64) * np.asarray(damped, dtype=np.float64))[..., None] * np.eye(N_TIP)
    none = np.zeros_like(gains)
    return np.max([feedback_growth(model, i, none, gains, period) for i in range(len(model.omega2))], axis=0)


def feedback_growth(model: Model, i: int, stiffness: Array, damping: Array, period: float) -> Array:
    """Return the growth of panel ``i`` per control period under ``tau = -stiffness q_tip - damping qd_tip``, held.

    Args:
        model: the robot.
        i: which of its panels.
        stiffness: (..., 3, 3) tip forces against a unit of the tip's coordinates.
        damping: (..., 3, 3) and of their rates.
        period: control period [s].

    Returns:
        (...) spectral radii; without modes 0.
    """
    tip = tip_rows(model)[i]
    n_m = tip.shape[1]
    transition, response = _sampled_modes(model.omega2[i], model.damping[i], period)
    # State [eta, eta_d]; the tip's velocities are tip @ eta_d, a tip force tau makes the modal forces tip' tau.
    modal_forces = np.concatenate([tip.T @ stiffness @ tip, tip.T @ damping @ tip], axis=-1)
    step = np.zeros((*modal_forces.shape[:-2], 2 * n_m, 2 * n_m))
    for part in range(2):
        rows = slice(part * n_m, (part + 1) * n_m)
        for other in range(2):
            step[..., rows, other * n_m : (other + 1) * n_m] = np.diag(transition[:, part, other])
        step[..., rows, :] -= response[:, part, None] * modal_forces
    return np.abs(np.linalg.eigvals(step)).max(axis=-1, initial=0.0)


def largest_stable_damping(model: Model, direction: ArrayLike, damped: ArrayLike, period: float) -> float:
    """Return the largest factor of a virtual damping up to which a sampled loop is stable, from 0 on without a gap.

    Args:
        model: the robot, with at least one panel.
        direction: (3,) virtual damping that is multiplied, such as B(0).
        damped: (3,) 1 for each coordinate that the law damps, else 0.
        period: control period [s].

    Returns:
        The factor; 0 if even a faint damping is unstable, as it is without strain-rate damping at some periods
        beyond half a mode's cycle.

    Raises:
        ValueError: as :func:`sampled_growth`, or if none of the damped coordinates has a share in ``direction``.
    """
    weights = np.asarray(direction, dtype=np.float64)
    gains = weights * np.asarray(damped, dtype=np.float64)
    if not gains.any():
        raise ValueError(f"direction {weights.tolist()} has no part in the damped coordinates")
    tips = tip_rows(model)
    # Where the held force, B times the tip's response, reverses the velocities of one sample: unstable beyond.
    reversing = 2.0 / (period * float(np.linalg.eigvalsh(np.einsum("pkm,k,pkn->pmn", tips, gains, tips)).max()))
    factors = reversing * np.geomspace(FAINT, 1.0e3, 400)
    unstable = sampled_growth(model, factors[:, None] * weights, damped, period) > 1.0 + MARGIN
    first = int(np.argmax(unstable)) if unstable.any() else len(factors)
    if first in (0, len(factors)):
        return 0.0 if first == 0 else float("inf")
    low, high = factors[first - 1], factors[first]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        stable = sampled_growth(model, middle * weights, damped, period) <= 1.0 + MARGIN
        low, high = (middle, high) if stable else (low, middle)
    return float(low)


def axial_alone(model: Model) -> Model:
    """Return a model for :func:`sampled_growth` with the axial modes alone, which a clamped panel's bending leaves.

    The bending modes, whose growth is near 1, would hide how fast an axial vibration decays.
    """
    kept = slice(None, model.n_axial)
    return model._replace(omega2=model.omega2[:, kept], damping=model.damping[:, kept], shapes=model.shapes[:, :, kept])


def _sampled_modes(omega2: Array, damping: Array, period: float) -> tuple[Array, Array]:
    """Return exact steps of single modes: transition (n_m, 2, 2) and response (n_m, 2) to a held unit force."""
    rates = np.zeros((len(omega2), N_TIP, N_TIP))  # of [eta, eta_d, force]
    rates[:, 0, 1] = rates[:, 1, 2] = 1.0
    rates[:, 1, 0], rates[:, 1, 1] = -omega2, -damping
    steps = expm(period * rates)
    return steps[:, :2, :2], steps[:, :2, 2]
