"""A bound for schedules of a law's damping: the best linear one that an evolution strategy finds for given episodes.

With full knowledge of the episodes, and as many tries as it takes, CMA-ES searches the map from what is seen of a
panel to its actions, ``a = tanh(W s + b)``. Whatever a learner reaches by interaction stands beside it. The products
among the features make the map a switching law: it can brake a panel where it moves, and let go where it is bent.

Source: N. Hansen, "The CMA evolution strategy: a tutorial", arXiv:1604.00772.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from gymnasium.vector import AutoresetMode
from pydantic import Field

from sffr_agents.config import VALIDATION_SEED
from sffr_baselines.damping_env import SFFRFlexDampingVectorEnv
from sffr_baselines.learned import LearnedSchedule, Network
from sffr_baselines.policies import make_policy
from sffr_baselines.rollout import result_of, rollout
from sffr_baselines.schedule import N_FEATURES
from sffr_baselines.scheduled import Scheduling
from sffr_gym.config.ranges import LARGEST_SEED
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.score import FAILED, REFERENCE, WEIGHTS
from sffr_gym.types import Array


class BoundSettings(Scheduling):
    """What is searched."""

    scenarios: tuple[str, ...] = Field(default=("excited",), min_length=1, description="whose mean cost counts")
    episodes: int = Field(default=8, ge=1, le=100, description="of each scenario that draws something")
    population: int = Field(default=12, ge=4, le=100, description="candidates of a generation")
    generations: int = Field(default=60, ge=1, le=10_000, description="how many")
    spread: float = Field(default=0.5, ge=1.0e-6, le=10.0, description="of the first candidates' weights about the law")
    seed: int = Field(default=0, ge=0, le=LARGEST_SEED, description="of the candidates")


class ScenarioEpisodes:
    """Episodes of one scenario, the same for every candidate, side by side in one batch.

    Args:
        scenario: name or file.
        settings: of the search.
    """

    def __init__(self, scenario: str, settings: BoundSettings) -> None:
        env = SFFRFlexEnv(scenario)
        env.reset(seed=VALIDATION_SEED)
        self.count = settings.episodes if env.episode.drawn else 1
        self._seeds = [VALIDATION_SEED + k for k in range(self.count)] * settings.population
        self._shape = (settings.population, self.count, env.params.n_panels)
        self._steps = -(-env.ticks // round(settings.agent_period / env.params.control.period))
        prices, self._usual_error = score_prices(env, self._seeds[: self.count])
        self.batch = SFFRFlexDampingVectorEnv(
            len(self._seeds), scenario=scenario, overrides=prices, duration=None,
            random_phase=False, autoreset_mode=AutoresetMode.NEXT_STEP, law=settings.law, rho=settings.rho,
            agent_period=settings.agent_period, base_tolerance=settings.base_tolerance,
        )  # fmt: skip

    def costs(self, weights: Array) -> Array:
        """Return the mean cost (population,) of candidates (population, n_actions of a panel, N_FEATURES + 1).

        The score, but that the tracking error is taken once an action. An episode that fails counts as there; what its
        environment does after that does not count.
        """
        obs, _ = self.batch.reset(seed=self._seeds)
        (total, square), count = np.zeros((2, len(self._seeds))), len(self.batch.action_names)
        failed = np.zeros(len(total), dtype=np.bool_)
        for _ in range(self._steps):
            seen = obs.reshape(*self._shape, N_FEATURES)
            raw = np.einsum("paf,pesf->pesa", weights[..., :-1], seen) + weights[:, None, None, :, -1]
            obs, _, terminated, _, infos = self.batch.step(np.tanh(raw).reshape(-1, count).astype(np.float32))
            failed |= terminated
            total += np.where(failed, 0.0, self.batch.step_prices.sum(axis=1))
            square += np.where(failed, 0.0, infos["object_error"]) ** 2
        total += WEIGHTS["track_rmse"] * np.sqrt(square / self._steps) / self._usual_error
        total[failed] = FAILED
        return np.asarray(total.reshape(self._shape[:2]).mean(axis=1))


def score_prices(env: SFFRFlexEnv, seeds: Sequence[int]) -> tuple[tuple[str, ...], float]:
    """Return settings of the reward by which vibration and effort cost as in the score, and the mean error under AHSC.

    Ratios of means to AHSC's on these episodes. The tracking error, whose root no sum of prices has, has none.
    """
    policy, reward = make_policy(REFERENCE, env), env.params.reward
    results = [result_of(rollout(env, policy, seed)).measures for seed in seeds]
    vibration, error, effort = (float(np.mean([each[name] for each in results])) for name in WEIGHTS)
    length, weight = env.ticks * env.params.control.period, WEIGHTS
    prices = {
        "vibration": weight["vibration"] * reward.vibration.scale / (vibration * length),
        "tracking": 0.0,
        "effort": weight["piezo_effort"] * reward.effort.scale**2 / effort,
    }
    return tuple(f"reward.{name}.weight={price!r}" for name, price in prices.items()), error


def find_bound(
    settings: BoundSettings, start: LearnedSchedule | None = None
) -> Iterator[tuple[LearnedSchedule, float]]:
    """Search the best linear schedule of a panel for the episodes.

    Args:
        settings: what is searched.
        start: a linear schedule of a panel about which the first candidates are spread; None for the law itself.

    Yields:
        After every generation the best schedule so far, and its cost there; AHSC's is 1.

    Raises:
        ConfigError: for a scenario or a law that is not valid, or a start that is no such schedule.
    """
    import cma  # of the extra `tune`

    episodes = [ScenarioEpisodes(name, settings) for name in settings.scenarios]
    batch = episodes[0].batch
    shape = (len(batch.action_names) // batch.params.n_panels, N_FEATURES + 1)
    options = {"popsize": settings.population, "seed": settings.seed + 1, "verbose": -9}
    strategy = cma.CMAEvolutionStrategy(_weights(start, shape).ravel(), settings.spread, options)
    for _ in range(settings.generations):
        candidates = strategy.ask()
        weights = np.array(candidates).reshape(settings.population, *shape)
        strategy.tell(candidates, np.mean([each.costs(weights) for each in episodes], axis=0))
        best = np.asarray(strategy.result.xbest).reshape(shape)
        network = Network((best[:, :-1].copy(),), (best[:, -1].copy(),), relu=False, squash=True)
        trained = {"algo": "cma-es", "evaluations": int(strategy.result.evaluations)} | settings.model_dump(mode="json")
        yield LearnedSchedule.of(network, batch, trained), float(strategy.result.fbest)


def _weights(start: LearnedSchedule | None, shape: tuple[int, int]) -> Array:
    """Return what a search begins from, (n_actions of a panel, N_FEATURES + 1): matrix and bias; raises ConfigError."""
    if start is None:
        return np.zeros(shape)
    network = start.network
    if network.sizes != (shape[1] - 1, shape[0]) or not network.squash:
        raise ConfigError(
            f"a search begins from a linear schedule of {shape[1] - 1} inputs and {shape[0]} outputs, as this command "
            f"writes it; got layers of {', '.join(map(str, network.sizes))}"
        )
    return np.column_stack([network.matrices[0], network.biases[0]])
