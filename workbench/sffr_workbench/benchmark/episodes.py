"""Episodes of a benchmark, run in parallel and kept one by one: what was finished is kept and not run again.

Each finished episode is a file, written whole by the worker that ran it, so that a dead worker or an interruption
leaves only finished ones behind, and a second call runs what is missing. An episode depends on its seed alone, not on
what ran before it or where.
"""

from __future__ import annotations

import functools
import hashlib
import json
import shutil
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import sffr_baselines
import sffr_gym
from sffr_baselines.learned import file_hash, policy_file
from sffr_baselines.policies import Policy, check_titles, make_policy, policy_title
from sffr_baselines.rollout import result_of, rollout
from sffr_gym import ConfigError, Params
from sffr_gym.compile.cache import is_compiled
from sffr_gym.config.arguments import check_arguments
from sffr_gym.config.files import to_json, write_whole
from sffr_gym.config.provenance import package_version
from sffr_gym.config.strict_yaml import config_dir
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.scenario import EVALUATION_SEED, EpisodeRange, load_scenario, suite_hash
from sffr_gym.task.score import Result
from sffr_workbench.common import Progress, ignore
from sffr_workbench.evaluation import with_oracles

MOST_TASKS = 10**6  # episodes of a benchmark, each of which leaves a file: days of computing
ROWS, PLAN_FILE = "rows", "plan.json"
_NAMED = {"scenarios": "scenario", "policies": "policy"}  # of which a folder may hold more than a plan runs


class Task(NamedTuple):
    """One episode to run."""

    scenario: str
    policy: str
    seed: int


@dataclass(frozen=True)
class Plan:
    """What a benchmark runs."""

    policies: tuple[str, ...]  #: names, or ``.npz`` files of learned ones
    scenarios: tuple[str, ...]  #: shipped names, or files
    episodes: int  #: of each policy in each scenario; one stands for all where a scenario draws nothing
    seed: int  #: of the first one, the next one has the next number
    params: Params  #: the robot

    def __post_init__(self) -> None:
        """Raise ConfigError for what cannot be run."""
        for kind, names in (("policy", self.policies), ("scenario", self.scenarios)):
            if not names:
                raise ConfigError(f"no {kind} given")
        check_titles(self.policies)
        for name in self.scenarios:
            if self.scenarios.count(name) > 1:
                raise ConfigError(f"scenario {name!r} is given twice")
        check_arguments(EpisodeRange, episodes=self.episodes, seed=self.seed)
        if (count := self.episodes * len(self.policies) * len(self.scenarios)) > MOST_TASKS:
            raise ConfigError(
                f"episodes = {self.episodes}: of {len(self.policies)} policies in {len(self.scenarios)} scenarios make "
                f"{count:.2g} episodes, at most {MOST_TASKS:.0e}"
            )
        if self.seed < EVALUATION_SEED:
            raise ConfigError(f"seed = {self.seed}: a benchmark takes evaluation seeds, from {EVALUATION_SEED} up")
        for name in self.policies:
            make_policy(name, self.params)
        titles = [load_scenario(name).name for name in self.scenarios]
        for title in titles:
            if titles.count(title) > 1:
                raise ConfigError(f"two scenarios are named {title!r}")

    @property
    def suite(self) -> str:
        """Return the hash of everything that defines the episodes: task, scenarios, parameters."""
        return suite_hash([load_scenario(name) for name in self.scenarios], self.params)

    @functools.cached_property
    def tasks(self) -> tuple[Task, ...]:
        """Return every episode, in the order of the tables; where a plant differs, also under the laws that know it."""
        return tuple(
            Task(scenario, policy, self.seed + i)
            for scenario in self.scenarios
            for policy in with_oracles(self.policies, load_scenario(scenario))
            for i in range(self.episodes if _draws(scenario, self.params) else 1)
        )

    @property
    def titles(self) -> tuple[str, ...]:
        """Return what tables call the policies."""
        return tuple(map(policy_title, self.policies))

    def identity(self) -> dict[str, Any]:
        """Return what episodes must agree in to stand in one table: version, code, parameters, scenarios, files."""
        files = {policy_title(name): file for name in self.policies if (file := policy_file(name))}
        return {
            "version": package_version("sffr-gym"),
            "code": code_hash(),
            "config_hash": self.params.hash(),
            "scenarios": {each.name: each.hash(self.params) for each in map(load_scenario, self.scenarios)},
            "policies": {title: file_hash(file) for title, file in files.items()},
        }


def code_hash() -> str:
    """Return the hash of all code and settings that decide an episode, 16 hexadecimal digits of the SHA-256."""
    folders = [Path(package.__file__ or "").parent for package in (sffr_gym, sffr_baselines)]
    files = [file for folder in folders for file in sorted(folder.rglob("*.py"))]
    files += sorted((config_dir() / "policies").glob("*.yaml"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:16]


def run_episodes(
    plan: Plan, folder: Path, jobs: int, overwrite: bool = False, progress: Progress = ignore
) -> list[Result]:
    """Run what a folder does not hold yet, and return all episodes in the order of the plan.

    Args:
        plan: what to run.
        folder: made if need be; holds a file for each finished episode.
        jobs: number of worker processes; the result does not depend on it.
        overwrite: start again.
        progress: called with the scenario, the episodes done and all, first before anything runs.

    Raises:
        ConfigError: if the folder's episodes are of other code, parameters or scenarios, or a worker died.
    """
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
    return workers(delayed(_run_and_keep)(task, params, folder) for task in tasks)


def _run_and_keep(task: Task, params: Params, folder: Path) -> Task:
    """Run an episode and write its file."""
    file = _file(folder, task)
    file.parent.mkdir(parents=True, exist_ok=True)
    write_whole(file, json.dumps(asdict(run_episode(task, params))).encode())
    return task


@functools.lru_cache(maxsize=2)
def _environment(scenario: str, params: Params) -> SFFRFlexEnv:
    return SFFRFlexEnv(scenario=scenario, params=params)


@functools.lru_cache(maxsize=16)
def _policy(name: str, scenario: str, params: Params) -> Policy:
    return make_policy(name, _environment(scenario, params).params)


@functools.cache
def _draws(scenario: str, params: Params) -> bool:
    """Say whether a scenario's episodes differ."""
    env = _environment(scenario, params)
    env.reset(seed=EVALUATION_SEED)
    return bool(env.episode.drawn)


def _claim(plan: Plan, folder: Path) -> None:
    """Make the folder this plan's, or make sure that it is of the same code, parameters and scenarios.

    Raises:
        ConfigError: if it is not.
    """
    file, identity = folder / PLAN_FILE, plan.identity()
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
    """Return where a finished episode lies; a name may be a path."""
    scenario, policy = (quote(name, safe="") for name in (task.scenario, policy_title(task.policy)))
    return folder / ROWS / scenario / policy / f"{task.seed}.json"


def _read(file: Path) -> Result:
    return Result(**json.loads(file.read_text()))
