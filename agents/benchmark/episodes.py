"""Episodes of a benchmark, run in parallel and kept one by one: what was finished is never lost nor run again.

Each finished episode is a file, written whole by the worker that ran it, so that a dead worker or an interruption
leaves only finished ones behind, and a second call runs what is missing. An episode depends on its seed alone, not on
what ran before it or where.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterator
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import baselines
import sffr_gym
from agents.evaluate import EVALUATION_SEED, result_of, with_right_models
from agents.files import to_json, write_whole
from agents.learned import check_titles, file_hash, load_policy, policy_file, policy_title
from agents.run_folder import package_version
from agents.score import Result
from baselines.policies import Policy
from baselines.rollout import rollout
from sffr_gym import ConfigError, Params
from sffr_gym._jit import is_compiled
from sffr_gym.config import config_dir
from sffr_gym.env import SFFRFlexEnv
from sffr_gym.scenario import load_scenario, suite_hash

ROWS, PLAN = "rows", "plan.json"
_NAMED = {"scenarios": "scenario", "policies": "policy"}  # of which a folder may hold more than a plan runs

Report = Callable[[str, int, int], Any]  # what was finished, episodes done and in all


class Task(NamedTuple):
    """One episode to run."""

    scenario: str
    policy: str
    seed: int


@dataclass(frozen=True)
class Plan:
    """What a benchmark runs.

    Attributes:
        policies: names, or ``.npz`` files of learned ones.
        scenarios: shipped names, or files.
        episodes: of each policy in each scenario; one stands for all where a scenario draws nothing.
        seed: of the first one, the next one has the next number.
        params: the robot.
    """

    policies: tuple[str, ...]
    scenarios: tuple[str, ...]
    episodes: int
    seed: int
    params: Params

    def __post_init__(self) -> None:
        """Refuse what cannot be run; raises ConfigError."""
        for kind, names in (("policy", self.policies), ("scenario", self.scenarios)):
            if not names:
                raise ConfigError(f"no {kind} given")
        check_titles(self.policies)
        for name in self.scenarios:
            if self.scenarios.count(name) > 1:
                raise ConfigError(f"scenario {name!r} is given twice")
        if self.episodes < 1:
            raise ConfigError(f"episodes = {self.episodes}: must be at least 1")
        if self.seed < EVALUATION_SEED:
            raise ConfigError(f"seed = {self.seed}: a benchmark takes evaluation seeds, from {EVALUATION_SEED} up")
        for name in self.policies:
            load_policy(name, self.params)
        titles = [load_scenario(name).name for name in self.scenarios]
        for title in titles:
            if titles.count(title) > 1:
                raise ConfigError(f"two scenarios are named {title!r}")

    @property
    def suite(self) -> str:
        """Hash of everything that defines the episodes: task, scenarios, parameters."""
        return suite_hash([load_scenario(name) for name in self.scenarios], self.params)

    @functools.cached_property
    def tasks(self) -> tuple[Task, ...]:
        """Every episode, in the order of the tables; where a plant differs, also under the laws that know it."""
        return tuple(
            Task(scenario, policy, self.seed + i)
            for scenario in self.scenarios
            for policy in with_right_models(self.policies, load_scenario(scenario))
            for i in range(self.episodes if _draws(scenario, self.params) else 1)
        )

    @property
    def titles(self) -> tuple[str, ...]:
        """What tables call the policies."""
        return tuple(map(policy_title, self.policies))

    def identity(self) -> dict[str, Any]:
        """What episodes must agree in to stand in one table: version, code, parameters, scenarios, files."""
        files = {policy_title(name): file for name in self.policies if (file := policy_file(name))}
        return {
            "version": package_version("sffr-gym"),
            "code": code_hash(),
            "config_hash": self.params.hash(),
            "scenarios": {each.name: each.hash(self.params) for each in map(load_scenario, self.scenarios)},
            "policies": {title: file_hash(file) for title, file in files.items()},
        }


def code_hash() -> str:
    """Hash of all code and settings that decide an episode, 16 hexadecimal digits of the SHA-256."""
    folders = [Path(package.__file__ or "").parent for package in (sffr_gym, baselines)]
    files = [file for folder in folders for file in sorted(folder.glob("*.py"))]
    files += sorted((config_dir() / "policies").glob("*.yaml"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:16]


def run_episodes(
    plan: Plan, folder: Path, jobs: int, overwrite: bool = False, progress: Report | None = None
) -> list[Result]:
    """Run what a folder does not hold yet, and return all episodes in the order of the plan.

    Args:
        plan: what to run.
        folder: made if need be; holds a file for each finished episode.
        jobs: number of worker processes; the result does not depend on it.
        overwrite: start anew.
        progress: called with the scenario, the episodes done and all, first before anything runs.

    Raises:
        ConfigError: if the folder's episodes are of other code, parameters or scenarios, or a worker died.
    """
    progress = progress or (lambda what, done, total: None)
    if overwrite:
        shutil.rmtree(folder / ROWS, ignore_errors=True)
    _claim(plan, folder)
    pending = [task for task in plan.tasks if not _file(folder, task).exists()]
    done, total = len(plan.tasks) - len(pending), len(plan.tasks)
    progress(plan.scenarios[0], done, total)
    if pending and not is_compiled():  # here once, instead of in every worker
        run_episode(pending[0], plan.params)
    try:
        for task in _finish(pending, plan.params, folder, jobs):
            done += 1
            progress(task.scenario, done, total)
    except BrokenProcessPool:
        kept = sum(_file(folder, task).exists() for task in plan.tasks)
        raise ConfigError(
            f"{folder}: a worker process died (killed, or out of memory) with {kept} of {total} episodes finished; "
            "the same command goes on from there"
        ) from None
    return [_read(_file(folder, task)) for task in plan.tasks]


def run_episode(task: Task, params: Params) -> Result:
    """Run one episode."""
    trajectory = rollout(_environment(task.scenario, params), _policy(task.policy, task.scenario, params), task.seed)
    return result_of(trajectory)


def _finish(tasks: list[Task], params: Params, folder: Path, jobs: int) -> Iterator[Task]:
    """Run tasks in parallel, each kept by its worker, and name them as they are finished."""
    from joblib import Parallel, delayed  # here, since it takes long to load and most commands do without

    workers = Parallel(n_jobs=jobs, return_as="generator_unordered")
    finished: Iterator[Task] = workers(delayed(_run_and_keep)(task, params, folder) for task in tasks)
    return finished


def _run_and_keep(task: Task, params: Params, folder: Path) -> Task:
    file = _file(folder, task)
    file.parent.mkdir(parents=True, exist_ok=True)
    write_whole(file, json.dumps(asdict(run_episode(task, params))).encode())
    return task


@functools.lru_cache(maxsize=2)
def _environment(scenario: str, params: Params) -> SFFRFlexEnv:
    return SFFRFlexEnv(scenario=scenario, params=params)


@functools.lru_cache(maxsize=16)
def _policy(name: str, scenario: str, params: Params) -> Policy:
    return load_policy(name, _environment(scenario, params).params)


@functools.cache
def _draws(scenario: str, params: Params) -> bool:
    """Say whether a scenario's episodes differ."""
    _, info = _environment(scenario, params).reset(seed=EVALUATION_SEED)
    return bool(info["drawn"])


