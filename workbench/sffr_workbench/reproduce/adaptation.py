"""Where the printed adaptation law leads: its integral is a function of the deflection.

With e = -q_f the printed law, Eq. 39 with Y = e and the regressor diag(e_dot), is
``dB_k/dt = Gamma_k qd_k (M^-1 q)_k``. M^-1 is constant and symmetric, so that the sum over the coordinates can be
integrated, whatever the motion::

    sum_k (B_k(t) - B_k(0)) / Gamma_k = [q' M^-1 q / 2] from 0 to t

Each B_k alone is ``Gamma_k (M^-1)_kk q_k^2 / 2`` and the integrals of ``q_j dq_k``, which vanish over every path in
which the deflections return in proportion, as in a single mode. A straight panel therefore has its first virtual
damping back, however long it shook. The filtered output adds ``Gamma_k qd_k (M^-1 qd)_k``, whose sum is positive: that
does accumulate. No adaptation under saturation and B >= 0 are the only exceptions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sffr_baselines.rollout import Trajectory
from sffr_baselines.suppression import Suppression
from sffr_gym.physics.beam import N_TIP
from sffr_gym.types import Array


class AdaptationIntegral(NamedTuple):
    """The integral of an adaptation law and its parts; all from the start on, for each panel."""

    total: Array  #: (rows, n_p) sum of (B_k - B_k(0)) / Gamma_k
    potential: Array  #: (rows, n_p) q' M^-1 q / 2
    change: Array  #: (rows, n_p, 3) B_k - B_k(0)
    own: Array  #: (rows, n_p, 3) its part that is a function of the coordinate's own deflection alone


def adaptation_integral(trajectory: Trajectory, law: Suppression) -> AdaptationIntegral:
    """Split the course of the virtual damping into its parts.

    Args:
        trajectory: of an adaptive policy that damps all three coordinates.
        law: its gains and its model of a panel.
    """
    q = trajectory.obs[:, trajectory.fields["elastic"].slice].reshape(len(trajectory.t), -1, N_TIP)
    potential = 0.5 * np.einsum("tpj,pjk,tpk->tp", q, law.M_inv, q)
    own = 0.5 * law.Gamma * np.diagonal(law.M_inv, axis1=1, axis2=2) * q**2
    change = trajectory.B_hat - trajectory.B_hat[0]
    return AdaptationIntegral((change / law.Gamma).sum(axis=-1), potential - potential[0], change, own - own[0])


def departure(integral: AdaptationIntegral) -> float:
    """Return the largest distance of the damping's change from the function of the deflection, over its range."""
    return float(np.abs(integral.total - integral.potential).max() / np.ptp(integral.potential))
