"""Evaluation: policies on the same episodes of a scenario."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from math import nan
from typing import Any

import numpy as np

from sffr_baselines.laws import ORACLES
from sffr_baselines.learned import file_hash
from sffr_baselines.own_law import UnfitError
from sffr_baselines.policies import (
    POLICIES,
    Policy,
    check_titles,
    make_policy,
    policy_file,
    policy_title,
    warn_of_instability,
)
from sffr_baselines.rollout import STRIDE, Trajectory, result_of, rollout, rollouts
from sffr_gym import ConfigError, Params
from sffr_gym.config.arguments import check_arguments
from sffr_gym.config.suggestion import did_you_mean
from sffr_gym.envs.arguments import ParamsLike, ScenarioLike, resolve_robot, resolve_scenario
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.metrics import measured
from sffr_gym.task.scenario import EVALUATION_SEED, EpisodeRange, Scenario
from sffr_gym.task.score import REFERENCE, Result, costs
from sffr_workbench.common import Progress, ignore
from sffr_workbench.evaluation.notebook import frame_of, html_of, rows_of
from sffr_workbench.evaluation.recording import Recording, recording_name

DEFAULT_EPISODES = 10  # default of a scenario that draws something


@dataclass(frozen=True)
class Evaluation:
    """Policies on the same episodes: :attr:`rows`, :meth:`frame`, :attr:`table`, trajectories in :attr:`first`."""

    scenario: Scenario  #: as they were run
    params: Params
    episodes: int  #: of each policy; episode i has the seed ``seed + i`` for all of them
    seed: int
    results: dict[str, list[Result]]  #: by policy, in the order of the episodes
    first: dict[str, Trajectory]  #: the first recorded episode of each policy, for pictures
    recordings: dict[str, bytes]  #: contents of the recordings' files, by their names in the run folder
    names: dict[str, str]  #: by which each policy was made, by what tables call it
    files: dict[str, str]  #: hash of the file that decides what a policy does, of those that have one
    skipped: dict[str, str]  #: policies that cannot control this robot, and why
    started: datetime  #: when
    elapsed: float  #: how long it took [s]

    def summary(self) -> dict[str, Any]:
        """Return scenario, its hash, episodes, seed, and the mean over the episodes of every policy's measures."""
        names = measured(result.measures for results in self.results.values() for result in results)
        policies = {
            policy: {name: float(np.mean([result.measures.get(name, nan) for result in results])) for name in names}
            for policy, results in self.results.items()
        }
        what = {"scenario": self.scenario.name, "scenario_hash": self.scenario.hash(self.params)}
        return what | {"episodes": self.episodes, "seed": self.seed, "policies": policies}

    @property
    def rows(self) -> list[dict[str, Any]]:
        """A mapping for each episode: scenario, policy, seed, every measure, failure, what was drawn."""
        return rows_of(self.results)

    def frame(self) -> Any:
        """Return the rows as a ``pandas.DataFrame``; as they are where pandas is not installed."""
        return frame_of(self.results)

    @property
    def table(self) -> dict[str, dict[str, float]]:
        """The means over the episodes of every policy's measures, and ``cost`` where AHSC took part."""
        means: dict[str, dict[str, float]] = self.summary()["policies"]
        price = costs(self.results) if REFERENCE in self.results else {}
        return {policy: own | ({"cost": price[policy]} if price else {}) for policy, own in means.items()}

    def trajectory(self, policy: str, seed: int | None = None, stride: int = STRIDE) -> Trajectory:
        """Return an episode of a policy with its histories, run again unless it is its first.

        Args:
            policy: as tables call it.
            seed: of the episode; the first if left out.
            stride: control periods between recorded states.

        Raises:
            ConfigError: for a policy that took no part.
        """
        if policy not in self.first:
            raise ConfigError(f"no {policy!r}{did_you_mean(policy, self.first)} (there are {', '.join(self.first)})")
        if seed in (None, self.seed) and stride == STRIDE:
            return self.first[policy]
        env = SFFRFlexEnv(scenario=self.scenario, params=self.params)
        again = make_policy(self.names.get(policy, policy), env.params)
        return rollout(env, again, self.seed if seed is None else seed, stride=stride)

    def _repr_html_(self) -> str:
        title = f"{self.scenario.name}: {self.episodes} episodes from seed {self.seed}"
        return html_of(self.results, title, [f"skipped: {reason}" for reason in self.skipped.values()])

    @property
    def reference(self) -> str:
        """The policy that ratios refer to: AHSC if it took part, else the first."""
        return REFERENCE if REFERENCE in self.results else next(iter(self.results))


