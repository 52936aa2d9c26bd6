"""Figures of the standings: costs with their intervals, performance profiles, paired differences to AHSC.

matplotlib is imported where it is used, so that everything else runs without it.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from agents.benchmark.standings import Standings
from agents.evaluate import number
from agents.figures import DPI, STYLE, colours_of
from agents.files import write_whole
from agents.score import REFERENCE
from agents.statistics import CONFIDENCE, Estimate, performance_profile, resample

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURES = ("benchmark-intervals.png", "benchmark-profiles.png", "benchmark-differences.png")
COLUMNS = 5  # of the grid of scenarios
EDGE = 1.25  # cost beyond which an interquartile mean is written instead of drawn
RESAMPLES = 500  # of the profiles
NEAR = 1.6  # cost up to which they are shown at large


def save_pictures(folder: Path, table: Standings) -> list[Path]:
    """Draw all figures into a folder.

    Raises:
        ModuleNotFoundError: without matplotlib.
    """
    import matplotlib as mpl

    folder.mkdir(parents=True, exist_ok=True)
    painters: tuple[Callable[[Standings], Figure], ...] = (intervals, profiles, differences)
    files = []
    with mpl.rc_context(STYLE):
        for name, paint in zip(PICTURES, painters, strict=True):
            picture = io.BytesIO()
            paint(table).savefig(picture, format="png", dpi=DPI)
            files.append(write_whole(folder / name, picture.getvalue()))
    return files


def intervals(table: Standings) -> Figure:
    """Interquartile means of the episodes' costs with their intervals, over the suite and in each scenario.

    Costs far above AHSC's are written at the edge, so that the others can be told apart.
    """
    from matplotlib.figure import Figure

    groups = {"all scenarios": table.overall} | (table.single if len(table.scenarios) > 1 else {})
    columns = min(COLUMNS, len(groups))
    rows = -(-len(groups) // columns)
    figure = Figure(figsize=(2.0 * columns + 1.2, 0.55 + rows * (0.55 + 0.2 * len(table.policies))))
    figure.set_layout_engine("constrained")
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    colours = colours_of(table.policies)
    for axes, (title, scores) in zip(grid.flat, groups.items(), strict=False):
        axes.set_title(title, fontweight="bold" if title == "all scenarios" else "normal")
        axes.axvline(1.0, color="#555555", linewidth=0.8, zorder=1.0)
        for row, policy in enumerate(table.policies):
            if scores[policy].typical.value <= EDGE:
                _bar(axes, row, scores[policy].typical, colours[policy])
            else:
                text = f"{number(scores[policy].typical.value)} →"
                axes.text(EDGE, row, text, color=colours[policy], ha="right", va="center", fontsize=8)
    for axes in grid.flat[len(groups) :]:
        axes.set_visible(False)
    grid[0, 0].set_yticks(range(len(table.policies)), table.policies)
    grid[0, 0].set_ylim(len(table.policies) - 0.5, -0.5)
    grid[0, 0].set_xlim(right=EDGE)
    figure.supxlabel("cost of an episode relative to AHSC's: interquartile mean, 95 % interval", fontsize=9)
    return figure


def profiles(table: Standings) -> Figure:
    """Share of episodes whose cost is at most a threshold, pooled over the scenarios, with pointwise intervals."""
    from matplotlib.figure import Figure

    costs = np.concatenate([values.ravel() for values in table.costs.values()])
    low, high = 0.9 * costs.min(), 1.1 * costs.max(where=np.isfinite(costs), initial=0.0)
    figure = Figure(figsize=(10.0, 3.6), layout="constrained")
    near, whole = figure.subplots(1, 2, sharey=True)
    tail, colours = 0.5 * (1.0 - CONFIDENCE), colours_of(table.policies)
    for policy in table.policies:
        thresholds = np.array([low, *np.unique(table.costs[policy][table.costs[policy] < high]), high])
        share = performance_profile(table.costs[policy], thresholds)
        drawn = performance_profile(resample(table.costs[policy], RESAMPLES), thresholds)
        band = np.quantile(drawn, [tail, 1.0 - tail], axis=0)
        for axes in near, whole:
            axes.fill_between(thresholds, *band, color=colours[policy], alpha=0.2, linewidth=0.0, step="post")
            axes.step(thresholds, share, color=colours[policy], label=policy, where="post", linewidth=1.6)
    near.set_xlim(low, NEAR)
    _cost_axis(whole)
    whole.set_xlim(low, high)
    near.set_ylim(0.0, 1.02)
    near.set_ylabel("share of episodes up to this cost")
    figure.supxlabel("cost relative to AHSC's on the same episode", fontsize=9)
    figure.legend(*near.get_legend_handles_labels(), loc="outside upper center", ncols=len(table.policies))
    return figure


def differences(table: Standings) -> Figure:
    """Difference of cost to AHSC of every episode, and its interquartile mean with interval, by scenario."""
    from matplotlib.figure import Figure

    policies = [policy for policy in table.policies if policy != REFERENCE] or [REFERENCE]
    figure = Figure(figsize=(1.3 + 1.9 * len(policies), 0.9 + 0.34 * len(table.scenarios)), layout="constrained")
    grid = figure.subplots(1, len(policies), sharey=True, squeeze=False)[0]
    colours = colours_of(table.policies)
    for axes, policy in zip(grid, policies, strict=True):
        axes.set_title(policy)
        axes.axvline(0.0, color="#555555", linewidth=0.8, zorder=1.0)
        for row, scenario in enumerate(table.scenarios):
            values = np.unique(table.differences[policy][:, row])
            axes.plot(values, np.full(len(values), row + 0.22), ".", color=colours[policy], alpha=0.45, markersize=4.0)
            _bar(axes, row - 0.12, table.single[scenario][policy].difference, colours[policy])
        axes.margins(x=0.12)
        axes.locator_params(axis="x", nbins=3)
    grid[0].set_yticks(range(len(table.scenarios)), table.scenarios)
    grid[0].set_ylim(len(table.scenarios) - 0.4, -0.6)
    figure.supxlabel(
        "cost less AHSC's on the same episode: episodes (dots), interquartile mean, 95 % interval", fontsize=9
    )
    return figure


def _bar(axes: Axes, height: float, estimate: Estimate, colour: str) -> None:
    """A value and its interval as a dot on a line."""
    axes.plot([estimate.low, estimate.high], [height, height], color=colour, linewidth=2.4, alpha=0.6, zorder=2.5)
    axes.plot([estimate.value], [height], "o", color=colour, markersize=4.5, zorder=3.0)


def _cost_axis(axes: Axes) -> None:
    """A logarithmic axis of costs with plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
