"""Suppression of the panels' vibration: the virtual damping of Eq. 20 and its adaptation, Eq. 39.

The desired elastic motion is zero, so ``e = -q_f`` and the law is ``tau = -B_hat qd_f - Q_v``. The sign is that of Eq.
20; Eq. 16 as printed would feed energy in.
"""

from __future__ import annotations

from math import pi
from typing import NamedTuple

import numpy as np

from sffr_gym._jit import kernel
from sffr_gym.beam import N_TIP, Array, beam
from sffr_gym.lanes import where
from sffr_gym.params import Params

COORDINATES = ("q4", "q5", "q6")


class Suppression(NamedTuple):
    """The law's own model of a panel (one element, the paper's coordinates) and its gains.

    Attributes:
        damped: (3,) 1 for each tip coordinate that the law damps.
        B0: (3,) virtual damping at the start [N s/m, N s/m, N m s/rad].
        Gamma: (3,) adaptation gains; 0 is HSC.
        psi: weight of the error in the filtered output [1/s].
        filtered: 1 for Y = e_dot + psi e, 0 for the printed Y = e.
        period: control period [s].
        M_inv: (3, 3) inverse of M_ff; M_ff: (3, 3).
        centrifugal: (3,) integral of rho a x U (axial) of Eq. 48; gyroscopic: (3, 3) N - N'.
    """

    damped: Array
    B0: Array
    Gamma: Array
    psi: float
    filtered: float
    period: float
    M_inv: Array
    M_ff: Array
    centrifugal: Array
    gyroscopic: Array


def make_suppression(prior: Params, *, active: bool, adaptive: bool, filtered: bool = False) -> Suppression:
    """Build the law from what the controller believes.

    Args:
        prior: the controller's parameters.
        active: False leaves the piezos off.
        adaptive: False keeps the virtual damping at its start (HSC).
        filtered: take the filtered output of Eq. 25 for the adaptation instead of the printed one.
    """
    panel, law = prior.panel, prior.suppression
    shape = beam(panel.mass, panel.length, panel.EI, panel.E * panel.area, elements=1)
    damped = np.array([float(active and name in damped_coordinates(prior)) for name in COORDINATES])
    return Suppression(
        damped=damped,
        B0=np.array(law.B0),
        Gamma=np.array(law.Gamma) * float(adaptive) * damped,
        psi=law.psi,
        filtered=float(filtered),
        period=prior.control.period,
        M_inv=np.asarray(np.linalg.inv(shape.M_ff), dtype=np.float64),
        M_ff=shape.M_ff,
        centrifugal=shape.c_x,
        gyroscopic=shape.N - shape.N.T,
    )


def damped_coordinates(params: Params) -> tuple[str, ...]:
    """The tip coordinates that the law damps, by ``suppression.coordinates``.

    ``auto`` takes those whose own natural frequency ``sqrt(K_ii / M_ii)`` times the control period is below pi/2:
    beyond, a damping that acts with the delay of a sample can feed a mode instead of calming it.
    """
    choice = params.suppression.coordinates
    if choice == "all":
        return COORDINATES
    if choice != "auto":
        return tuple(choice)
    panel = params.panel
    shape = beam(panel.mass, panel.length, panel.EI, panel.E * panel.area, elements=1)
    omega = np.sqrt(np.diag(shape.K) / np.diag(shape.M_ff))
    return tuple(name for name, w in zip(COORDINATES, omega, strict=True) if w * params.control.period < pi / 2)


@kernel(inline=True)
def suppress(law, allocation, limit, obs, elastic, yaw_rate, factor, B_hat, volts):
    """Write the piezo voltages of all panels and adapt ``B_hat`` (n_p, 3) in place.

    allocation: (n_p, n_c, 3) volts for a wanted tip force; limit: (n_p n_c,) [V].
    obs: the observation, whose tip displacements start at ``elastic``; yaw_rate: of the base [rad/s].
    factor: (n_p, 3) by which a schedule multiplies the virtual damping; 1 is the law alone.

    No adaptation while a channel of the panel saturates; B is never negative (sec. 4).
    """
    n_p, n_c, _ = allocation.shape
    for i in range(n_p):
        q, qd = elastic + N_TIP * i, elastic + N_TIP * (n_p + i)
        for c in range(n_c):
            volts[i * n_c + c] = 0.0
        for k in range(N_TIP):
            if law.damped[k] == 0.0:
                continue
            Q_v = yaw_rate * yaw_rate * law.centrifugal[k]
            for j in range(N_TIP):
                Q_v += yaw_rate * yaw_rate * law.M_ff[k, j] * obs[q + j]
                Q_v -= 2.0 * yaw_rate * law.gyroscopic[k, j] * obs[qd + j]
            tau = -(factor[i, k] * B_hat[i, k]) * obs[qd + k] - Q_v
            for c in range(n_c):
                volts[i * n_c + c] += allocation[i, c, k] * tau
        excess = 0.0
        for c in range(n_c):
            excess = max(excess, abs(volts[i * n_c + c]) - limit[i * n_c + c])
        _adapt(law, obs, q, qd, B_hat[i], excess > 0.0)


@kernel(inline=True)
def _adapt(law, obs, q, qd, B_hat, saturated):
    """``dB/dt = Gamma K' M_f^-1 Y`` over one period unless saturated, with the regressor K = diag(e_dot) of Eq. 24."""
    for k in range(N_TIP):
        Y = 0.0
        for j in range(N_TIP):
            Y -= law.M_inv[k, j] * (obs[qd + j] + law.psi * obs[q + j] if law.filtered > 0.0 else obs[q + j])
        adapted = max(B_hat[k] - law.period * law.Gamma[k] * obs[qd + k] * Y, 0.0)
        B_hat[k] = where(saturated, B_hat[k], adapted)
