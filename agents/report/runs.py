"""Run folders as the page shows them: score tables, pictures, manifest, recordings."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.benchmark.pictures import PICTURES
from agents.benchmark.standings import by_scenario
from agents.evaluate import number, unit_for
from agents.recording import Recording, recording_files
from agents.run_folder import FIGURES, MANIFEST, read_episodes
from agents.score import REFERENCE, Result, costs
from sffr_gym import ConfigError
from sffr_gym.metrics import MEASURES

COLUMNS = {  # measures of the score table, as it calls them
    "vibration": "vibration",
    "track_rmse": "tracking, rms",
    "track_max": "tracking, largest",
    "tip_max": "largest tip",
    "settling_time": "settled after",
    "piezo_effort": "piezo effort",
    "thruster_impulse": "thrust impulse",
}
IMAGES = ("", "images")  # folders in a run's with its pictures
NAMES = {
    "path.png": "The robot on its path", "tracking.png": "Tracking", "panels.png": "The panels",
    "damping.png": "Virtual damping", "forces.png": "Actuators", "benchmark-intervals.png": "Costs with 95 % intervals",
    "benchmark-profiles.png": "Performance profiles", "benchmark-differences.png": "Paired differences to AHSC",
}  # fmt: skip


class Cell(NamedTuple):
    """A number of the score table, and how much of the column's largest it is."""

    text: str
    share: float


class ScoreTable(NamedTuple):
    """Means over the episodes of a scenario.

    Attributes:
        scenario: name; episodes: of each policy.
        heads: of the columns, each with its unit.
        rows: policy, cells, failed episodes.
        vibration: mean energy of each policy [J].
    """

    scenario: str
    episodes: int
    heads: list[tuple[str, str]]
    rows: list[tuple[str, list[Cell], int]]
    vibration: dict[str, float]

    @property
    def verdict(self) -> str:
        """Which policy calms the panels, in a sentence; empty where there is nothing to compare."""
        sound = {policy: self.vibration[policy] for policy, _, failed in self.rows if not failed}
        if len(sound) < 2:
            return ""
        best, worst = min(sound, key=sound.__getitem__), max(sound, key=sound.__getitem__)
        if not sound[best] > 0.0:
            return f"{best} leaves the panels without any vibration."
        unit, scale = unit_for("J", sound[best])
        times = number(sound[worst] / sound[best])
        energy = f"{number(sound[best] / scale)} {unit}"
        return f"{best} keeps the panels calmest: {energy} of vibration on average, {times} times less than {worst}."


class Picture(NamedTuple):
    """A picture of a run, and its file as a data URI."""

    title: str
    source: str


@dataclass(frozen=True)
class Run:
    """A finished run.

    Attributes:
        name: of its folder.
        results: all its episodes.
        manifest: how to repeat it.
        pictures: that it drew.
        recordings: of an episode of each policy, in the manifest's order.
    """

    name: str
    results: list[Result]
    manifest: dict[str, Any]
    pictures: list[Picture]
    recordings: list[Recording]

    @property
    def tables(self) -> list[ScoreTable]:
        """One for each scenario."""
        return [score_table(name, group) for name, group in by_scenario(self.results).items()]

    @property
    def facts(self) -> dict[str, str]:
        """What of the manifest people look for first."""
        git, versions = self.manifest.get("git") or {}, self.manifest.get("versions") or {}
        commit = f"{git['commit'][:12]}{', with changes' if git.get('dirty') else ''}" if git else "unknown"
        found = {
            "command": self.manifest.get("command", ""),
            "started": self.manifest.get("started", ""),
            "took": f"{number(self.manifest.get('duration_s', float('nan')))} s",
            "commit": commit,
            "versions": ", ".join(f"{name} {version}" for name, version in versions.items() if version),
            "machine": f"{self.manifest.get('platform', '')}, {self.manifest.get('cpus', '?')} processors",
        }
        return {name: text for name, text in found.items() if text}


def read_run(folder: Path) -> Run:
    """Read a run folder that ``sffr evaluate`` or ``sffr benchmark`` left.

    Raises:
        ConfigError: if it holds no finished run, or a damaged file.
    """
    results = read_episodes(folder)
    file = folder / MANIFEST
    try:
        manifest = json.loads(file.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError) as error:
        raise ConfigError(f"{file}: no manifest of a run: {error}") from None
    order = {policy: k for k, policy in enumerate(manifest.get("policies", ()))}
    recordings = sorted(
        map(Recording.read, recording_files(folder)), key=lambda each: order.get(each.policy, len(order))
    )
    return Run(folder.resolve().name, results, manifest, pictures(folder), recordings)


def pictures(folder: Path) -> list[Picture]:
    """The pictures of a run folder."""
    files = [folder / sub / name for name in (*FIGURES, *PICTURES) for sub in IMAGES]
    return [
        Picture(NAMES[file.name], "data:image/png;base64," + base64.b64encode(file.read_bytes()).decode("ascii"))
        for file in files
        if file.is_file()
    ]


def score_table(scenario: str, group: Mapping[str, Sequence[Result]]) -> ScoreTable:
    """The table of one scenario; the cost stands first where AHSC took part."""
    means = {
        name: {policy: float(np.mean([each.measures[name] for each in results])) for policy, results in group.items()}
        for name in COLUMNS
    }
    heads, columns = [], []
    if REFERENCE in group:
        heads.append(("cost", f"{REFERENCE} = 1"))
        columns.append(_cells(costs(group), 1.0))
    for name, values in means.items():
        unit, scale = unit_for(MEASURES[name], max(values.values()))
        heads.append((COLUMNS[name], unit))
        columns.append(_cells(values, scale))
    rows = [
        (policy, [column[policy] for column in columns], sum(bool(each.failure) for each in results))
        for policy, results in group.items()
    ]
    return ScoreTable(scenario, max(len(results) for results in group.values()), heads, rows, means["vibration"])


def _cells(values: Mapping[str, float], scale: float) -> dict[str, Cell]:
    """A column's cells by policy."""
    largest = max((value for value in values.values() if np.isfinite(value)), default=0.0)
    return {
        policy: Cell(number(value / scale), value / largest if np.isfinite(value) and largest > 0.0 else 0.0)
        for policy, value in values.items()
    }
