"""Sweeps: policies on the same episodes of one scenario, for every combination of values of some parameters."""

from __future__ import annotations

import csv
import io
import itertools
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sffr_gym import ConfigError, Params
from sffr_gym.config.files import to_json
from sffr_gym.config.provenance import MANIFEST
from sffr_gym.config.reading import read_json
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.task.metrics import MEASURES
from sffr_gym.task.scenario import load_scenario
from sffr_gym.task.score import Result
from sffr_workbench.benchmark.episodes import MOST_TASKS, Plan, code_hash, grouped, run_and_keep
from sffr_workbench.benchmark.rows import ROWS, Task, read_row, remove_rows, write_row
from sffr_workbench.common import Backend, Progress, WorkersLost, file_name, ignore

SWEEP_FILE, PLAN = "sweep.csv", "sweep.json"
MOST_POINTS = 10_000


class Axis(NamedTuple):
    """A parameter and the values that it takes."""

    key: str
    values: tuple[str, ...]


class Point(NamedTuple):
    """A combination of values, and the benchmark of it."""

    values: tuple[str, ...]  #: one of each axis
    plan: Plan


class Row(NamedTuple):
    """An episode of a sweep."""

    values: tuple[str, ...]
    result: Result


def read_axis(text: str) -> Axis:
    """Return an axis written as ``panel.EI=15,20,25``; a comma within brackets separates nothing.

    Raises:
        ConfigError: for another form, or a value that is given twice.
    """
    key, sign, values = text.partition("=")
    parts = tuple(part.strip() for part in _split(values))
    if not (key.strip() and sign and all(parts)):
        raise ConfigError(f"--over {text!r}: must be a key and its values, such as panel.EI=15,20,25")
    if len(set(parts)) < len(parts):
        raise ConfigError(f"--over {text!r}: a value is given twice")
    return Axis(key.strip(), parts)


@dataclass(frozen=True)
class SweepPlan:
    """What a sweep runs; every combination is checked before anything runs.

    Raises:
        ConfigError: for what cannot be run; the message names the combination.
    """

    axes: tuple[Axis, ...]
    policies: tuple[str, ...]
    scenario: str  #: shipped name or file
    episodes: int
    seed: int  #: of the first episode
    params: Params  #: the robot otherwise

    def __post_init__(self) -> None:
        """Check all."""
        keys = [axis.key for axis in self.axes]
        if not keys or len(set(keys)) < len(keys):
            raise ConfigError("a sweep needs --over KEY=VALUE,VALUE..., each key once")
        if (count := np.prod([len(axis.values) for axis in self.axes], dtype=float)) > MOST_POINTS:
            raise ConfigError(f"the sweep has {count:.2g} combinations, at most {MOST_POINTS:.0e}")
        if (total := sum(len(point.plan.tasks) for point in self.points)) > MOST_TASKS:
            raise ConfigError(f"the sweep has {total:.2g} episodes, at most {MOST_TASKS:.0e}")

    @cached_property
    def points(self) -> tuple[Point, ...]:
        """Return all combinations, the last axis changing fastest."""
        return tuple(self._points())

    def _points(self) -> Iterator[Point]:
        for values, words in combinations(self.axes):
            try:
                params = self.params.with_overrides(*words)
                load_scenario(self.scenario).robot_of(params, words)
                yield Point(values, Plan(self.policies, (self.scenario,), self.episodes, self.seed, params))
            except ConfigError as error:
                raise ConfigError("\n".join(f"{', '.join(words)}: {line}" for line in str(error).split("\n"))) from None

    def words(self, values: Sequence[str]) -> list[str]:
        """Return a combination as assignments."""
        return _words(self.axes, values)

    def identity(self) -> dict[str, Any]:
        """Return what episodes must agree in to be gone on with; more points and policies are welcome."""
        held = {name: value for point in self.points for name, value in point.plan.identity().policies.items()}
        return {
            "code": code_hash(), "axes": [axis.key for axis in self.axes], "scenario": self.scenario,
            "points": {" ".join(self.words(point.values)): point.plan.suite for point in self.points},
            "policies": held,
        }  # fmt: skip


def combinations(axes: Sequence[Axis]) -> Iterator[tuple[tuple[str, ...], list[str]]]:
    """Yield each combination of values, the last axis changing fastest, and the same as assignments."""
    for values in itertools.product(*(axis.values for axis in axes)):
        yield values, _words(axes, values)


def _words(axes: Sequence[Axis], values: Sequence[str]) -> list[str]:
    return [f"{axis.key}={value}" for axis, value in zip(axes, values, strict=True)]