@dataclass(frozen=True)
class EvaluationPlan:
    """What an evaluation runs; everything that can be told before anything runs is valid."""

    policies: tuple[Policy, ...]  #: in the order of tables, oracles among them
    names: dict[str, str]  #: by which each policy was made, by what tables call it
    files: dict[str, str]  #: hash of the file that decides what a policy does, of those that have one
    skipped: dict[str, str]  #: policies that cannot control this robot, and why
    scenario: Scenario
    params: Params
    episodes: int | None  #: of each policy; None for 10, or for 1 if the scenario draws nothing
    seed: int  #: of the first episode
    recorded: tuple[int, ...] | None = (0,)  #: episodes that are recorded, counted from 0; None for all


def plan_evaluation(
    policies: Iterable[str | os.PathLike[str]],
    scenario: ScenarioLike = "nominal",
    episodes: int | None = None,
    seed: int = EVALUATION_SEED,
    params: ParamsLike = None,
    overrides: Sequence[str] = (),
    record: Sequence[int] | None = (0,),
) -> EvaluationPlan:
    """Return what an evaluation is to run; see :func:`evaluate`.

    Raises:
        ConfigError: for anything that is not valid.
    """
    policies, chosen = policy_names(policies), resolve_scenario(scenario)
    resolved = resolve_robot(chosen, params, list(overrides))
    runners, skipped = fitting_policies(with_oracles(policies, chosen), resolved)
    asked = check_arguments(EpisodeRange, episodes=episodes, seed=seed)
    files = {title: each for title, each in file_hashes(given_files(policies)).items() if title not in skipped}
    names = {policy_title(name): name for name in policies if policy_title(name) not in skipped}
    recorded = None if record is None else tuple(record)
    about = names, files, skipped, chosen, resolved
    return EvaluationPlan(tuple(runners), *about, asked.episodes, asked.seed, recorded)


def run_evaluation(plan: EvaluationPlan, progress: Progress = ignore) -> Evaluation:
    """Run policies on the same episodes of a scenario.

    Args:
        plan: what to run.
        progress: see :func:`evaluate`.

    Raises:
        ConfigError: for an episode that cannot be run.
    """
    started, clock = datetime.now(UTC), time.perf_counter()
    progress(plan.policies[0].name, 0, 0)
    env = SFFRFlexEnv(scenario=plan.scenario, params=plan.params)
    if plan.scenario.changes_model:  # else the plan has looked at it
        for policy in plan.policies:
            warn_of_instability(policy, env)
    env.reset(seed=plan.seed)
    episodes = plan.episodes or (DEFAULT_EPISODES if env.episode.drawn else 1)
    ends = np.cumsum([0, *(_length(env, plan.seed + i) for i in range(episodes))]).tolist()
    total = ends[-1] * len(plan.policies)
    results: dict[str, list[Result]] = {policy.name: [] for policy in plan.policies}
    first: dict[str, Trajectory] = {}
    recordings: dict[str, bytes] = {}
    recorded = _recorded(plan, episodes)
    for k, policy in enumerate(plan.policies):
        progress(policy.name, ends[-1] * k, total)
        report = episode_progress(progress, policy.name, ends[-1] * k, total)
        for trajectory in rollouts(env, policy, range(plan.seed, plan.seed + episodes), report):
            if trajectory.seed - plan.seed in recorded:
                name = recording_name(policy.name, trajectory.seed if policy.name in first else None)
                recordings[name] = Recording.of(trajectory).to_bytes()
                first.setdefault(policy.name, trajectory)
            own = plan.files.get(policy.name, "")
            results[policy.name].append(replace(result_of(trajectory), file=own))
    progress(plan.policies[-1].name, total, total)
    elapsed = time.perf_counter() - clock
    about = plan.names, plan.files, plan.skipped
    kept = results, first, recordings
    return Evaluation(plan.scenario, plan.params, episodes, plan.seed, *kept, *about, started, elapsed)


