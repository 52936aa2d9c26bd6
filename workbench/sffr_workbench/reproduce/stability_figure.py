"""Which control periods the virtual damping allows: growth of a clamped panel's vibration under a held damping."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sffr_baselines.stability import axial_alone, largest_stable_damping, sampled_growth
from sffr_gym.config.params import Params
from sffr_gym.physics.beam import N_TIP
from sffr_gym.physics.model import Model, pack
from sffr_gym.types import Array
from sffr_workbench.common import plural
from sffr_workbench.figures.style import SERIES, canvas
from sffr_workbench.reproduce.paper_figures import CaptionedFigure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PERIODS = np.geomspace(1.0e-4, 4.0e-3, 240)  # s
AXIAL = np.geomspace(30.0, 1.0e5, 240)  # N s/m
COARSE = 10  # periods at which the largest damping is sought
CAP = 1.6  # growth per period beyond which the picture tells no difference
ELEMENTS = (1, 2, 4, 8)
ALL_BENDING = "panel.bending_cut=1.0e+9"
UNDAMPED = "panel.strain_rate_damping=0"


def stability_figure(params: Params) -> CaptionedFigure:
    """Draw which control periods the virtual damping allows."""
    return CaptionedFigure(
        "stability.png", "Which control periods the virtual damping allows",
        "Left and middle: growth of a clamped panel's axial vibration per control period under an axial virtual "
        "damping that is held over the period; red is unstable. Dots: Table IV's B(0) at 0.5 ms, as run here, and "
        "at 2 ms. Lines: half an axial cycle (Nyquist), and a quarter (dashed), up to which the setting auto of "
        "suppression.coordinates damps it. Beyond, strain-rate damping decides whether the held force calms or "
        "feeds the mode. Right: the largest stable damping of the tip's slope if all bending modes are kept; more "
        "elements make the tip node lighter, which is why fast modes are cut by default (panel.bending_cut).",
        _figure(params),
    )  # fmt: skip


def _figure(params: Params) -> Figure:
    """Draw growth over period and axial damping with and without strain-rate damping, and the slope's largest."""
    from matplotlib.colors import TwoSlopeNorm

    figure, axes = canvas(1, 3, 3.9)
    norm = TwoSlopeNorm(1.0, 0.0, CAP)
    for each, changed in zip(axes[0], (params, params.with_overrides(UNDAMPED)), strict=False):
        model = pack(changed)
        growth = np.minimum(growth_map(model, PERIODS, AXIAL), CAP)
        mesh = each.pcolormesh(
            1e3 * PERIODS, AXIAL, growth, cmap="RdYlBu_r", norm=norm, shading="nearest", rasterized=True
        )
        each.contour(1e3 * PERIODS, AXIAL, growth, [1.0 + 1e-9], colors="black", linewidths=1.0)
        _mark(each, model, params)
        each.set_title(f"strain-rate damping {changed.panel.strain_rate_damping:g} s", loc="left")
        each.set(xscale="log", yscale="log", xlabel="control period [ms]")
    axes[0, 0].set_ylabel("axial virtual damping [N s/m]")
    figure.colorbar(mesh, ax=list(axes[0, :2]), label="growth per period", ticks=[0.0, 0.5, 1.0, 1.2, 1.4, CAP])
    slope, thinned = axes[0, 2], np.geomspace(PERIODS[0], PERIODS[-1], COARSE)
    for elements, colour in zip(ELEMENTS, SERIES, strict=True):
        model = pack(params.with_overrides(f"panel.elements={elements}", ALL_BENDING))
        largest = [largest_stable_damping(model, [0.0, 0.0, 1.0], np.ones(N_TIP), period) for period in thinned]
        slope.plot(1e3 * thinned, largest, color=colour, lw=1.4)
        name = plural(elements, "element")
        slope.annotate(name, (1e3 * thinned[0], largest[0]), (2, 6), textcoords="offset points", color=colour)
    slope.axhline(params.suppression.B0[2], color="black", lw=0.8, ls="--")
    slope.annotate("B(0)", (1e3 * thinned[-1], params.suppression.B0[2]), (-24, 4), textcoords="offset points")
    slope.set_title("largest stable damping of the slope", loc="left")
    slope.set(xscale="log", yscale="log", xlabel="control period [ms]", ylabel="[N m s/rad]")
    for each in axes[0]:
        each.set_xticks([0.1, 0.2, 0.5, 1.0, 2.0, 4.0], ["0.1", "0.2", "0.5", "1", "2", "4"])
        each.minorticks_off()
    return figure


def growth_map(model: Model, periods: Array, damping: Array) -> Array:
    """Return the growth per period (len(damping), len(periods)) of the axial vibration of a clamped panel."""
    axial, B = axial_alone(model), np.zeros((len(damping), N_TIP))
    B[:, 0] = damping
    return np.column_stack([sampled_growth(axial, B, np.ones(N_TIP), period) for period in periods])


def _mark(axes: Axes, model: Model, params: Params) -> None:
    """Mark the paper's damping at two periods, and the limits of the sampling."""
    axes.plot([0.5, 2.0], [params.suppression.B0[0]] * 2, "o", color="black", markersize=4)
    half = 1e3 * np.pi / np.sqrt(model.omega2[0, 0])
    axes.text(0.16, 100.0, "stable")
    axes.text(0.25, 6.0e4, "unstable", color="white")
    for period, style in (half, "-"), (half / 2, "--"):
        axes.axvline(period, color="#333333", lw=0.9, ls=style)
