"""Comparison of a schedule with AHSC on a few fixed episodes, to follow a training and choose its best model."""

from __future__ import annotations

import numpy as np

from sffr_agents.config import VALIDATION_SEED, Validation
from sffr_baselines import make_policy
from sffr_baselines.learned import LearnedSchedule
from sffr_baselines.policies import Policy
from sffr_baselines.rollout import result_of, rollout
from sffr_gym.config.params import Params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.scenario import Scenario, load_scenario, suite_hash
from sffr_gym.task.score import REFERENCE, Result, Results, cost_of_episodes, costs, episode_terms, ratios
from sffr_gym.types import Array

LEARNED = "learned"


class Validator:
    """AHSC's results on the episodes, and what a schedule scores beside them.

    Args:
        settings: which episodes; their seeds are neither a training's nor the evaluation's.
        params: the robot.
    """

    def __init__(self, settings: Validation, params: Params) -> None:
        self._envs: dict[str, SFFRFlexEnv] = {}
        self._seeds: dict[str, list[int]] = {}
        for scenario in suite(settings):
            env = SFFRFlexEnv(scenario, params)
            env.reset(seed=VALIDATION_SEED)
            count = settings.episodes if env.episode.drawn else 1
            self._envs[scenario.name] = env
            self._seeds[scenario.name] = [VALIDATION_SEED + i for i in range(count)]
        self._reference = {name: self._run(name, make_policy(REFERENCE, env)) for name, env in self._envs.items()}

    def __call__(self, schedule: LearnedSchedule) -> dict[str, float]:
        """Return ratios to AHSC and cost of every scenario and, as ``cost``, the mean of the costs."""
        scores: dict[str, float] = {}
        for name, results in self._results(schedule).items():
            scores[f"{name}/vibration"] = ratios(results, "vibration", REFERENCE)[LEARNED]
            scores[f"{name}/tracking"] = ratios(results, "track_rmse", REFERENCE)[LEARNED]
            scores[f"{name}/cost"] = costs(results)[LEARNED]
        return scores | {"cost": float(np.mean([scores[f"{name}/cost"] for name in self._envs]))}

    def episode_costs(self, schedule: LearnedSchedule) -> Array:
        """Return the cost (episodes, scenarios) of each episode; a scenario that draws nothing repeats its only one."""
        columns = [cost_of_episodes(episode_terms(each)[LEARNED]) for each in self._results(schedule).values()]
        most = max(map(len, columns))
        return np.column_stack([np.resize(column, most) for column in columns])

    def _results(self, schedule: LearnedSchedule) -> dict[str, Results]:
        """Return the episodes of AHSC and of the schedule in each scenario."""
        return {
            name: {REFERENCE: self._reference[name], LEARNED: self._run(name, schedule.policy(env.params, LEARNED))}
            for name, env in self._envs.items()
        }

    def _run(self, name: str, policy: Policy) -> list[Result]:
        return [result_of(rollout(self._envs[name], policy, seed)) for seed in self._seeds[name]]


def suite(settings: Validation) -> list[Scenario]:
    """Return the scenarios that choose the best model."""
    changes = {} if settings.duration is None else {"duration": settings.duration}
    return [load_scenario(name).model_copy(update=changes) for name in settings.scenarios]


def hash_of_suite(settings: Validation, params: Params) -> str:
    """Return the hash of what defines these episodes."""
    return suite_hash(suite(settings), params)
