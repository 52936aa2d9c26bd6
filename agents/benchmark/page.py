"""The benchmark's page ``results.md`` and its ``leaderboard.json``: every number with the command that made it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.benchmark.episodes import Plan
from agents.benchmark.pictures import PICTURES, save_pictures
from agents.benchmark.standings import Standings, by_scenario
from agents.evaluate import number
from agents.files import to_json, write_whole
from agents.run_folder import package_version
from agents.score import REFERENCE, WEIGHTS, Result
from agents.statistics import Estimate
from baselines.policies import ORACLES
from baselines.settings import load_damping

PAGE, LEADERBOARD, IMAGES = "results.md", "leaderboard.json", "images"
CAPTIONS = (
    "Interquartile mean of the episodes' costs, with 95 % intervals",
    "Performance profiles: share of episodes whose cost is at most the threshold, on the left the part near AHSC",
    "Paired differences of cost to AHSC, episode by episode",
)
DIGITS = 6  # of the leaderboard's numbers, which are the same on any machine


def write_pages(
    folder: Path, plan: Plan, results: Sequence[Result], table: Standings, command: str, draw: bool = True
) -> list[Path]:
    """Write page, leaderboard and figures into a folder.

    Args:
        folder: made if need be.
        plan: what was run.
        results: its episodes.
        table: their standings.
        command: as a reader would type it.
        draw: also draw the figures.

    Raises:
        ModuleNotFoundError: if figures are asked for without matplotlib; nothing is written then.
    """
    written = save_pictures(folder / IMAGES, table) if draw else []
    folder.mkdir(parents=True, exist_ok=True)
    board = leaderboard(plan, table, command)
    return [
        *written,
        write_whole(folder / LEADERBOARD, to_json(board).encode()),
        write_whole(folder / PAGE, page(plan, results, table, command, draw).encode()),
    ]


def leaderboard(plan: Plan, table: Standings, command: str) -> list[dict[str, Any]]:
    """One entry for each policy, the lowest cost first: policy, suite, version, command, numbers."""
    suite, version = plan.suite, package_version("sffr-gym")
    what = {"suite": suite, "version": version, "command": command, "seed": plan.seed, "episodes": plan.episodes}
    entries = []
    for policy in ranked(table):
        score = table.overall[policy]
        numbers = {
            "cost": score.cost.value,
            "cost_interval": [score.cost.low, score.cost.high],
            "typical_cost": score.typical.value,
            "typical_cost_interval": [score.typical.low, score.typical.high],
            "better_than_ahsc": score.improvement,
            "failed": score.failed,
            "ratios": score.ratios,
            "scenarios": {name: scores[policy].cost.value for name, scores in table.single.items()},
        }
        entries.append({"policy": policy, **what, **_rounded(numbers)})
    return entries


def read_leaderboard(file: Path) -> list[dict[str, Any]]:
    """The entries of a leaderboard."""
    entries: list[dict[str, Any]] = json.loads(file.read_text(encoding="utf-8"))
    return entries


def ranked(table: Standings) -> list[str]:
    """Policies, the lowest cost first."""
    return sorted(table.policies, key=lambda policy: table.overall[policy].cost.value)


def page(plan: Plan, results: Sequence[Result], table: Standings, command: str, pictures: bool = True) -> str:
    """The page as Markdown."""
    many = f"{plan.episodes} episodes" if plan.episodes > 1 else "one episode"
    parts = [
        "# Results of the benchmark",
        f"Version {package_version('sffr-gym')}, suite `{plan.suite}`: {', '.join(table.scenarios)}; {many} of each "
        f"policy in each scenario that draws anything, from seed {plan.seed}, the same for all. Everything is relative "
        "to AHSC on the same episodes; lower is better. [benchmark.md](benchmark.md) says how it is scored. This page "
        "is written by the command that stands with each table and figure.",
        "## Standings",
        _overall(table),
        "Cost: from the ratios of means, averaged over the scenarios. Typical: interquartile mean of the episodes' own "
        "costs. Less AHSC: interquartile mean of the paired differences. Better: probability that an episode costs "
        f"less than under {REFERENCE}. In brackets 95 % intervals of the stratified bootstrap. `{command}`",
        "## Cost in each scenario",
        _single(table),
        f"From the ratios of means, with 95 % intervals. `{command}`",
    ]
    for name, caption in zip(PICTURES if pictures else (), CAPTIONS, strict=False):
        parts += [f"![{caption}]({IMAGES}/{name})", f"{caption}. `{command}`"]
    parts += ["## Measures", *_measures(table), f"Ratios of means over the episodes to AHSC's. `{command}`"]
    if models := _right_models(results):
        parts += [
            "## With the right model",
            models,
            "Object position error, mean of the episodes' root mean squares [um]: the law that believes in the nominal "
            f"robot, and its oracle that is told each episode's plant. `{command}`",
        ]
    if failures := _failures(results):
        parts += ["## Failed episodes", failures, f"Each counts as ten times AHSC's. `{command}`"]
    if "hsc-tuned" in table.policies:
        parts += ["## What tuning found", _tuned(plan)]
    return "\n\n".join(parts) + "\n"


def show(estimate: Estimate) -> str:
    """A value with its interval, or alone where nothing was left to chance."""
    if estimate.low == estimate.high:
        return number(estimate.value)
    return f"{number(estimate.value)} [{number(estimate.low)}, {number(estimate.high)}]"


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table whose first column is text and whose others are numbers."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _overall(table: Standings) -> str:
    rows = []
    for policy in ranked(table):
        score = table.overall[policy]
        rows.append(
            [f"`{policy}`", show(score.cost), show(score.typical), signed(score.difference)]
            + [number(value) for value in score.ratios.values()]
            + [f"{100.0 * score.improvement:.0f} %", f"{score.failed}/{score.episodes}"]
        )
    head = ["policy", "cost", "typical", "less AHSC", *(f"{name} ratio" for name in WEIGHTS), "better", "failed"]
    return markdown_table(head, rows)


def _single(table: Standings) -> str:
    order = ranked(table)
    rows = [[name, *(show(scores[policy].cost) for policy in order)] for name, scores in table.single.items()]
    return markdown_table(["scenario", *(f"`{policy}`" for policy in order)], rows)


def _measures(table: Standings) -> list[str]:
    """Ratios of means in each scenario, one table for each measure of the cost."""
    parts, order = [], ranked(table)
    for name, weight in WEIGHTS.items():
        rows = [[key, *(number(scores[p].ratios[name]) for p in order)] for key, scores in table.single.items()]
        parts.append(f"`{name}`, weight {weight:.2f}:")
        parts.append(markdown_table(["scenario", *(f"`{policy}`" for policy in order)], rows))
    return parts


def _right_models(results: Sequence[Result]) -> str:
    """Tracking of each law beside that of its oracle, wherever the oracle ran."""
    rows = []
    for scenario, group in by_scenario(results).items():
        for policy, oracle in ORACLES.items():
            if policy in group and oracle in group:
                errors = [1.0e6 * np.mean([r.measures["track_rmse"] for r in group[name]]) for name in (policy, oracle)]
                rows.append([f"{scenario}, `{policy}`", *map(number, map(float, errors))])
    return markdown_table(["scenario, policy", "wrong model", "right model"], rows) if rows else ""


def _failures(results: Sequence[Result]) -> str:
    counts: dict[tuple[str, str, str], int] = {}
    for result in results:
        if result.failure:
            key = (result.scenario, f"`{result.policy}`", result.failure)
            counts[key] = counts.get(key, 0) + 1
    rows = [[*key, str(count)] for key, count in counts.items()]
    return markdown_table(["scenario", "policy", "why", "episodes"], rows) if rows else ""


def signed(estimate: Estimate) -> str:
    """A difference with its interval."""
    value, low, high = (number(each) if each <= 0.0 else f"+{number(each)}" for each in estimate)
    return value if estimate.low == estimate.high else f"{value} [{low}, {high}]"


def _tuned(plan: Plan) -> str:
    """The numbers of ``hsc-tuned`` and where they come from."""
    found, (_, q5, q6) = load_damping(), plan.params.suppression.B0
    rows = [
        ["`hsc`", number(q5), number(q6), f"{found.hsc_cost:.4f}"],
        ["`hsc-tuned`", number(found.q5), number(found.q6), f"{found.cost:.4f}"],
    ]
    head = ["policy", "q5 [N s/m]", "q6 [N m s/rad]", "cost on the training episodes"]
    return f"{markdown_table(head, rows)}\n\nConstant virtual damping, found on {found.date}. `{found.command}`"


def _rounded(values: Any) -> Any:
    """The same with every number rounded to the digits that any machine gives."""
    if isinstance(values, dict):
        return {name: _rounded(value) for name, value in values.items()}
    if isinstance(values, list | tuple):
        return [_rounded(value) for value in values]
    return float(f"{values:.{DIGITS}g}") if isinstance(values, float) else values
