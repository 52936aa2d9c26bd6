"""Evaluation: policies on the same episodes of a scenario."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from sffr_baselines.laws import ORACLES
from sffr_baselines.policies import Policy, check_titles, make_policy
from sffr_baselines.rollout import Trajectory, result_of, rollout
from sffr_gym import ConfigError, Params
from sffr_gym.config.arguments import check_arguments
from sffr_gym.envs.arguments import ParamsLike, resolve_robot
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.metrics import MEASURES
from sffr_gym.task.scenario import EVALUATION_SEED, EpisodeRange, Scenario, load_scenario
from sffr_gym.task.score import REFERENCE, Result
from sffr_workbench.common import Progress, ignore

DEFAULT_EPISODES = 10  # default of a scenario that draws something


@dataclass(frozen=True)
class Evaluation:
    """Policies on the same episodes."""

    scenario: Scenario  #: as they were run
    params: Params
    episodes: int  #: of each policy; episode i has the seed ``seed + i`` for all of them
    seed: int
    results: dict[str, list[Result]]  #: by policy, in the order of the episodes
    first: dict[str, Trajectory]  #: the first episode of each policy, for pictures
    started: datetime  #: when
    elapsed: float  #: how long it took [s]

    def summary(self) -> dict[str, Any]:
        """Return scenario, its hash, episodes, seed, and the mean over the episodes of every policy's measures."""
        policies = {
            policy: {name: float(np.mean([result.measures[name] for result in results])) for name in MEASURES}
            for policy, results in self.results.items()
        }
        what = {"scenario": self.scenario.name, "scenario_hash": self.scenario.hash(self.params)}
        return what | {"episodes": self.episodes, "seed": self.seed, "policies": policies}

    @property
    def reference(self) -> str:
        """The policy that ratios refer to: AHSC if it took part, else the first."""
        return REFERENCE if REFERENCE in self.results else next(iter(self.results))


@dataclass(frozen=True)
class EvaluationPlan:
    """What an evaluation runs; everything that can be told before anything runs is valid."""

    policies: tuple[Policy, ...]  #: in the order of tables, oracles among them
    file: str | os.PathLike[str]  #: the scenario's name or file
    scenario: Scenario
    params: Params
    episodes: int | None  #: of each policy; None for 10, or for 1 if the scenario draws nothing
    seed: int  #: of the first episode


def plan_evaluation(
    policies: Sequence[str],
    scenario: str | os.PathLike[str] = "nominal",
    episodes: int | None = None,
    seed: int = EVALUATION_SEED,
    params: ParamsLike = None,
    overrides: Sequence[str] = (),
) -> EvaluationPlan:
    """Return what an evaluation is to run; see :func:`evaluate`.

    Raises:
        ConfigError: for anything that is not valid.
    """
    chosen = load_scenario(scenario)
    resolved = resolve_robot(chosen, params, list(overrides))
    runners = make_policies(with_oracles(policies, chosen), resolved)
    asked = check_arguments(EpisodeRange, episodes=episodes, seed=seed)
    return EvaluationPlan(tuple(runners), scenario, chosen, resolved, asked.episodes, asked.seed)


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
    env = SFFRFlexEnv(scenario=plan.file, params=plan.params)
    env.reset(seed=plan.seed)
    episodes = plan.episodes or (DEFAULT_EPISODES if env.episode.drawn else 1)
    ends = np.cumsum([0, *(_length(env, plan.seed + i) for i in range(episodes))]).tolist()
    total = ends[-1] * len(plan.policies)
    results: dict[str, list[Result]] = {policy.name: [] for policy in plan.policies}
    first: dict[str, Trajectory] = {}
    for k, policy in enumerate(plan.policies):
        for i in range(episodes):
            begun = ends[-1] * k + ends[i]
            progress(policy.name, begun, total)
            trajectory = rollout(env, policy, plan.seed + i, episode_progress(progress, policy.name, begun, total))
            first.setdefault(policy.name, trajectory)
            results[policy.name].append(result_of(trajectory))
    progress(plan.policies[-1].name, total, total)
    elapsed = time.perf_counter() - clock
    return Evaluation(plan.scenario, plan.params, episodes, plan.seed, results, first, started, elapsed)


def evaluate(
    policies: Sequence[str],
    scenario: str | os.PathLike[str] = "nominal",
    episodes: int | None = None,
    seed: int = EVALUATION_SEED,
    params: ParamsLike = None,
    overrides: Sequence[str] = (),
    progress: Progress = ignore,
) -> Evaluation:
    """Run policies on the same episodes of a scenario.

    Args:
        policies: names, or ``.npz`` files of learned ones. Where a scenario's plant is not what the controllers
            believe, HSC and AHSC run with the right model as well.
        scenario: a shipped scenario's name or a file.
        episodes: of each policy; None for 10, or for 1 if the scenario draws nothing.
        seed: of the first episode, the next one has the next number.
        params: a ``Params`` object, a file, or None for the case study.
        overrides: assignments such as ``"panel.EI=25"`` on top of them.
        progress: called with policy, control periods done and control periods in all, first with 0 for each policy.

    Raises:
        ConfigError: for anything that is not valid; nothing has run then.
    """
    return run_evaluation(plan_evaluation(policies, scenario, episodes, seed, params, overrides), progress)


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


def make_policies(names: Sequence[str], params: Params) -> list[Policy]:
    """Build the policies.

    Raises:
        ConfigError: if there is none, for an unknown one and for one that is given twice.
    """
    if not names:
        raise ConfigError("no policy given")
    check_titles(names)
    return [make_policy(name, params) for name in names]


def _length(env: SFFRFlexEnv, seed: int) -> int:
    """Return the number of control periods of an episode."""
    env.reset(seed=seed)
    return env.ticks
