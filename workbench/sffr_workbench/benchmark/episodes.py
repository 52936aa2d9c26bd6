"""Episodes of a benchmark, run in parallel and kept one by one: what was finished is kept and not run again.

Each finished episode is a file, written whole by the worker that ran it, or on a cluster, whose nodes need not see the
folder, by the process that asked for it. A dead worker or an interruption leaves only finished ones behind, and a
second call runs what is missing. An episode depends on its seed alone, not on what ran before it or where.
"""

from __future__ import annotations

import functools
import hashlib
import itertools
import os
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gymnasium as gym

import sffr_baselines
import sffr_gym
from sffr_baselines.laws import LawPolicy, OraclePolicy
from sffr_baselines.own_files import own_name
from sffr_baselines.own_law import UnfitError
from sffr_baselines.policies import Policy, check_titles, make_policy, policy_title, warn_of_instability
from sffr_baselines.rollout import SIDE_BY_SIDE, result_of, rollouts
from sffr_gym import ConfigError, Params
from sffr_gym.config.arguments import check_arguments
from sffr_gym.config.files import to_json
from sffr_gym.config.provenance import package_version
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.config.strict_yaml import config_dir
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.scenario import EVALUATION_SEED, EpisodeRange, load_scenario, suite_hash
from sffr_gym.task.score import Result
from sffr_workbench.benchmark.rows import ROWS, Task, read_row, remove_parts, remove_rows, row_files, write_row
from sffr_workbench.common import Backend, Progress, WorkersLost, ignore
from sffr_workbench.evaluation import PLAN_FILE, Identity, file_hashes, given_files, read_record, with_oracles

MOST_TASKS = 10**6  # episodes of a benchmark, each of which leaves a file: days of computing
_NAMED = {"scenarios": "scenario", "policies": "policy"}  # of which a folder may hold more than a plan runs


@dataclass(frozen=True)
class Plan:
    """What a benchmark runs."""

    policies: tuple[str, ...]  #: names, ``.npz`` files of learned ones, laws of your own as ``mine.py:MyLaw``
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

    def identity(self) -> Identity:
        """Return what episodes must agree in to stand in one table: version, code, parameters, scenarios, files."""
        return Identity(
            version=package_version("sffr-gym"), code=code_hash(), config_hash=self.params.hash(),
            scenarios={each.name: each.hash(self.params) for each in map(load_scenario, self.scenarios)},
            policies=file_hashes(self.policies),
        )  # fmt: skip


def unfit_policies(policies: Sequence[str], scenarios: Sequence[str], params: Params) -> dict[str, str]:
    """Return the policies that cannot control the robot of one of the scenarios, and why; raises ConfigError."""
    unfit: dict[str, str] = {}
    robots = list(dict.fromkeys(load_scenario(name).robot_of(params) for name in scenarios))
    for name in policies:
        for robot in robots:
            try:
                make_policy(name, robot)
            except UnfitError as error:
                unfit[name] = str(error)
                break
    return unfit


