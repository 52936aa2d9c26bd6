"""Suppression of the panels' vibration: the virtual damping of Eq. 20 and its adaptation, Eq. 39.

The desired elastic motion is zero, so ``e = -q_f`` and the law is ``tau = -B_hat qd_f - Q_v``. The sign is that of Eq.
20; Eq. 16 as printed would feed energy in.
"""

from __future__ import annotations

from math import pi
from typing import NamedTuple

import numpy as np

from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.lanes import where
from sffr_gym.config.params import Params
from sffr_gym.physics.beam import N_TIP, one_element_beam
from sffr_gym.physics.each_panel import of_each_panel
from sffr_gym.types import Array

COORDINATES = ("q4", "q5", "q6")
TRANSVERSE = COORDINATES.index("q5")


class Suppression(NamedTuple):
    """The law's own model of each panel (one element, the paper's coordinates) and its gains."""

    damped: Array  #: (3,) 1 for each tip coordinate that the law damps, else 0
    B0: Array  #: (3,) virtual damping at the start [N s/m, N s/m, N m s/rad]
    Gamma: Array  #: (3,) adaptation gains; 0 is HSC
    psi: float  #: weight of the error in the filtered output [1/s]
    filtered: bool  #: Y = e_dot + psi e, instead of the printed Y = e
    period: float  #: control period [s]
    M_inv: Array  #: (n_p, 3, 3) inverse of M_ff
    M_ff: Array  #: (n_p, 3, 3)
    centrifugal: Array  #: (n_p, 3) integral of rho a x U (axial) of Eq. 48
    gyroscopic: Array  #: (n_p, 3, 3) N - N'


def make_suppression(
    prior: Params, *, active: bool, adaptive: bool, filtered: bool = False, damps: bool = True
) -> Suppression:
    """Build the law from what the controller believes.

    Args:
        prior: the controller's parameters.
        active: False leaves the piezos off.
        adaptive: False keeps the virtual damping at its start (HSC).
        filtered: take the filtered output of Eq. 25 for the adaptation instead of the printed one.
        damps: False leaves the virtual damping out, and what the panels' motion asks for beside it stays.
    """
    law, n_p = prior.suppression, prior.n_panels
    shapes = of_each_panel(prior, one_element_beam)
    damped = np.array([float(active and name in damped_coordinates(prior)) for name in COORDINATES])
    return Suppression(
        damped=damped,
        B0=np.array(law.B0) * float(damps),
        Gamma=np.array(law.Gamma) * float(adaptive) * damped,
        psi=law.psi,
        filtered=filtered,
        period=prior.control.period,
        M_inv=np.array([np.linalg.inv(shape.M_ff) for shape in shapes])[:n_p],
        M_ff=np.array([shape.M_ff for shape in shapes])[:n_p],
        centrifugal=np.array([shape.c_x for shape in shapes])[:n_p],
        gyroscopic=np.array([shape.N - shape.N.T for shape in shapes])[:n_p],
    )


def damped_coordinates(params: Params) -> tuple[str, ...]:
    """The tip coordinates that the law damps, by ``suppression.coordinates``.

    ``auto`` takes those whose own natural frequency ``sqrt(K_ii / M_ii)`` times the control period is below pi/2:
    beyond, a damping that acts with the delay of a sample can feed a mode instead of calming it. Of panels that differ
    the fastest decides.
    """
    choice = params.suppression.coordinates
    if choice == "all":
        return COORDINATES
    if choice != "auto":
        return tuple(choice)
    shapes = of_each_panel(params, one_element_beam)
    omega = np.max([np.sqrt(np.diag(shape.K) / np.diag(shape.M_ff)) for shape in shapes], axis=0)
    return tuple(name for name, w in zip(COORDINATES, omega, strict=True) if w * params.control.period < pi / 2)


@kernel
def suppress(law, allocation, limit, at, obs, factor, B_hat, volts):
    """Write the piezo voltages of all panels and adapt ``B_hat`` (n_p, 3) in place.

    law: :class:`Suppression`; allocation: (n_p, n_c, 3) volts for a desired tip force; limit: (n_p n_c,) [V].
    at: index map of the observation ``obs`` (n_o,).
    factor: (n_p, 3) by which a schedule multiplies the virtual damping; 1 is the law alone.

    No adaptation while a channel of the panel saturates; B is never negative (sec. 4).
    """
    n_p, n_c, _ = allocation.shape
    yaw_rate = obs[at.yaw_rate]
    for i in range(n_p):
        q, qd = at.elastic + N_TIP * i, at.elastic_rate + N_TIP * i
        for c in range(n_c):
            volts[i * n_c + c] = 0.0
        for k in range(N_TIP):
            if law.damped[k] == 0.0:
                continue
            Q_v = yaw_rate * yaw_rate * law.centrifugal[i, k]
            for j in range(N_TIP):
                Q_v += yaw_rate * yaw_rate * law.M_ff[i, k, j] * obs[q + j]
                Q_v -= 2.0 * yaw_rate * law.gyroscopic[i, k, j] * obs[qd + j]
            tau = -(factor[i, k] * B_hat[i, k]) * obs[qd + k] - Q_v
            for c in range(n_c):
                volts[i * n_c + c] += allocation[i, c, k] * tau
        excess = 0.0
        for c in range(n_c):
            excess = max(excess, abs(volts[i * n_c + c]) - limit[i * n_c + c])
        _adapt(law, i, obs, q, qd, B_hat[i], excess > 0.0)


@kernel
def _adapt(law, i, obs, q, qd, B_hat, saturated):
    """``dB/dt = Gamma K' M_f^-1 Y`` over one period unless saturated, with the regressor K = diag(e_dot) of Eq. 24."""
    for k in range(N_TIP):
        Y = 0.0
        for j in range(N_TIP):
            Y -= law.M_inv[i, k, j] * (obs[qd + j] + law.psi * obs[q + j] if law.filtered else obs[q + j])
        adapted = max(B_hat[k] - law.period * law.Gamma[k] * obs[qd + k] * Y, 0.0)
        B_hat[k] = where(saturated, B_hat[k], adapted)