def run_sweep(
    plan: SweepPlan,
    folder: Path,
    jobs: int,
    facts: dict[str, Any],
    overwrite: bool = False,
    progress: Progress = ignore,
    backend: Backend | None = None,
) -> list[Row]:
    """Run what a folder does not hold yet of a sweep, and write ``sweep.csv`` and the manifest.

    Args:
        plan: what to run.
        folder: run folder, made if need be; gets a file for each finished episode.
        jobs: number of worker processes.
        facts: on the origin of the result, for the manifest.
        overwrite: start again instead of going on.
        progress: called with the scenario, the episodes done and all.
        backend: what runs them; None for processes of this machine.

    Returns:
        All episodes in the order of the plan.

    Raises:
        ConfigError: if the folder holds anything of others or of another sweep, or workers died.
    """
    with RunFolder.claim(folder, "sweep", overwrite=overwrite, resume=True) as run:
        run.check_names([SWEEP_FILE, MANIFEST])
        _take_up(plan, run, overwrite)
        tasks = [(k, task) for k, point in enumerate(plan.points) for task in point.plan.tasks]
        files = {(k, task): _file(plan, run, k, task) for k, task in tasks}
        pending = {key: file for key, file in files.items() if not os.path.lexists(file)}
        _run(plan, run.path, pending, len(files), jobs, backend or Backend(), progress)
        title = load_scenario(plan.scenario).name
        rows = [Row(plan.points[k].values, read_row(file, task, title)) for (k, task), file in files.items()]
        contents = {SWEEP_FILE: _csv(plan, rows).encode(), MANIFEST: to_json(facts | {"jobs": jobs}).encode()}
        run.replace(contents, remove=set(run.files) - {ROWS, PLAN})
    return rows


def _run(
    plan: SweepPlan, path: Path, pending: dict[tuple[int, Task], Path], total: int, jobs: int, backend: Backend,
    progress: Progress,
) -> None:  # fmt: skip
    """Run what is missing, each episode kept in its file."""
    done, code = total - len(pending), code_hash()
    progress(plan.scenario, done, total)
    calls = [
        (k, group, point.plan.params, code, [pending[k, task] for task in group] if backend.shares_files else None)
        for k, point in enumerate(plan.points)
        for group in grouped([task for task in point.plan.tasks if (k, task) in pending], jobs)
    ]
    try:
        for k, group, results in backend.run(_run_point, calls, jobs):
            for task, result in zip(group, results, strict=False):  # none where workers wrote them
                write_row(pending[k, task], result)
            done += len(group)
            progress(plan.scenario, done, total)
    except WorkersLost:
        raise ConfigError(f"{path}: a worker process died; the same command goes on from there") from None


def _run_point(
    k: int, tasks: Sequence[Task], params: Params, code: str, files: Sequence[Path] | None
) -> tuple[int, Sequence[Task], list[Result]]:
    """Run episodes of the combination ``k``; see :func:`episodes.run_and_keep`."""
    return k, *run_and_keep(tasks, params, code, files)


def _file(plan: SweepPlan, run: RunFolder, k: int, task: Task) -> Path:
    """Return where a finished episode lies."""
    words = " ".join(plan.words(plan.points[k].values))
    return run.place(f"{ROWS}/{file_name(words)}/{file_name(Path(task.policy).stem)}/{task.seed}.json")


def _take_up(plan: SweepPlan, run: RunFolder, overwrite: bool) -> None:
    """Make the folder's episodes this sweep's; raises ConfigError if they are of other code, scenario or files."""
    identity, held = plan.identity(), run.file(PLAN)
    run.own(ROWS, PLAN)
    if overwrite:
        run.begin_again()
        remove_rows(run)
    elif held.exists():
        identity = _merge(identity, read_json(held), run.path)
    run.write(PLAN, to_json(identity).encode())


def _merge(identity: dict[str, Any], held: Any, folder: Path) -> dict[str, Any]:
    """Return what a sweep and a folder's episodes are together; raises ConfigError if they do not agree."""
    others = held if isinstance(held, dict) else {}
    changed, merged = [], {}
    for name, own in identity.items():
        theirs = others.get(name)
        if isinstance(own, dict) and isinstance(theirs, dict):
            if any(theirs.get(key, value) != value for key, value in own.items()):
                changed.append(name)
            merged[name] = theirs | own
        elif own != theirs:
            changed.append(name)
    if changed:
        raise ConfigError(
            f"{folder}: holds a sweep of another {', '.join(changed)}; choose another folder with --out or add "
            "--overwrite"
        )
    return identity | merged


def _csv(plan: SweepPlan, rows: Sequence[Row]) -> str:
    """Return all episodes as a table, values first."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([*(axis.key for axis in plan.axes), "policy", "seed", *MEASURES, "failure"])
    for values, result in rows:
        measures = (result.measures[name] for name in MEASURES)
        table.writerow([*values, result.policy, result.seed, *measures, result.failure])
    return text.getvalue()


def _split(text: str) -> list[str]:
    """Return the parts between commas that lie in no brackets."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter in "[{(") - (letter in "]})")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return parts
