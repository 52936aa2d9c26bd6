"""Run folders as the page shows them: score tables, pictures, manifest, recordings."""

from __future__ import annotations

import functools
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sffr_gym import ConfigError
from sffr_gym.config.files import to_json
from sffr_gym.config.reading import read_bytes
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.task.metrics import ARRIVAL_MEASURES
from sffr_gym.task.score import REFERENCE, Result, costs
from sffr_workbench import benchmark
from sffr_workbench.benchmark import by_scenario
from sffr_workbench.common import describe_commit, describe_versions, format_number, plural, png_uri, prefixed_unit
from sffr_workbench.evaluation import (
    COLUMNS,
    FIGURE_FILES,
    Manifest,
    Recording,
    open_run,
    read_episodes,
    read_manifest,
    recording_files,
)

MOST_FIGURE = 20_000_000  # bytes; ours have 200 kB
PNG = b"\x89PNG\r\n\x1a\n"  # how such a file begins
TITLES = {
    "path.png": "The robot on its path", "tracking.png": "Tracking", "panels.png": "The panels",
    "damping.png": "Virtual damping", "forces.png": "Actuators", "benchmark-intervals.png": "Costs with 95 % intervals",
    "benchmark-profiles.png": "Performance profiles", "benchmark-differences.png": "Paired differences to AHSC",
    "benchmark-tradeoff.png": "Vibration against effort",
}  # fmt: skip


class Cell(NamedTuple):
    """A number of the score table, and how much of the column's largest it is."""

    text: str
    share: float


class ScoreTable(NamedTuple):
    """Numbers of policies."""

    title: str  #: what they are of
    heads: list[tuple[str, str]]  #: of the columns, each with its unit
    rows: list[tuple[str, list[Cell], int]]  #: policy, cells, failed episodes
    vibration: dict[str, float]  #: mean energy of each policy [J], in a table of one scenario

    @property
    def verdict(self) -> str:
        """Return which policy calms the panels, in a sentence; empty where there is nothing to compare."""
        finished = {policy for policy, _, failed in self.rows if not failed}
        sound = {name: energy for name, energy in self.vibration.items() if name in finished and np.isfinite(energy)}
        if len(sound) < 2:
            return ""
        best, worst = min(sound, key=sound.__getitem__), max(sound, key=sound.__getitem__)
        if not sound[worst] > 0.0:
            return ""  # as of a robot without panels
        if not sound[best] > 0.0:
            return f"{best} leaves the panels without any vibration."
        unit, scale = prefixed_unit("J", sound[best])
        times = format_number(sound[worst] / sound[best])
        energy = f"{format_number(sound[best] / scale)} {unit}"
        return f"{best} keeps the panels calmest: {energy} of vibration on average, {times} times less than {worst}."


class EmbeddedFigure(NamedTuple):
    """A figure of a run, its file as a data URI."""

    title: str
    source: str


@dataclass(frozen=True)
class Run:
    """A finished run."""

    name: str  #: of its folder
    results: list[Result]  #: all its episodes
    manifest: Manifest  #: how to repeat it
    repeat: str  #: all of that, as its file has it
    figures: list[EmbeddedFigure]  #: that it drew
    recordings: list[Recording]  #: of an episode of each policy, in the manifest's order

    @functools.cached_property
    def tables(self) -> list[ScoreTable]:
        """Return a table for each scenario."""
        return [score_table(name, group) for name, group in by_scenario(self.results).items()]

    @property
    def overview(self) -> ScoreTable | None:
        """Return the costs in all scenarios; None for a single one, or without the reference policy."""
        groups = by_scenario(self.results)
        if len(groups) < 2 or any(REFERENCE not in group for group in groups.values()):
            return None
        columns = [_cells(costs(group), 1.0) for group in groups.values()]
        failed = Counter(result.policy for result in self.results if result.failure)
        policies = dict.fromkeys(result.policy for result in self.results)
        rows = [
            (policy, [column.get(policy, Cell("", 0.0)) for column in columns], failed[policy]) for policy in policies
        ]
        return ScoreTable("cost in each scenario", [(name, f"{REFERENCE} = 1") for name in groups], rows, {})

    @property
    def facts(self) -> dict[str, str]:
        """Return what of the manifest people look for first."""
        about = self.manifest
        found = {
            "command": about.command,
            "started": about.started,
            "took": f"{format_number(about.duration_s)} s",
            "commit": describe_commit(about.git.model_dump() if about.git else None),
            "versions": describe_versions(about.versions),
            "machine": f"{about.platform}, {'?' if about.cpus is None else about.cpus} processors",
        }
        return {name: text for name, text in found.items() if text}


def read_run(folder: Path) -> Run:
    """Read a run folder that ``sffr evaluate`` or ``sffr benchmark`` left.

    Raises:
        ConfigError: if it holds no finished run, or a damaged file.
    """
    run = open_run(folder)
    results, (facts, manifest) = read_episodes(run), read_manifest(run)
    order = {policy: k for k, policy in enumerate(facts.policies)}
    recordings = sorted(map(Recording.read, recording_files(run)), key=lambda each: order.get(each.policy, len(order)))
    return Run(folder.resolve().name, results, facts, to_json(manifest), embedded_figures(run), recordings)


def embedded_figures(run: RunFolder) -> list[EmbeddedFigure]:
    """Read the figures of a run that are still there; raises ConfigError for one that is no PNG file."""
    figures = []
    for name in (*FIGURE_FILES, *(f"{benchmark.IMAGES}/{name}" for name in benchmark.FIGURE_FILES)):
        file = run.file(name)
        if name in run.files and os.path.lexists(file):
            content = read_bytes(file, MOST_FIGURE)
            if not content.startswith(PNG):
                raise ConfigError(f"{file}: is no PNG file, or is damaged")
            figures.append(EmbeddedFigure(TITLES[name.rpartition("/")[2]], png_uri(content)))
    return figures


def score_table(scenario: str, group: Mapping[str, Sequence[Result]]) -> ScoreTable:
    """Return the table of one scenario; the cost stands first where AHSC took part."""
    whole = [policy for policy, results in group.items() if not any(each.failure for each in results)] or list(group)
    heads, columns = [], []
    if REFERENCE in group:
        heads.append(("cost", f"{REFERENCE} = 1"))
        columns.append(_cells(costs(group), 1.0))
    means: dict[str, dict[str, float]] = {}
    for column in sorted(COLUMNS, key=lambda column: column.measure != "vibration"):  # first what the verdict is about
        values = {
            name: float(np.mean([each.measures.get(column.measure, nan) for each in own]))
            for name, own in group.items()
        }
        if column.measure in ARRIVAL_MEASURES and not any(map(isfinite, values.values())):
            continue
        means[column.measure] = values
        unit, scale = prefixed_unit(column.unit, max(values[policy] for policy in whole))
        heads.append((column.title, unit))
        columns.append(_cells(values, scale))
    rows = [
        (policy, [cells[policy] for cells in columns], sum(bool(each.failure) for each in results))
        for policy, results in group.items()
    ]
    episodes = plural(max(map(len, group.values())), "episode")
    return ScoreTable(f"{scenario}: {episodes} of each policy", heads, rows, means["vibration"])


def _cells(values: Mapping[str, float], scale: float) -> dict[str, Cell]:
    """Return a column's cells by policy."""
    largest = max((value for value in values.values() if np.isfinite(value)), default=0.0)
    return {
        policy: Cell(format_number(value / scale), value / largest if np.isfinite(value) and largest > 0.0 else 0.0)
        for policy, value in values.items()
    }
