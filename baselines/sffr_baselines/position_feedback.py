"""Positive position feedback: a second-order filter for each bending mode, driven by its displacement alone.

The filter ``nudd + 2 zeta_f w_f nud + w_f^2 nu = w_f^2 x`` of a mode's displacement ``x`` about the quasi-static
shape is fed back with a positive sign: the mode is pushed with ``g w^2 nu``. Near the mode's frequency the filter lags
a quarter of a cycle, so that the push takes energy out; beyond it rolls off, and modes that it does not know feel
little of it (spillover). With sensor and actuator at one place the loop is stable for any damping of the filter as long
as the filters' static stiffness ``g w^2`` is less than that of the panel (g < 1): rates are not needed.

Sources: Goh and Caughey, *On the stability problem caused by finite actuator dynamics in the collocated control of
large space structures* (1985); Fanson and Caughey, *Positive position feedback control for large space structures*
(1990).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from sffr_baselines.panel_reaction import BENDING, N_BENDING
from sffr_baselines.settings import FilterSettings
from sffr_gym.compile.kernels import kernel
from sffr_gym.config.params import Params
from sffr_gym.config.sections import Panel
from sffr_gym.physics.actuators import LEAST_REACH
from sffr_gym.physics.beam import clamped_modes, one_element_beam
from sffr_gym.physics.each_panel import of_each_panel
from sffr_gym.types import Array


class PositionFeedback(NamedTuple):
    """A filter for each of a panel's two bending modes, as the controller believes them."""

    active: bool  #: whether the law has them
    modes: Array  #: (n_p, 2, 2) amplitude of each mode for a unit of q5, q6 [kg^(1/2), kg^(1/2) m]
    step: Array  #: (n_p, 2, 2, 2) exact step of each filter and its rate over a control period
    push: Array  #: (n_p, 2, 2) what a unit of the mode's displacement, held over it, adds
    volts: Array  #: (n_p, n_c, 2) for a unit of each filter


def make_position_feedback(prior: Params, K_PZ: Array, settings: FilterSettings | None) -> PositionFeedback:
    """Set up the filters for what the controller believes.

    Where channels are too weak for the gains when the first mode swings by ``settings.swing``, so much less acts.
    Bonded pairs push elsewhere than at the tip, whose motion is measured: there the second filter would feed a third
    mode, and is left out.

    Args:
        prior: the controller's parameters.
        K_PZ: (n_p, 3, n_c) tip forces for a volt on each channel.
        settings: of the filters; None for a law without.
    """
    n_p, _, n_c = K_PZ.shape
    if settings is None or n_p == 0:
        zeros = (np.zeros((n_p, *shape)) for shape in ((2, 2), (2, 2, 2), (2, 2), (n_c, 2)))
        return PositionFeedback(False, *zeros)
    forces = {panel.numbers: force for panel, force in zip(prior.panel.each, K_PZ, strict=True)}
    own = of_each_panel(prior, lambda panel: _filters(prior, panel, forces[panel.numbers], settings))
    return PositionFeedback(True, *(np.array(arrays) for arrays in zip(*own, strict=True)))


def _filters(prior: Params, panel: Panel, K_PZ: Array, settings: FilterSettings) -> tuple[Array, Array, Array, Array]:
    """Return modes, step, push and volts of one panel; K_PZ: (3, n_c)."""
    modes = clamped_modes(one_element_beam(panel), 0.0, np.inf)
    shapes = modes.shapes[BENDING, :]
    steps, pushes = zip(
        *(
            sampled_filter(settings.frequency[m] * modes.omega[m], settings.damping[m], prior.control.period)
            for m in range(N_BENDING)
        ),
        strict=True,
    )
    # Least volts that give a modal force: forces at the tip are reached by the channels as far as they reach.
    force = np.linalg.pinv(shapes.T @ K_PZ[BENDING], rcond=LEAST_REACH)
    collocated = prior.actuators.piezo.array == "generalized"
    volts = force * (np.array([settings.gain[0], settings.gain[1] * collocated]) * modes.omega**2)
    swing = abs(settings.swing / shapes[0, 0])  # amplitude of the first mode; its filter swings by 1 / (2 zeta) of it
    largest = np.abs(volts[:, 0]).max() * swing / (2.0 * settings.damping[0])
    volts *= min(1.0, prior.actuators.piezo.voltage / max(largest, 1.0e-300))
    return np.asarray(np.linalg.inv(shapes)), np.array(steps), np.array(pushes), volts


def sampled_filter(omega: float, zeta: float, period: float) -> tuple[Array, Array]:
    """Return the exact step (2, 2) of ``nudd + 2 zeta w nud + w^2 nu = w^2 x``, and its response (2,) to held ``x``."""
    rates = np.zeros((3, 3))  # of [nu, nud, x]
    rates[0, 1], rates[1] = 1.0, (-(omega**2), -2.0 * zeta * omega, omega**2)
    step = expm(period * rates)
    return step[:2, :2], step[:2, 2]


@kernel
def feed_back(law, i, x, filters, volts):
    """Add the volts (n_c,) of panel ``i`` that its filters (2, 2) give, and let these go on for a control period.

    law: :class:`PositionFeedback`; x: (4,) deviation of q5, q6 (and of their rates) from the quasi-static motion.
    """
    for m in range(len(filters)):
        displacement = law.modes[i, m, 0] * x[0] + law.modes[i, m, 1] * x[1]
        nu, nud = filters[m, 0], filters[m, 1]
        for c in range(len(volts)):
            volts[c] += law.volts[i, c, m] * nu
        for k in range(len(law.step[i, m])):
            filters[m, k] = law.step[i, m, k, 0] * nu + law.step[i, m, k, 1] * nud + law.push[i, m, k] * displacement