def _claim(plan: Plan, folder: Path) -> None:
    """Make the folder this plan's, or make sure that it is of the same code, parameters and scenarios.

    Raises:
        ConfigError: if it is not.
    """
    file, identity = folder / PLAN, plan.identity()
    if (folder / ROWS).is_dir() and file.exists():
        held = json.loads(file.read_text())
        changed = [name for name in identity if name not in _NAMED and identity[name] != held[name]]
        for kinds, kind in _NAMED.items():
            own, others = identity[kinds], held[kinds]
            changed += [f"{kind} {name!r}" for name in own if name in others and own[name] != others[name]]
            identity[kinds] = others | own
        if changed:
            raise ConfigError(
                f"{folder}: holds episodes of another {', '.join(changed)}; choose another folder with --out or add "
                "--overwrite"
            )
    (folder / ROWS).mkdir(parents=True, exist_ok=True)
    write_whole(file, to_json(identity).encode())


def _file(folder: Path, task: Task) -> Path:
    """Where a finished episode lies; a name may be a path."""
    return (
        folder / ROWS / quote(task.scenario, safe="") / quote(policy_title(task.policy), safe="") / f"{task.seed}.json"
    )


def _read(file: Path) -> Result:
    return Result(**json.loads(file.read_text()))


def default_jobs() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