def code_hash() -> str:
    """Return the hash of all code and settings that decide an episode, 16 hexadecimal digits of the SHA-256."""
    folders = [Path(package.__file__ or "").parent for package in (sffr_gym, sffr_baselines)]
    files = [file for folder in folders for file in sorted(folder.rglob("*.py"))]
    files += sorted((config_dir() / "policies").glob("*.yaml"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:16]


def run_episodes(
    plan: Plan,
    run: RunFolder,
    jobs: int,
    overwrite: bool = False,
    progress: Progress = ignore,
    backend: Backend | None = None,
    device: str = "cpu",
) -> list[Result]:
    """Run what a folder does not hold yet, and return all episodes in the order of the plan.

    Args:
        plan: what to run.
        run: folder that this process writes to; gets a file for each finished episode.
        jobs: number of worker processes; the result does not depend on it.
        overwrite: start again.
        progress: called with the scenario, the episodes done and all, first before anything runs.
        backend: what runs them; None for processes of this machine.
        device: ``cuda`` to run the laws on a GPU; all else runs on the processor.

    Raises:
        ConfigError: if the folder's episodes are of other code, parameters or scenarios, one of them is damaged, a
            worker died, or the GPU cannot be used.
    """
    _take_up(plan, run, overwrite)
    files, titles = row_files(run, plan.tasks), {name: load_scenario(name).name for name in plan.scenarios}
    found = {task: read_row(file, task, titles[task.scenario]) for task, file in files.items() if os.path.lexists(file)}
    pending = {task: file for task, file in files.items() if task not in found}
    done, total = len(found), len(files)
    _warn_of_instability(pending, plan.params)
    progress(plan.scenarios[0], done, total)
    try:
        for task in _finish(pending, plan.params, jobs, backend or Backend(), device):
            done += 1
            progress(task.scenario, done, total)
    except WorkersLost:
        kept = sum(file.exists() for file in files.values())
        raise ConfigError(
            f"{run.path}: a worker process died (killed, or out of memory) with {kept} of {total} episodes finished; "
            "the same command goes on from there"
        ) from None
    found |= {task: read_row(file, task, titles[task.scenario]) for task, file in pending.items()}
    return [found[task] for task in plan.tasks]


def _warn_of_instability(pending: Iterable[Task], params: Params) -> None:
    """Warn of laws that are unstable on the plant of a scenario that is not the robot which they believe in."""
    pairs = dict.fromkeys((task.policy, task.scenario) for task in pending)
    for name, scenario in pairs:
        if load_scenario(scenario).changes_model:
            with suppress(UnfitError):  # told where it is run
                warn_of_instability(_policy(name, scenario, params), _environment(scenario, params))


def run_tasks(tasks: Sequence[Task], params: Params) -> list[Result]:
    """Run episodes of one policy in one scenario; those of a law of your own side by side."""
    scenario, name, _ = tasks[0]
    seeds, file = [task.seed for task in tasks], file_hashes(given_files([name]))
    trajectories = rollouts(_environment(scenario, params), _policy(name, scenario, params), seeds)
    return [replace(result_of(each), file=file.get(policy_title(name), "")) for each in trajectories]


def _finish(files: Mapping[Task, Path], params: Params, jobs: int, backend: Backend, device: str) -> Iterator[Task]:
    """Run tasks, each kept in its file, and name them as they are finished."""
    together = _laws(files, params) if device == "cuda" else {}
    for (scenario, policy), tasks in together.items():
        yield from _finish_on_device(scenario, _policy(policy, scenario, params), tasks, params, files)
    beside = [task for task in files if (task.scenario, task.policy) not in together]
    calls = [
        (group, params, code_hash(), [files[task] for task in group] if backend.shares_files else None)
        for group in grouped(beside, jobs)
    ]
    for group, found in backend.run(run_and_keep, calls, jobs):
        for task, result in zip(group, found, strict=False):
            write_row(files[task], result)
        yield from group


def _laws(tasks: Iterable[Task], params: Params) -> dict[tuple[str, str], list[Task]]:
    """Return the tasks that can run on a GPU, by scenario and policy."""
    found: dict[tuple[str, str], list[Task]] = {}
    for task in tasks:
        policy = _policy(task.policy, task.scenario, params)
        arrives = _environment(task.scenario, params).params.path.arrival is not None  # has measures of its own
        if isinstance(policy, LawPolicy) and not isinstance(policy, OraclePolicy) and not arrives:
            found.setdefault((task.scenario, task.policy), []).append(task)
    return found


def _finish_on_device(
    scenario: str, policy: Policy, tasks: Sequence[Task], params: Params, files: Mapping[Task, Path]
) -> Iterator[Task]:
    """Run the episodes of a law on the GPU, as many beside each other as fit."""
    from sffr_workbench.benchmark.device_episodes import most_episodes, run_on_device

    given = file_hashes(given_files([tasks[0].policy]))
    most = most_episodes(load_scenario(scenario).ticks(_environment(scenario, params).params))
    for k in range(0, len(tasks), most):
        part = tasks[k : k + most]
        envs: Any = gym.make_vec("SFFRFlex-v0", len(part), backend="cuda", scenario=scenario, params=params)
        for task, result in zip(part, run_on_device(envs, policy, [task.seed for task in part]), strict=True):
            write_row(files[task], replace(result, file=given.get(policy_title(task.policy), "")))
            yield task


def grouped(tasks: Iterable[Task], jobs: int) -> list[list[Task]]:
    """Return what a worker runs at once: episodes of a law of your own side by side, others one by one."""
    groups: list[list[Task]] = []
    for (_, policy), each in itertools.groupby(tasks, lambda task: task[:2]):
        same = list(each)
        size = min(SIDE_BY_SIDE, -(-len(same) // jobs)) if own_name(policy) else 1
        groups += [same[k : k + size] for k in range(0, len(same), size)]
    return groups


def run_and_keep(
    tasks: Sequence[Task], params: Params, code: str, files: Sequence[Path] | None
) -> tuple[Sequence[Task], list[Result]]:
    """Run episodes of one policy in one scenario and write their files, or return them where these are out of reach.

    Args:
        tasks: to run.
        params: the robot.
        code: hash of the code of the process that asks.
        files: of the tasks; None on a node that does not see them.

    Raises:
        ConfigError: if this node has other code than the one that asks.
    """
    if files is None and code_hash() != code:
        raise ConfigError(f"node {platform.node()}: has other code of sffr-gym; install the same version on each node")
    results = run_tasks(tasks, params)
    if files is None:
        return tasks, results
    for file, result in zip(files, results, strict=True):
        write_row(file, result)
    return tasks, []


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


def _take_up(plan: Plan, run: RunFolder, overwrite: bool) -> None:
    """Make the folder's episodes this plan's, or make sure that they are of the same code, parameters and scenarios.

    Raises:
        ConfigError: if they are not.
    """
    identity, held = plan.identity(), run.file(PLAN_FILE)
    run.own(ROWS, PLAN_FILE)
    remove_parts(run)
    if overwrite:
        run.begin_again()
        remove_rows(run)
    elif held.exists():
        identity = _merge(identity, read_record(Identity, held), run.path)
    run.write(PLAN_FILE, to_json(identity.model_dump()).encode())


def _merge(identity: Identity, held: Identity, folder: Path) -> Identity:
    """Return what a plan and a folder's episodes are together; raises ConfigError if they do not agree."""
    own, others = identity.model_dump(), held.model_dump()
    changed = [name for name in own if name not in _NAMED and own[name] != others[name]]
    for kinds, kind in _NAMED.items():
        changed += [
            f"{kind} {name!r}" for name in own[kinds] if own[kinds][name] != others[kinds].get(name, own[kinds][name])
        ]
        own[kinds] = others[kinds] | own[kinds]
    if changed:
        raise ConfigError(
            f"{folder}: holds episodes of another {', '.join(changed)}; choose another folder with --out or add "
            "--overwrite"
        )
    return Identity(**own)
