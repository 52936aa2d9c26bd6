"""Comparison of a schedule with AHSC on a few fixed episodes, to follow a training and choose its best model."""

from __future__ import annotations

import numpy as np

from agents.evaluate import result_of
from agents.learned import Schedule
from agents.learning.config import VALIDATION_SEED, Validation
from agents.score import REFERENCE, Result, costs, ratios
from baselines import make_policy
from baselines.policies import LawPolicy
from baselines.rollout import rollout
from sffr_gym.env import SFFRFlexEnv
from sffr_gym.params import Params
from sffr_gym.scenario import suite_hash

LEARNED = "learned"


class Validator:
    """AHSC's results on the episodes, and what a schedule scores beside them.

    Args:
        settings: which episodes; their seeds are neither a training's nor the evaluation's.
        params: the robot.

    Attributes:
        suite_hash: of the scenarios.
    """

    def __init__(self, settings: Validation, params: Params) -> None:
        self._params = params
        self._envs: dict[str, SFFRFlexEnv] = {}
        self._seeds: dict[str, list[int]] = {}
        for scenario in settings.scenarios:
            env = SFFRFlexEnv(scenario=scenario, params=params)
            if settings.duration is not None:
                env.scenario = env.scenario.model_copy(update={"duration": settings.duration})
            _, info = env.reset(seed=VALIDATION_SEED)
            count = settings.episodes if info["drawn"] else 1
            self._envs[env.scenario.name] = env
            self._seeds[env.scenario.name] = [VALIDATION_SEED + i for i in range(count)]
        self.suite_hash = suite_hash([env.scenario for env in self._envs.values()], params)
        policy = make_policy(REFERENCE, params)
        assert isinstance(policy, LawPolicy)
        self._reference = {name: self._run(name, policy) for name in self._envs}

    def __call__(self, schedule: Schedule) -> dict[str, float]:
        """Cost, and ratios of vibration and tracking to AHSC's, of every scenario and, as ``cost``, of their mean."""
        policy = schedule.policy(self._params, LEARNED)
        scores: dict[str, float] = {}
        for name in self._envs:
            results = {REFERENCE: self._reference[name], LEARNED: self._run(name, policy)}
            scores[f"{name}/vibration"] = ratios(results, "vibration", REFERENCE)[LEARNED]
            scores[f"{name}/tracking"] = ratios(results, "track_rmse", REFERENCE)[LEARNED]
            scores[f"{name}/cost"] = costs(results)[LEARNED]
        return scores | {"cost": float(np.mean([scores[f"{name}/cost"] for name in self._envs]))}

    def _run(self, name: str, policy: LawPolicy) -> list[Result]:
        return [result_of(rollout(self._envs[name], policy, seed)) for seed in self._seeds[name]]
