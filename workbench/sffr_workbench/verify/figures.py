"""Figures of the page. matplotlib is imported where it is used, so that the checks run without it.

The background is transparent, and what is drawn in ``INK`` takes the colour of the page's text.
"""

from __future__ import annotations

import functools
import io
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sffr_gym.types import Array
from sffr_workbench.figures.style import drawing
from sffr_workbench.verify.motion import Motion

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK = "#8A8A8A"
# Okabe and Ito's colours, which colour-blind people can tell apart; the reference is the widest line.
COLOURS = ("#8A8A8A", "#56B4E9", "#D55E00", "#009E73", "#CC79A7", "#E69F00")
WIDTHS = (3.0, 2.0, 1.2, 1.2, 1.2, 1.2)
STYLE: dict[Any, Any] = {
    "font.size": 9, "axes.titlesize": 9, "axes.labelsize": 9, "legend.fontsize": 9, "axes.grid": True,
    "grid.color": INK, "grid.alpha": 0.25, "grid.linewidth": 0.6, "axes.spines.top": False, "axes.spines.right": False,
    "axes.edgecolor": INK, "axes.labelcolor": INK, "xtick.color": INK, "ytick.color": INK, "text.color": INK,
    "axes.facecolor": "none", "figure.facecolor": "none", "savefig.facecolor": "none", "legend.frameon": False,
    "axes.axisbelow": True, "svg.hashsalt": "verification", "axes.titlelocation": "left",
}  # fmt: skip
PANELS = ("left panel", "right panel")


def styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """Draw in the report's style."""

    @functools.wraps(draw)
    def drawn(*arguments: Any) -> Figure:
        with drawing(STYLE):
            return draw(*arguments)

    return drawn


@styled
def tips(curves: Mapping[str, Motion], reference: str) -> Figure:
    """Draw the transverse displacement of both tips, and differences from the reference below."""
    columns = {label: 1e3 * motion.tips[:, :, 1] for label, motion in curves.items()}
    return _compared(curves[reference].t, columns, reference, [f"tip of the {name}" for name in PANELS], ["mm"] * 2)


@styled
def base(curves: Mapping[str, Motion], reference: str) -> Figure:
    """Draw place and yaw of the base, and differences from the reference below."""
    columns = {label: 1e3 * (motion.base - motion.base[0]) for label, motion in curves.items()}
    names = [f"{name} of the base" for name in ("x", "y", "yaw")]
    return _compared(curves[reference].t, columns, reference, names, ["mm", "mm", "mrad"])


@styled
def forces(t: Array, curves: Mapping[str, Array], reference: str) -> Figure:
    """Draw the force on the first gripper, and differences from the reference below."""
    columns = {label: lam[:, 0] for label, lam in curves.items()}
    return _compared(t, columns, reference, [f"force on gripper 1 along {axis}" for axis in "xy"], ["N"] * 2)


@styled
def levels(newtons: Sequence[float], series: Mapping[str, Sequence[float]]) -> Figure:
    """Draw the relative tip difference over the force of the pulse."""
    figure, axes = _grid(1, 1, height=3.4)
    ax = axes[0][0]
    for (label, values), colour in zip(series.items(), [COLOURS[i] for i in (2, 5, 3, 4)], strict=True):
        ax.plot(newtons, 100 * np.asarray(values), "o-", color=colour, markersize=4, linewidth=1.4)
        ax.annotate(label, (newtons[0], 100 * values[0]), (-6, 0), textcoords="offset points", ha="right", va="center",
                    color=colour)  # fmt: skip
    ax.set(xscale="log", yscale="log", xlabel="force of the pulse [N]")
    ax.set_title("tip difference from Exudyn, rms [%]")
    ax.set_xlim(newtons[0] / 2.6, newtons[-1] * 1.2)
    ax.set_xticks(list(newtons), [f"{force:g}" for force in newtons])
    ax.set_yticks([0.1, 1.0, 10.0], ["0.1", "1", "10"])
    ax.minorticks_off()
    return figure


