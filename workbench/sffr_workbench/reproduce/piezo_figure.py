"""What each piezo array can do to the modes of a panel: the one the law assumes, at the root, and at the tip."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sffr_gym.config.params import Params
from sffr_gym.physics.beam import N_TIP
from sffr_gym.physics.piezo import authority
from sffr_gym.types import Array
from sffr_workbench.figures.style import SERIES, canvas, legend
from sffr_workbench.reproduce.paper_figures import CaptionedFigure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ARRAYS = {
    "generalized": "a channel for each tip coordinate (the paper's law)",
    "patches": "bonded patches near the root",
    "tip": "bonded patches at the tip (the paper's place)",
}
ELEMENTS = 16  # enough for the shapes of the modes that are shown
BENDING = 4  # modes that are shown


def piezo_figure(params: Params) -> CaptionedFigure:
    """Draw the arrays' authority."""
    return CaptionedFigure(
        "piezo_authority.png", "What each piezo array can do to the modes",
        "Left: tip displacement by which all channels of an array at full voltage hold a linear panel, clamped, in "
        f"each of its first {BENDING} bending modes. Right: curvature of these modes along the panel, which a bonded "
        "patch works on. The first mode has none at the tip, so a patch there hardly reaches it; one "
        "near the root does.",
        _figure(params),
    )  # fmt: skip


def held_displacement(params: Params, array: str) -> Array:
    """Return the tip displacement (BENDING,) [m] of each bending mode under all channels at full voltage."""
    modes, force = authority(params, array)
    bending = slice(modes.n_axial, modes.n_axial + BENDING)
    most = params.actuators.piezo.voltage * np.abs(force[bending]).sum(axis=1)
    return most * np.abs(modes.shapes[-N_TIP + 1, bending]) / modes.omega[bending] ** 2


def _figure(params: Params) -> Figure:
    from matplotlib.ticker import EngFormatter

    fine = params.with_overrides(f"panel.elements={ELEMENTS}")
    figure, axes = canvas(1, 2, 3.4)
    bars, along = axes[0]
    mode_numbers = np.arange(1, BENDING + 1)
    for k, (array, label) in enumerate(ARRAYS.items()):
        bars.bar(mode_numbers + 0.27 * (k - 1), held_displacement(fine, array), 0.25, color=SERIES[k], label=label)
    bars.set(yscale="log", xlabel="bending mode", ylabel="held tip displacement")
    bars.yaxis.set_major_formatter(EngFormatter("m"))
    bars.set_xticks(mode_numbers)
    modes, _ = authority(fine, "generalized")
    length = fine.panel.length
    for mode, colour in zip(range(BENDING), ("#000000", "#E69F00", "#56B4E9", "#882255"), strict=True):
        w = np.append([0.0, 0.0, 0.0], modes.shapes[:, modes.n_axial + mode]).reshape(-1, N_TIP)
        x, curvature = curvature_along(w, length)
        along.plot(x, curvature / np.abs(curvature).max(), color=colour, lw=1.3, label=f"mode {mode + 1}")
    piezo = fine.actuators.piezo
    for colour, patches in (SERIES[1], piezo.patches), (SERIES[2], piezo.tip):
        for start, stop in patches:
            along.axvspan(start * length, stop * length, color=colour, alpha=0.25, lw=0)
    along.set(xlabel="distance from the root [m]", ylabel="curvature, scaled")
    along.margins(x=0.0)
    along.legend(ncols=2, fontsize=8)
    return legend(figure, bars)


def curvature_along(nodes: Array, length: float) -> tuple[Array, Array]:
    """Return the places [m] and curvature of a panel's line from its nodes (elements + 1, 3), element by element."""
    step, xi = length / (len(nodes) - 1), np.linspace(0.0, 1.0, 12)
    second = np.column_stack([-6 + 12 * xi, step * (-4 + 6 * xi), 6 - 12 * xi, step * (6 * xi - 2)]) / step**2
    ends = np.hstack([nodes[:-1, 1:], nodes[1:, 1:]])  # w and slope at both ends of each element
    places = step * (np.arange(len(ends))[:, None] + xi)
    return places.ravel(), (ends @ second.T).ravel()
