"""The benchmark's page ``results.md`` and its ``leaderboard.json``: every number with the command that made it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from sffr_baselines.laws import ORACLES
from sffr_baselines.settings import TunedDamping, load_settings
from sffr_gym import ConfigError
from sffr_gym.config.files import to_json
from sffr_gym.config.provenance import package_version
from sffr_gym.config.reading import read_json
from sffr_gym.config.sections import Section
from sffr_gym.task.score import REFERENCE, WEIGHTS, Result
from sffr_workbench.benchmark.episodes import Plan
from sffr_workbench.benchmark.figures import FIGURE_FILES, draw_benchmark_figures
from sffr_workbench.benchmark.scores import SuiteScores, by_scenario
from sffr_workbench.common import markdown_table
from sffr_workbench.common.numbers import format_difference, format_estimate, format_number
from sffr_workbench.evaluation import check_record

RESULTS_FILE, LEADERBOARD_FILE, IMAGES = "results.md", "leaderboard.json", "images"
CAPTIONS = (
    "Interquartile mean of the episodes' costs, with 95 % intervals",
    "Performance profiles: share of episodes whose cost is at most the threshold, on the left the part near AHSC",
    "Paired differences of cost to AHSC, episode by episode",
    "Vibration against piezo effort in each scenario, both relative to AHSC's",
)
DIGITS = 6  # of the leaderboard's numbers, which are the same on any machine

Number = float | None  # null if it was not finite


class Entry(Section):
    """A policy in the leaderboard."""

    policy: str = Field(min_length=1, description="name")
    suite: str = Field(description="hash of everything that defines the episodes")
    version: str | None = Field(description="of sffr-gym")
    command: str = Field(description="that made it")
    seed: int = Field(ge=0, description="of the first episode")
    episodes: int = Field(ge=1, description="of each scenario that draws anything")
    cost: Number = Field(description="relative to AHSC, with its 95 % interval")
    cost_interval: tuple[Number, Number] = Field(description="lower and upper end")
    typical_cost: Number = Field(description="interquartile mean, with its 95 % interval")
    typical_cost_interval: tuple[Number, Number] = Field(description="lower and upper end")
    better_than_ahsc: Number = Field(ge=0.0, le=1.0, description="probability")
    failed: int = Field(ge=0, description="number of episodes that failed")
    ratios: dict[str, Number] = Field(description="of the measures to AHSC's")
    scenarios: dict[str, Number] = Field(description="cost in each")


def page_names(draw: bool = True) -> list[str]:
    """Return the names of page, leaderboard and, unless they are not drawn, figures."""
    return [f"{IMAGES}/{name}" for name in FIGURE_FILES] * draw + [LEADERBOARD_FILE, RESULTS_FILE]


def make_pages(
    plan: Plan, results: Sequence[Result], scores: SuiteScores, command: str, draw: bool = True
) -> dict[str, bytes]:
    """Return the contents of page, leaderboard and figures, by their names.

    Args:
        plan: what was run.
        results: its episodes.
        scores: theirs.
        command: as a reader would type it.
        draw: also draw the figures.

    Raises:
        ModuleNotFoundError: if figures are asked for without matplotlib.
    """
    figures = draw_benchmark_figures(scores) if draw else {}
    board, page = leaderboard(plan, scores, command), results_page(plan, results, scores, command, draw)
    contents = (*figures.values(), to_json(board).encode(), page.encode())
    return dict(zip(page_names(draw), contents, strict=True))


def leaderboard(plan: Plan, scores: SuiteScores, command: str) -> list[dict[str, Any]]:
    """Return an entry for each policy, the lowest cost first: policy, suite, version, command, numbers."""
    suite, version = plan.suite, package_version("sffr-gym")
    what = {"suite": suite, "version": version, "command": command, "seed": plan.seed, "episodes": plan.episodes}
    entries = []
    for policy in ranked(scores):
        score = scores.overall[policy]
        numbers = {
            "cost": score.cost.value,
            "cost_interval": [score.cost.low, score.cost.high],
            "typical_cost": score.typical.value,
            "typical_cost_interval": [score.typical.low, score.typical.high],
            "better_than_ahsc": score.improvement,
            "failed": score.failed,
            "ratios": score.ratios,
            "scenarios": {name: own[policy].cost.value for name, own in scores.single.items()},
        }
        entries.append({"policy": policy, **what, **_rounded(numbers)})
    return entries


def read_leaderboard(file: Path) -> list[dict[str, Any]]:
    """Return the entries of a leaderboard.

    Raises:
        ConfigError: if it cannot be read, or holds anything else.
    """
    entries = read_json(file)
    if not isinstance(entries, list):
        raise ConfigError(f"{file}: must hold a list of entries")
    for number, entry in enumerate(entries, 1):
        check_record(Entry, entry, f"{file}: entry {number}")
    return entries


def ranked(scores: SuiteScores) -> list[str]:
    """Return the policies, the lowest cost first."""
    return sorted(scores.policies, key=lambda policy: scores.overall[policy].cost.value)


def results_page(plan: Plan, results: Sequence[Result], scores: SuiteScores, command: str, figures: bool = True) -> str:
    """Return the page as Markdown."""
    many = f"{plan.episodes} episodes" if plan.episodes > 1 else "one episode"
    parts = [
        "# Results of the benchmark",
        f"Version {package_version('sffr-gym')}, suite `{plan.suite}`: {', '.join(scores.scenarios)}; {many} of each "
        f"policy in each scenario that draws anything, from seed {plan.seed}, the same for all. Everything is relative "
        "to AHSC on the same episodes; lower is better. [benchmark.md](benchmark.md) says how it is scored. This page "
        "is written by the command that stands with each table and figure.",
        "## Standings",
        _overall(scores),
        "Cost: from the ratios of means, averaged over the scenarios. Typical: interquartile mean of the episodes' own "
        "costs. Less AHSC: interquartile mean of the paired differences. Better: probability that an episode costs "
        f"less than under {REFERENCE}. In brackets 95 % intervals of the stratified bootstrap. `{command}`",
        "## Cost in each scenario",
        _single(scores),
        f"From the ratios of means, with 95 % intervals. `{command}`",
    ]
    for name, caption in zip(FIGURE_FILES if figures else (), CAPTIONS, strict=False):
        parts += [f"![{caption}]({IMAGES}/{name})", f"{caption}. `{command}`"]
    parts += ["## Measures", *_measures(scores), f"Ratios of means over the episodes to AHSC's. `{command}`"]
    if models := _oracles(results):
        parts += [
            "## With the right model",
            models,
            "Object position error, mean of the episodes' root mean squares [um]: the law that believes in the nominal "
            f"robot, and its oracle that is told each episode's plant. `{command}`",
        ]
    if failures := _failures(results):
        parts += ["## Failed episodes", failures, f"Each counts as ten times AHSC's. `{command}`"]
    if "hsc-tuned" in scores.policies:
        parts += ["## What tuning found", _tuned(plan)]
    return "\n\n".join(parts) + "\n"


def _overall(scores: SuiteScores) -> str:
    rows = []
    for policy in ranked(scores):
        score = scores.overall[policy]
        rows.append(
            [
                f"`{policy}`",
                format_estimate(score.cost),
                format_estimate(score.typical),
                format_difference(score.difference),
            ]
            + [format_number(value) for value in score.ratios.values()]
            + [f"{100.0 * score.improvement:.0f} %", f"{score.failed}/{score.episodes}"]
        )
    head = ["policy", "cost", "typical", "less AHSC", *(f"{name} ratio" for name in WEIGHTS), "better", "failed"]
    return markdown_table(head, rows)


def _single(scores: SuiteScores) -> str:
    order = ranked(scores)
    rows = [[name, *(format_estimate(own[policy].cost) for policy in order)] for name, own in scores.single.items()]
    return markdown_table(["scenario", *(f"`{policy}`" for policy in order)], rows)


def _measures(scores: SuiteScores) -> list[str]:
    """Return the ratios of means in each scenario, a table for each measure of the cost."""
    parts, order = [], ranked(scores)
    for name, weight in WEIGHTS.items():
        rows = [[key, *(format_number(own[p].ratios[name]) for p in order)] for key, own in scores.single.items()]
        parts.append(f"`{name}`, weight {weight:.2f}:")
        parts.append(markdown_table(["scenario", *(f"`{policy}`" for policy in order)], rows))
    return parts


def _oracles(results: Sequence[Result]) -> str:
    """Return the tracking of each law beside that of its oracle, wherever the oracle ran."""
    rows = []
    for scenario, group in by_scenario(results).items():
        for policy, oracle in ORACLES.items():
            if policy in group and oracle in group:
                errors = [1.0e6 * np.mean([r.measures["track_rmse"] for r in group[name]]) for name in (policy, oracle)]
                rows.append([f"{scenario}, `{policy}`", *map(format_number, map(float, errors))])
    return markdown_table(["scenario, policy", "wrong model", "right model"], rows) if rows else ""


def _failures(results: Sequence[Result]) -> str:
    counts: dict[tuple[str, str, str], int] = {}
    for result in results:
        if result.failure:
            key = (result.scenario, f"`{result.policy}`", result.failure)
            counts[key] = counts.get(key, 0) + 1
    rows = [[*key, str(count)] for key, count in counts.items()]
    return markdown_table(["scenario", "policy", "why", "episodes"], rows) if rows else ""


def _tuned(plan: Plan) -> str:
    """Return the numbers of ``hsc-tuned`` and where they come from."""
    tuned, start = load_settings("hsc-tuned"), TunedDamping.start(plan.params)
    assert isinstance(tuned, TunedDamping) and tuned.found is not None
    found = tuned.found
    rows = [
        ["`hsc`", format_number(start.q5), format_number(start.q6), f"{found.start_cost:.4f}"],
        ["`hsc-tuned`", format_number(tuned.q5), format_number(tuned.q6), f"{found.cost:.4f}"],
    ]
    head = ["policy", "q5 [N s/m]", "q6 [N m s/rad]", "cost on the training episodes"]
    return f"{markdown_table(head, rows)}\n\nConstant virtual damping, found on {found.date}. `{found.command}`"


def _rounded(values: Any) -> Any:
    """Round every number to the digits that any machine gives."""
    if isinstance(values, dict):
        return {name: _rounded(value) for name, value in values.items()}
    if isinstance(values, list | tuple):
        return [_rounded(value) for value in values]
    return float(f"{values:.{DIGITS}g}") if isinstance(values, float) else values