@styled
def convergence(errors: Mapping[str, tuple[Sequence[float], Sequence[float]]]) -> Figure:
    """Draw the largest difference from us over what each peer refines."""
    figure, axes = _grid(1, len(errors), height=2.9)
    for ax, (label, (values, found)), colour, order in zip(axes[0], errors.items(), COLOURS[1:], (1, 2), strict=False):
        ax.plot(values, found, "o-", color=colour, markersize=5, linewidth=1.6)
        guide = [found[0] * (value / values[0]) ** order for value in values]
        ax.plot(values, guide, "--", color=INK, linewidth=1.0)
        ax.annotate(f"order {order}", (values[1], guide[1]), (6, -10), textcoords="offset points")
        engine, quantity = label.split(", ")
        ax.set(xscale="log", yscale="log", xlabel=quantity)
        ax.set_xticks(list(values), [f"{value:g}" for value in values])
        ax.minorticks_off()
        ax.set_ylim(10.0 ** np.floor(np.log10(min(found))), 10.0 ** np.ceil(np.log10(max(found))))
        ax.set_title(f"difference from {engine} [m]")
    return figure


@styled
def steps(errors: Mapping[str, tuple[Sequence[float], Sequence[float]]]) -> Figure:
    """Draw the distance of the tips from the exact coupling over the step of each method."""
    figure, axes = _grid(1, 1, width=5.6, height=3.4)
    ax = axes[0][0]
    for (label, (values, found)), colour in zip(errors.items(), COLOURS[1:], strict=False):
        milliseconds = 1e3 * np.asarray(values)
        slope = np.polyfit(np.log(values), np.log(found), 1)[0]
        ax.plot(milliseconds, found, "o-", color=colour, markersize=5, linewidth=1.6)
        middle = len(values) // 2
        ax.annotate(f"{label}\nslope {slope:.1f}", (milliseconds[middle], found[middle]), (6, -6), color=colour,
                    textcoords="offset points", va="top")  # fmt: skip
    ax.set(xscale="log", yscale="log", xlabel="step [ms]")
    ax.set_xlim(None, 8.0)
    ax.set_ylim(1.0e-2 * min(min(found) for _, found in errors.values()), None)
    ax.xaxis.set_major_formatter("{x:g}")
    ax.set_title("largest distance of a tip [m]")
    return figure


def svg(figure: Figure) -> str:
    """Return a figure as an SVG element of a page, in whose colour of text it draws axes and labels."""
    buffer = io.StringIO()
    with drawing(STYLE):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :].replace(INK.lower(), "currentColor")


def _compared(
    t: Array, curves: Mapping[str, Array], reference: str, names: Sequence[str], units: Sequence[str]
) -> Figure:
    """Draw the columns of curves (k, n) over time, and below their differences from those of the reference."""
    figure, axes = _grid(2, len(names), height=4.6)
    for i, (name, unit) in enumerate(zip(names, units, strict=True)):
        upper, lower = axes[0][i], axes[1][i]
        upper.set_title(f"{name} [{unit}]")
        lower.set_title(f"difference from {reference} [{unit}]")
        lower.set_xlabel("time [s]")
        for (label, values), colour, width in zip(curves.items(), COLOURS, WIDTHS, strict=False):
            style = {"color": colour, "linewidth": width}
            upper.plot(t, values[:, i], label=label, **style)
            if label != reference:
                lower.plot(t, (values - curves[reference])[:, i], **style)
    return _legend(figure, axes[0][0])


def _grid(rows: int, columns: int, width: float = 9.0, height: float = 3.0) -> tuple[Figure, NDArray[Any]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, sharex=rows > 1)


def _legend(figure: Figure, ax: Axes) -> Figure:
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=len(labels), frameon=False, labelcolor=INK)
    return figure