def evaluate(
    policies: Iterable[str | os.PathLike[str]],
    scenario: ScenarioLike = "nominal",
    episodes: int | None = None,
    seed: int = EVALUATION_SEED,
    params: ParamsLike = None,
    overrides: Sequence[str] = (),
    progress: Progress = ignore,
    record: Sequence[int] | None = (0,),
) -> Evaluation:
    """Run policies on the same episodes of a scenario.

    Args:
        policies: names, ``.npz`` files of learned ones, or laws of your own as ``mine.py:MyLaw``. Where a scenario's
            plant is not what the controllers believe, HSC and AHSC run with the right model as well.
        scenario: a shipped scenario's name, a file, or a mapping of its keys.
        episodes: of each policy; None for 10, or for 1 if the scenario draws nothing.
        seed: of the first episode, the next one has the next number.
        params: a ``Params`` object, a file, or None for the case study.
        overrides: assignments such as ``"panel.EI=25"`` on top of them.
        progress: called with policy, control periods done and control periods in all, first with 0 for each policy.
        record: episodes whose recordings are kept, counted from 0; None for all.

    Raises:
        ConfigError: for anything that is not valid; nothing has run then.
    """
    return run_evaluation(plan_evaluation(policies, scenario, episodes, seed, params, overrides, record), progress)


def policy_names(policies: Iterable[str | os.PathLike[str]]) -> list[str]:
    """Return the names of policies as a list of texts; raises ConfigError for what is none, such as a single name."""
    listed = isinstance(policies, Iterable) and not isinstance(policies, str | bytes)
    names = list(policies) if listed else []
    if not listed or not all(isinstance(name, str | os.PathLike) for name in names):
        shown = names if listed else policies
        raise ConfigError(f"policies = {shown!r}: must be a list of names such as ['ahsc', 'mine.py:MyLaw']")
    return [os.fspath(name) for name in names]


def with_oracles(policies: Sequence[str], scenario: Scenario) -> list[str]:
    """Return the policies, each followed by its oracle if it has one and the plant is not what it believes."""
    names: list[str] = []
    for policy in policies:
        names.append(policy)
        oracle = ORACLES.get(policy)
        if scenario.changes_model and oracle is not None and oracle not in policies:
            names.append(oracle)
    return names


def episode_progress(progress: Progress, policy: str, begun: int, total: int) -> Callable[[int], None]:
    """Return the callback that turns the increments of an episode into the progress of the whole evaluation."""
    done = begun

    def count(ticks: int) -> None:
        nonlocal done
        done += ticks
        progress(policy, done, total)

    return count


def fitting_policies(names: Sequence[str], params: Params) -> tuple[list[Policy], dict[str, str]]:
    """Build the policies that can control a robot.

    Returns:
        The policies, and of those that cannot what tables call them, and why.

    Raises:
        ConfigError: if there is none, for an unknown one and for one that is given twice.
    """
    if not names:
        raise ConfigError("no policy given")
    check_titles(names)
    policies: list[Policy] = []
    skipped: dict[str, str] = {}
    for name in names:
        try:
            policies.append(make_policy(name, params))
        except UnfitError as error:
            skipped[policy_title(name)] = str(error)
    if not policies:
        raise ConfigError("\n".join(skipped.values()))
    return policies, skipped


def file_hashes(names: Sequence[str]) -> dict[str, str]:
    """Return the hash of each policy's file, by what tables call it, of those that have one."""
    files = {policy_title(name): policy_file(name) for name in names}
    return {title: file_hash(file) for title, file in files.items() if file is not None}


def given_files(names: Sequence[str]) -> list[str]:
    """Return the policies that are given by a file of the user's, not by a shipped name."""
    return [name for name in names if name not in POLICIES]


def make_policies(names: Sequence[str], params: Params) -> list[Policy]:
    """Build the policies.

    Raises:
        ConfigError: if there is none, for an unknown one, one that is given twice or cannot control the robot.
    """
    policies, skipped = fitting_policies(names, params)
    if skipped:
        raise UnfitError("\n".join(skipped.values()))
    return policies


def _recorded(plan: EvaluationPlan, episodes: int) -> set[int]:
    """Return the episodes that are recorded; raises ConfigError for one that does not exist."""
    chosen = set(range(episodes) if plan.recorded is None else plan.recorded)
    if not chosen or not chosen <= set(range(episodes)):
        beyond = sorted(chosen - set(range(episodes)))
        raise ConfigError(f"record {beyond[0] if beyond else 'nothing'}: episodes count from 0 to {episodes - 1}")
    return chosen


def _length(env: SFFRFlexEnv, seed: int) -> int:
    """Return the number of control periods of an episode."""
    env.reset(seed=seed)
    return env.ticks
