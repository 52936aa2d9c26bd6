"""Feed-forward of the panels' reaction: the inverse dynamics of the whole robot in place of its rigid part (Eq. 6).

The paper's law leaves out what the panels pull the base with, Q_flex, and its feedback has to make up for it. All that
it takes to predict it is in the observation: with the acceleration commanded of the base a panel's root is known to
move, and with its tip and voltages known the panel answers as the second row of Eq. 2 says. The law's panel has one
element, in the coordinates of its tip (q5, q6); along its axis it counts as rigid, since the axial coordinate is so
stiff that a tenth of a millimetre of it, measured wrong, would be thousands of newtons.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sffr_gym.compile.kernels import kernel
from sffr_gym.config.params import Params
from sffr_gym.physics.beam import N_TIP, one_element_beam
from sffr_gym.physics.model import Model
from sffr_gym.types import Array

BENDING = slice(1, N_TIP)  # the tip's transverse displacement and slope, q5 and q6
N_BENDING = N_TIP - 1


class PanelReaction(NamedTuple):
    """The believed panels, of one element each, their equations of motion solved for the bending coordinates ``b``.

    ``bdd = drive volts - stiffness b - damping bd + w^2 b - across a_y - turn alpha`` with the root's acceleration
    ``a_y`` across the panel, its angular acceleration ``alpha`` and the yaw rate ``w``.
    """

    active: bool  #: whether the law adds it; the paper's do not
    root: Array  #: (n_p, 2) place of the clamped end, base frame [m]
    axis: Array  #: (n_p, 2) direction of the undeformed panel, base frame
    mass: float  #: of a panel [kg], and its moments about the root [kg m, kg m2]
    first_moment: float
    second_moment: float
    M: Array  #: (2, 2) mass matrix of the bending coordinates
    S_y: Array  #: (2,) coupling with the translation across the panel [kg, kg m]
    c_y: Array  #: (2,) coupling with the rotation [kg m, kg m2]
    drive: Array  #: (n_p, 2, n_c) ``M^-1 K_PZ``, accelerations for a volt on each channel
    stiffness: Array  #: (2, 2) ``M^-1 K``
    damping: Array  #: (2, 2) ``M^-1 D``
    across: Array  #: (2,) ``M^-1 S_y``
    turn: Array  #: (2,) ``M^-1 c_y``


def make_panel_reaction(prior: Params, model: Model, K_PZ: Array) -> PanelReaction:
    """Pack what the controller believes of the panels.

    Args:
        prior: the controller's parameters.
        model: the same as arrays.
        K_PZ: (n_p, 3, n_c) tip forces for a volt on each channel.
    """
    panel = one_element_beam(prior.panel)
    M, K = panel.M_ff[BENDING, BENDING], panel.K[BENDING, BENDING]
    inverse = np.asarray(np.linalg.inv(M), dtype=np.float64)
    stiffness = inverse @ K
    return PanelReaction(
        active=prior.control.feedforward,
        root=model.panel_root,
        axis=model.panel_axis,
        mass=panel.mass,
        first_moment=panel.first_moment,
        second_moment=panel.second_moment,
        M=M.copy(),
        S_y=panel.S_y[BENDING].copy(),
        c_y=panel.c_y[BENDING].copy(),
        drive=inverse @ K_PZ[:, BENDING],
        stiffness=stiffness,
        damping=prior.panel.strain_rate_damping * stiffness,
        across=inverse @ panel.S_y[BENDING],
        turn=inverse @ panel.c_y[BENDING],
    )


@kernel
def add_panel_reaction(panels, limit, at, obs, volts, base, wrench):
    """Add the force and moment that the panels will need of the base to ``wrench`` (3,), base axes.

    panels: :class:`PanelReaction`; limit: (n_u,) of which the first are those of ``volts`` (n_p n_c,), as commanded.
    at: index map of the observation ``obs`` (n_o,); base: (3,) commanded acceleration of the base, base axes.

    Source: Eqs. 2 to 4, 45, 48 and 49, the axial coordinates at rest.
    """
    w, alpha = obs[at.yaw_rate], base[2]
    w2 = w * w
    for i in range(len(panels.root)):
        x, y, c, s = panels.root[i, 0], panels.root[i, 1], panels.axis[i, 0], panels.axis[i, 1]
        rx, ry = base[0] - alpha * y - w2 * x, base[1] + alpha * x - w2 * y
        along, across = c * rx + s * ry, c * ry - s * rx
        q, qd = at.elastic + N_TIP * i + 1, at.elastic_rate + N_TIP * i + 1
        first_y = first_yd = S_bdd = c_bdd = bMb = bMbd = 0.0
        for k in range(N_BENDING):
            b, bdd = obs[q + k], w2 * obs[q + k] - panels.across[k] * across - panels.turn[k] * alpha
            for j in range(N_BENDING):
                bdd -= panels.stiffness[k, j] * obs[q + j] + panels.damping[k, j] * obs[qd + j]
                bMb += b * panels.M[k, j] * obs[q + j]
                bMbd += b * panels.M[k, j] * obs[qd + j]
            n_c = panels.drive.shape[2]
            for channel in range(n_c):
                at_limit = limit[i * n_c + channel]
                bdd += panels.drive[i, k, channel] * min(max(volts[i * n_c + channel], -at_limit), at_limit)
            first_y += panels.S_y[k] * b
            first_yd += panels.S_y[k] * obs[qd + k]
            S_bdd += panels.S_y[k] * bdd
            c_bdd += panels.c_y[k] * bdd
        fx = panels.mass * along - alpha * first_y - w2 * panels.first_moment - 2.0 * w * first_yd
        fy = panels.mass * across + alpha * panels.first_moment + S_bdd - w2 * first_y
        moment = panels.first_moment * across - first_y * along + alpha * (panels.second_moment + bMb)
        moment += c_bdd + 2.0 * w * bMbd
        fx, fy = c * fx - s * fy, s * fx + c * fy
        wrench[0] += fx
        wrench[1] += fy
        wrench[2] += x * fy - y * fx + moment
