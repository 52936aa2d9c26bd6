"""Figures of the scores: costs with intervals, performance profiles, differences to AHSC, vibration against effort."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sffr_gym.task.score import REFERENCE
from sffr_gym.task.statistics import CONFIDENCE, Estimate, performance_profile, resample
from sffr_workbench.benchmark.scores import SuiteScores
from sffr_workbench.common import format_number
from sffr_workbench.figures.style import canvas, draw_figures, legend, plain, policy_colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FIGURE_FILES = (
    "benchmark-intervals.png", "benchmark-profiles.png", "benchmark-differences.png", "benchmark-tradeoff.png"
)  # fmt: skip
COLUMNS = 5  # of the grid of scenarios
BESIDE = 13  # policies beside each other
MARKERS = "osD^vP"
NARROWEST = 6.5  # inches, in which the words below a figure find room
EDGE = 1.25  # cost beyond which an interquartile mean is written instead of drawn
RESAMPLES = 500  # of the profiles
NEAR = 1.6  # cost up to which they are shown at large
EFFORTS, VIBRATIONS = (0.1, 6.0), (0.2, 3.0)  # ratios to AHSC's that the trade-off shows


def draw_benchmark_figures(scores: SuiteScores) -> dict[str, bytes]:
    """Draw all figures and return the contents of their PNG files, by name.

    Raises:
        ConfigError: see :func:`sffr_workbench.figures.style.load_matplotlib`.
    """
    return draw_figures(dict(zip(FIGURE_FILES, (intervals, profiles, differences, tradeoff), strict=True)), scores)


def intervals(scores: SuiteScores) -> Figure:
    """Draw interquartile means of the episodes' costs with their intervals, over the suite and in each scenario.

    Costs far above AHSC's are written at the edge, so that the others can be told apart.
    """
    from matplotlib.figure import Figure

    groups = {"all scenarios": scores.overall} | (scores.single if len(scores.scenarios) > 1 else {})
    columns = min(COLUMNS, len(groups))
    rows = -(-len(groups) // columns)
    size = max(2.0 * columns + 1.2, NARROWEST), 0.55 + rows * (0.55 + 0.2 * len(scores.policies))
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    colours = policy_colours(scores.policies)
    for axes, (title, group) in zip(grid.flat, groups.items(), strict=False):
        axes.set_title(plain(title), fontweight="bold" if title == "all scenarios" else "normal")
        axes.axvline(1.0, color="#555555", linewidth=0.8, zorder=1.0)
        for row, policy in enumerate(scores.policies):
            if group[policy].typical.value <= EDGE:
                _bar(axes, row, group[policy].typical, colours[policy])
            else:
                text = f"{format_number(group[policy].typical.value)} →"
                axes.text(EDGE, row, text, color=colours[policy], ha="right", va="center", fontsize=8)
    for axes in grid.flat[len(groups) :]:
        axes.set_visible(False)
    grid[0, 0].set_yticks(range(len(scores.policies)), list(map(plain, scores.policies)))
    grid[0, 0].set_ylim(len(scores.policies) - 0.5, -0.5)
    grid[0, 0].set_xlim(right=EDGE)
    figure.supxlabel("cost of an episode relative to AHSC's: interquartile mean, 95 % interval", fontsize=9)
    return figure


def profiles(scores: SuiteScores) -> Figure:
    """Draw the share of episodes whose cost is at most a threshold, over all scenarios, with pointwise intervals."""
    costs = np.concatenate([values.ravel() for values in scores.costs.values()])
    low, high = 0.9 * costs.min(), 1.1 * costs.max(where=np.isfinite(costs), initial=0.0)
    figure, ((near, whole),) = canvas(1, 2, 3.6, sharey=True)
    tail, colours = 0.5 * (1.0 - CONFIDENCE), policy_colours(scores.policies)
    for policy in scores.policies:
        thresholds = np.array([low, *np.unique(scores.costs[policy][scores.costs[policy] < high]), high])
        share = performance_profile(scores.costs[policy], thresholds)
        drawn = performance_profile(resample(scores.costs[policy], RESAMPLES), thresholds)
        band = np.quantile(drawn, [tail, 1.0 - tail], axis=0)
        for axes in near, whole:
            axes.fill_between(thresholds, *band, color=colours[policy], alpha=0.2, linewidth=0.0, step="post")
            axes.step(thresholds, share, color=colours[policy], label=plain(policy), where="post", linewidth=1.6)
    near.set_xlim(low, NEAR)
    _logarithmic(whole, "x")
    whole.set_xlim(low, high)
    near.set_ylim(0.0, 1.02)
    near.set_ylabel("share of episodes up to this cost")
    figure.supxlabel("cost relative to AHSC's on the same episode", fontsize=9)
    return legend(figure, near)


def differences(scores: SuiteScores) -> Figure:
    """Draw the difference of cost to AHSC of every episode, and its interquartile mean with interval, by scenario."""
    from matplotlib.figure import Figure

    policies = [policy for policy in scores.policies if policy != REFERENCE] or [REFERENCE]
    rows = -(-len(policies) // BESIDE)
    columns = -(-len(policies) // rows)
    size = max(1.3 + 1.9 * columns, NARROWEST), 0.3 + rows * (0.6 + 0.34 * len(scores.scenarios))
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(rows, columns, sharey=True, squeeze=False)
    colours = policy_colours(scores.policies)
    for axes, policy in zip(grid.flat, policies, strict=False):
        axes.set_title(plain(policy))
        axes.axvline(0.0, color="#555555", linewidth=0.8, zorder=1.0)
        for row, scenario in enumerate(scores.scenarios):
            values = np.unique(scores.differences[policy][:, row])
            axes.plot(values, np.full(len(values), row + 0.22), ".", color=colours[policy], alpha=0.45, markersize=4.0)
            _bar(axes, row - 0.12, scores.single[scenario][policy].difference, colours[policy])
        axes.margins(x=0.12)
        axes.locator_params(axis="x", nbins=3)
    for axes in grid.flat[len(policies) :]:
        axes.set_visible(False)
    grid[0, 0].set_yticks(range(len(scores.scenarios)), list(map(plain, scores.scenarios)))
    grid[0, 0].set_ylim(len(scores.scenarios) - 0.4, -0.6)
    figure.supxlabel(
        "cost less AHSC's on the same episode: episodes (dots), interquartile mean, 95 % interval", fontsize=9
    )
    return figure


def tradeoff(scores: SuiteScores) -> Figure:
    """Draw each policy's vibration against its piezo effort in every scenario, both relative to AHSC's.

    Policies far from it, or with their piezos off, are left out.
    """
    from matplotlib.figure import Figure

    columns = min(COLUMNS, len(scores.scenarios))
    rows = -(-len(scores.scenarios) // columns)
    side = max(2.0, NARROWEST / columns)
    figure = Figure(figsize=(side * columns + 1.0, 1.6 + 0.8 * side * rows), layout="constrained")
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    colours = policy_colours(scores.policies)
    markers = _markers(colours, scores.policies)
    for axes, scenario in zip(grid.flat, scores.scenarios, strict=False):
        axes.set_title(plain(scenario))
        axes.axhline(1.0, color="#BBBBBB", linewidth=0.8, zorder=1.0)
        axes.axvline(1.0, color="#BBBBBB", linewidth=0.8, zorder=1.0)
        for policy in scores.policies:
            ratios = scores.single[scenario][policy].ratios
            axes.plot(
                [ratios["piezo_effort"]], [ratios["vibration"]], markers[policy], color=colours[policy], markersize=5.0,
                alpha=0.85, label=plain(policy), zorder=3.0,
            )  # fmt: skip
    for axes in grid.flat[len(scores.scenarios) :]:
        axes.set_visible(False)
    for axes in grid.flat:
        _logarithmic(axes, "x", "y")
    grid[0, 0].set(xlim=EFFORTS, ylim=VIBRATIONS)
    figure.supxlabel("piezo effort relative to AHSC's", fontsize=9)
    figure.supylabel("vibration relative to AHSC's", fontsize=9)
    return legend(figure, grid[0, 0])


def _markers(colours: dict[str, str], policies: Sequence[str]) -> dict[str, str]:
    """Return a marker for each policy, another one wherever a colour comes again."""
    found: dict[str, str] = {}
    for k, policy in enumerate(policies):
        used = {found[other] for other in found if colours[other] == colours[policy]}
        turned = MARKERS[k % len(MARKERS) :] + MARKERS[: k % len(MARKERS)]
        found[policy] = next((marker for marker in turned if marker not in used), turned[0])
    return found


def _bar(axes: Axes, height: float, estimate: Estimate, colour: str) -> None:
    """Draw a value and its interval as a dot on a line."""
    axes.plot([estimate.low, estimate.high], [height, height], color=colour, linewidth=2.4, alpha=0.6, zorder=2.5)
    axes.plot([estimate.value], [height], "o", color=colour, markersize=4.5, zorder=3.0)


def _logarithmic(axes: Axes, *names: str) -> None:
    """Make axes, ``x`` or ``y``, logarithmic, with plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for name in names:
        axes.set(**{f"{name}scale": "log"})
        axis = axes.xaxis if name == "x" else axes.yaxis
        axis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
