"""Feed-forward of the panels' reaction: the inverse dynamics of the whole robot in place of its rigid part (Eq. 6).

The paper's law leaves out what the panels pull the base with, Q_flex, and its feedback has to make up for it. All that
it takes to predict it is in the observation: with the acceleration commanded of the base a panel's root is known to
move, and with its tip and voltages known the panel answers as the second row of Eq. 2 says. The law's panel has one
element, in the coordinates of its tip (q5, q6); along its axis it counts as rigid, since the axial coordinate is so
stiff that a tenth of a millimetre of it, measured wrong, would be thousands of newtons.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from sffr_gym.compile.kernels import kernel
from sffr_gym.config.params import Params
from sffr_gym.config.sections import Panel
from sffr_gym.physics.beam import N_TIP, one_element_beam
from sffr_gym.physics.each_panel import of_each_panel
from sffr_gym.physics.model import Model
from sffr_gym.types import Array

BENDING = slice(1, N_TIP)  # the tip's transverse displacement and slope, q5 and q6
N_BENDING = N_TIP - 1


class PanelReaction(NamedTuple):
    """The believed panels, of one element each, their equations of motion solved for the bending coordinates ``b``.

    ``bdd = drive volts - stiffness b - damping bd + w^2 b - across a_y - turn alpha`` with the root's acceleration
    ``a_y`` across the panel, its angular acceleration ``alpha`` and the yaw rate ``w``.
    """

    active: bool  #: whether the law feeds it to thrusters; the paper's do not
    root: Array  #: (n_p, 2) place of the clamped end, base frame [m]
    axis: Array  #: (n_p, 2) direction of the undeformed panel, base frame
    mass: Array  #: (n_p,) of a panel [kg], and its moments about the root [kg m, kg m2]
    first_moment: Array
    second_moment: Array
    M: Array  #: (n_p, 2, 2) mass matrix of the bending coordinates
    S_y: Array  #: (n_p, 2) coupling with the translation across the panel [kg, kg m]
    c_y: Array  #: (n_p, 2) coupling with the rotation [kg m, kg m2]
    drive: Array  #: (n_p, 2, n_c) ``M^-1 K_PZ``, accelerations for a volt on each channel
    stiffness: Array  #: (n_p, 2, 2) ``M^-1 K``
    damping: Array  #: (n_p, 2, 2) ``M^-1 D``
    across: Array  #: (n_p, 2) ``M^-1 S_y``
    turn: Array  #: (n_p, 2) ``M^-1 c_y``


def make_panel_reaction(prior: Params, model: Model, K_PZ: Array) -> PanelReaction:
    """Pack what the controller believes of the panels.

    Args:
        prior: the controller's parameters.
        model: the same as arrays.
        K_PZ: (n_p, 3, n_c) tip forces for a volt on each channel.
    """
    n_p, eta = prior.n_panels, prior.panel.strain_rate_damping

    def of_panel(panel: Panel) -> tuple[Any, ...]:
        """Return the constants of a panel, from ``mass`` on and without ``drive``, and its inverse mass matrix."""
        beam = one_element_beam(panel)
        M, K, S_y, c_y = beam.M_ff[BENDING, BENDING], beam.K[BENDING, BENDING], beam.S_y[BENDING], beam.c_y[BENDING]
        inverse = np.asarray(np.linalg.inv(M), dtype=np.float64)
        stiffness = inverse @ K
        moments = beam.mass, beam.first_moment, beam.second_moment
        return *moments, M, S_y, c_y, stiffness, eta * stiffness, inverse @ S_y, inverse @ c_y, inverse

    columns = zip(*of_each_panel(prior, of_panel), strict=True)
    mass, first, second, M, S_y, c_y, stiffness, damping, across, turn, inverse = (
        np.array(each)[:n_p] for each in columns
    )
    return PanelReaction(
        active=prior.control.feedforward and prior.actuators.thrusters != "none",
        root=model.panel_root,
        axis=model.panel_axis,
        mass=mass,
        first_moment=first,
        second_moment=second,
        M=M,
        S_y=S_y,
        c_y=c_y,
        drive=inverse @ K_PZ[:, BENDING],
        stiffness=stiffness,
        damping=damping,
        across=across,
        turn=turn,
    )


@kernel
def add_panel_reaction(panels, limit, at, obs, volts, base, share, wrench):
    """Add the force and moment that the panels will need of the base to ``wrench`` (3,), base axes.

    panels: :class:`PanelReaction`; limit: (n_u,) of which the first are those of ``volts`` (n_p n_c,), as commanded.
    at: index map of the observation ``obs`` (n_o,); base: (3,) commanded acceleration of the base, base axes.
    share: (n_p,) of each panel's that is added.

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
            b, bdd = obs[q + k], w2 * obs[q + k] - panels.across[i, k] * across - panels.turn[i, k] * alpha
            for j in range(N_BENDING):
                bdd -= panels.stiffness[i, k, j] * obs[q + j] + panels.damping[i, k, j] * obs[qd + j]
                bMb += b * panels.M[i, k, j] * obs[q + j]
                bMbd += b * panels.M[i, k, j] * obs[qd + j]
            n_c = panels.drive.shape[2]
            for channel in range(n_c):
                at_limit = limit[i * n_c + channel]
                bdd += panels.drive[i, k, channel] * min(max(volts[i * n_c + channel], -at_limit), at_limit)
            first_y += panels.S_y[i, k] * b
            first_yd += panels.S_y[i, k] * obs[qd + k]
            S_bdd += panels.S_y[i, k] * bdd
            c_bdd += panels.c_y[i, k] * bdd
        fx = panels.mass[i] * along - alpha * first_y - w2 * panels.first_moment[i] - 2.0 * w * first_yd
        fy = panels.mass[i] * across + alpha * panels.first_moment[i] + S_bdd - w2 * first_y
        moment = panels.first_moment[i] * across - first_y * along + alpha * (panels.second_moment[i] + bMb)
        moment += c_bdd + 2.0 * w * bMbd
        fx, fy = c * fx - s * fy, s * fx + c * fy
        wrench[0] += share[i] * fx
        wrench[1] += share[i] * fy
        wrench[2] += share[i] * (x * fy - y * fx + moment)
