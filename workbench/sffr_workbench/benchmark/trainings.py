"""Many trainings: every combination of some settings' values with every seed, each a job that takes one core."""

from __future__ import annotations

import csv
import io
import os
import platform
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isnan, nan
from pathlib import Path
from typing import Any, NamedTuple

from sffr_agents.config import TrainConfig, from_dict, load_config
from sffr_agents.folder import CHECKPOINTS, KIND, PROGRESS, check_seed, first_difference, read_run
from sffr_agents.progress import read_progress
from sffr_gym import ConfigError
from sffr_gym.config.files import to_json
from sffr_gym.config.provenance import MANIFEST
from sffr_gym.config.run_folder import CARD, LOCK, RunFolder
from sffr_workbench.benchmark.episodes import code_hash
from sffr_workbench.benchmark.sweep import Axis, combinations
from sffr_workbench.common import Backend, Progress, WorkersLost, file_name, ignore

TRAININGS, TABLE = "trainings", "trainings.csv"
COST = "score/cost"  # column of a training's log
MOST_TRAININGS = 10_000


class Training(NamedTuple):
    """One of them."""

    name: str  #: of its folder
    values: tuple[str, ...]  #: one of each axis
    config: TrainConfig
    seed: int


class Trained(NamedTuple):
    """What came of it."""

    training: Training
    cost: float  #: the lowest of its comparisons, relative to AHSC's; NaN if there was none
    failure: str  #: why it ended early; empty if it did not


@dataclass(frozen=True)
class TrainingsPlan:
    """What is to be trained; every combination is checked before anything runs.

    Raises:
        ConfigError: for what cannot be trained; the message names the combination.
    """

    algo: str  #: shipped configuration or file
    axes: tuple[Axis, ...]  #: settings and their values, may be none
    seeds: range
    changes: tuple[str, ...] = ()  #: assignments for all

    def __post_init__(self) -> None:
        """Check all."""
        keys = [axis.key for axis in self.axes]
        if len(set(keys)) < len(keys):
            raise ConfigError("--over KEY=VALUE,VALUE...: each key once")
        count = len(self.seeds)
        for axis in self.axes:
            count *= len(axis.values)
        if not 0 < count <= MOST_TRAININGS:
            raise ConfigError(f"{count:.2g} trainings, must be 1 to {MOST_TRAININGS}")
        for each in self.trainings:
            check_seed(each.config, each.seed)

    @cached_property
    def trainings(self) -> tuple[Training, ...]:
        """Return all of them, seeds changing fastest."""
        found = []
        for values, words in combinations(self.axes):
            try:
                config = load_config(self.algo, [*self.changes, *words])
            except ConfigError as error:
                raise ConfigError(f"{', '.join(words)}: {error}" if words else str(error)) from None
            title = file_name(",".join("".join(word.split()) for word in words) or Path(self.algo).stem)
            found += [Training(f"{title}-{seed}", values, config, seed) for seed in self.seeds]
        return tuple(found)


def run_trainings(
    plan: TrainingsPlan,
    folder: Path,
    jobs: int,
    facts: dict[str, Any],
    progress: Progress = ignore,
    backend: Backend | None = None,
) -> list[Trained]:
    """Train what a folder does not hold yet, and write ``trainings.csv`` and the manifest.

    On this machine a killed training goes on from its last checkpoint; one whose node is lost begins again on another.

    Args:
        plan: what to train.
        folder: run folder, made if need be; gets a run folder of each training.
        jobs: number of worker processes.
        facts: on the origin of the result, for the manifest.
        progress: called with what runs, the trainings done and all.
        backend: what runs them; None for processes of this machine.

    Returns:
        All of the plan's trainings in its order.

    Raises:
        ConfigError: if the folder holds anything of others or other trainings, or workers died.
    """
    backend = backend or Backend()
    with RunFolder.claim(folder, "trainings", resume=True) as run:
        run.own(TRAININGS, TABLE, MANIFEST)
        places = {each: run.place(f"{TRAININGS}/{each.name}") for each in plan.trainings}
        pending = {each.name: each for each, place in places.items() if not _is_finished(place, each, backend)}
        if run.finished:
            run.begin_again()
        failures = _run(run, pending, len(places), jobs, backend, progress)
        found = [Trained(each, _best_cost(place), failures.get(each.name, "")) for each, place in places.items()]
        contents = {TABLE: _csv(plan, found).encode(), MANIFEST: to_json(facts | {"jobs": jobs}).encode()}
        run.replace(contents, finished=not failures)
    return found


