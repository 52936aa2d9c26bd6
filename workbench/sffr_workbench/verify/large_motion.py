"""Checks of the foreshortened panel: large swings and fast turns against a geometrically exact beam, and its energy."""

from __future__ import annotations

from functools import partial

import numpy as np

from sffr_gym.config.params import Params, load_params
from sffr_gym.types import Array
from sffr_workbench.verify import exudyn_robot, foreshortening, motion
from sffr_workbench.verify.check import Check, make_check
from sffr_workbench.verify.conservation import SWINGING, UNDAMPED, conserved
from sffr_workbench.verify.fig5 import CABLES, tip_difference
from sffr_workbench.verify.motion import UNLIKE, Piece

ON = "panel.foreshortening=true"
ELEMENTS = 8
SECONDS = 20.0


def checks(quick: bool) -> list[partial[Check]]:
    """List the checks of this module."""
    listed = [
        partial(against_exact_beam, "swings of 0.31 m", np.array([5.0, 0.0, 1.25]), 0.002),
        partial(against_exact_beam, "a base that turns at 0.23 rad/s", np.array([0.0, 0.0, 5.5]), 0.005),
        partial(against_exact_beam, "panels that differ", np.array([5.0, 0.0, 1.25]), 0.002, UNLIKE),
        partial(conserved, "foreshortened panels", _bent("initial.qf=[0, 0.3, 0.1]", SWINGING, UNDAMPED)),
    ]
    return listed if quick else [*listed, partial(points_of_mass), partial(points_of_mass, UNLIKE)]


def against_exact_beam(name: str, wrench: Array, allowed: float, changes: tuple[str, ...] = ()) -> Check:
    """Check the tips after a push of a second on the base, panels of eight elements."""
    params = motion.at_rest("object=null", f"panel.elements={ELEMENTS}", *changes)
    still = np.zeros(params.n_links)
    pieces = [Piece(1.0, wrench, still), Piece(SECONDS - 1.0, np.zeros(3), still)]
    exact = exudyn_robot.simulate(params, pieces, CABLES)
    linear, bent = (motion.simulate(each, pieces) for each in (params, params.with_overrides(ON)))
    turns = np.abs(np.gradient(exact.base[:, 2], exact.t)).max()
    return make_check(
        f"Tips, {name}, panels that keep their length", "Exudyn, ANCF cables", tip_difference(bent, exact), allowed, "",
        f"Rms relative, {SECONDS:g} s; a linear beam of as many elements is {tip_difference(linear, exact):.1%} off. "
        f"Tips swing up to {np.abs(exact.tips[..., 1]).max():.2f} m, the base turns at up to {turns:.2f} rad/s.",
    )  # fmt: skip


def points_of_mass(changes: tuple[str, ...] = ()) -> Check:
    """Check the same equations by another derivation: points of mass with full Jacobians, and all modes."""
    params, pieces = motion.at_rest("object=null", f"panel.elements={ELEMENTS}", *changes), motion.pulse(2.5)
    found, known = motion.simulate(params.with_overrides(ON), pieces), foreshortening.simulate(params, pieces)
    swings = np.abs(known.tips[..., 1]).max()
    return make_check(
        f"Tips, swings of {swings:.2f} m, panels that {'differ and ' if changes else ''}keep their length",
        "points of mass along the panels, all modes",
        tip_difference(found, known), 0.001, "",
        "Rms relative, 20 s: what the three slowest modes and four points of mass leave out.",
    )  # fmt: skip


def _bent(*changes: str) -> Params:
    return load_params().with_overrides("object=null", ON, *changes)