def _run(
    run: RunFolder, pending: dict[str, Training], total: int, jobs: int, backend: Backend, progress: Progress
) -> dict[str, str]:
    """Run what is missing; return why some ended early."""
    done, failures, code = total - len(pending), {}, code_hash()
    root = run.place(TRAININGS)
    root.mkdir(exist_ok=True)
    progress(TRAININGS, done, total)
    calls = [
        (each.name, each.config.model_dump(mode="json"), each.seed, code, root if backend.shares_files else None)
        for each in pending.values()
    ]
    try:
        for name, files, failure in backend.run(train_one, calls, jobs):
            if files:
                _write_folder(root / name, files)
            if failure:
                failures[name] = failure
            done += 1
            progress(TRAININGS, done, total)
    except WorkersLost:
        raise ConfigError(f"{run.path}: a worker process died; the same command goes on from there") from None
    return failures


def train_one(
    name: str, data: dict[str, Any], seed: int, code: str, root: Path | None
) -> tuple[str, dict[str, bytes], str]:
    """Train, and return the name, the run folder's files where the asking process's are out of reach, and a failure.

    Args:
        name: of the run folder.
        data: the configuration.
        seed: of everything random.
        code: hash of the code of the process that asks.
        root: where run folders lie; None on a node that does not see it.

    Raises:
        ConfigError: if this node has other code than the one that asks.
    """
    from sffr_agents.train import train_or_resume  # torch takes seconds to import

    if root is None and code_hash() != code:
        raise ConfigError(f"node {platform.node()}: has other code of sffr-gym; install the same version on each node")
    config = from_dict(data, lambda key: name)
    with tempfile.TemporaryDirectory(prefix="sffr-train-") as scratch:
        folder = (root or Path(scratch)) / name
        try:
            train_or_resume(config, seed, folder)
        except ConfigError as error:
            return name, {}, str(error)
        if root is not None:
            return name, {}, ""
        files = [file for file in folder.rglob("*") if file.is_file() and file.name != LOCK]
        names = {file.relative_to(folder): file for file in files}
        return name, {str(n): file.read_bytes() for n, file in names.items() if n.parts[0] != CHECKPOINTS}, ""


def _is_finished(place: Path, training: Training, backend: Backend) -> bool:
    """Say whether a folder holds the finished training; raises ConfigError if it holds another one."""
    if not (place / CARD).exists():
        return False
    config, seed = read_run(place)
    asked = {"seed": training.seed, **training.config.model_dump(mode="json")}
    if found := first_difference({"seed": seed, **config.model_dump(mode="json")}, asked):
        key, held, wanted = found
        raise ConfigError(f"{place}: holds a training with {key} = {held!r}, not {wanted!r}; choose another --out")
    finished = RunFolder.open(place, KIND, finished=False).finished
    if not (finished or backend.shares_files):
        raise ConfigError(f"{place}: was begun on this machine; leave out --backend once, or choose another --out")
    return finished


def _write_folder(place: Path, files: dict[str, bytes]) -> None:
    """Write what a node sent, whole or not at all."""
    part = place.with_name(f".part-{place.name}")
    shutil.rmtree(part, ignore_errors=True)
    for name, content in files.items():
        file = part / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    os.replace(part, place)


def _best_cost(place: Path) -> float:
    """Return the lowest cost of a training's comparisons, NaN if there was none."""
    file = place / PROGRESS
    rows = read_progress(file) if file.exists() else []
    costs = [float(row[COST]) for row in rows if row.get(COST)]
    return min((cost for cost in costs if not isnan(cost)), default=nan)


def _csv(plan: TrainingsPlan, found: Sequence[Trained]) -> str:
    """Return a row for each training, values first."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([*(axis.key for axis in plan.axes), "algo", "seed", "cost", "failure", "folder"])
    for training, cost, failure in found:
        folder = f"{TRAININGS}/{training.name}"
        shown = "" if isnan(cost) else cost
        table.writerow([*training.values, training.config.algo, training.seed, shown, failure, folder])
    return text.getvalue()
