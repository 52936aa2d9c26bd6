"""A bound for schedules of a law's damping: the best one that an evolution strategy finds for given episodes.

With full knowledge of the episodes, and as many tries as it takes, CMA-ES searches the map from what is seen of a
panel to its actions: a linear one, ``a = tanh(W s + b)``, or one with a few rectified units between, which act where
something exceeds a threshold. Whatever a learner reaches by interaction stands beside it. The products among the
features make the map a switching law: it can brake a panel where it moves, and let go where it is bent.

Source: N. Hansen, "The CMA evolution strategy: a tutorial", arXiv:1604.00772.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from gymnasium.vector import AutoresetMode
from pydantic import AfterValidator, Field

from sffr_agents.config import VALIDATION_SEED
from sffr_baselines.damping_env import SFFRFlexDampingVectorEnv
from sffr_baselines.learned import LearnedSchedule, Network
from sffr_baselines.schedule import FEATURES
from sffr_baselines.scheduled import Scheduling
from sffr_gym.config.ranges import LARGEST_SEED
from sffr_gym.config.strict_yaml import ConfigError, check_error
from sffr_gym.config.suggestion import did_you_mean
from sffr_gym.envs.infos import Mask
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.score import FAILED, REFERENCE, WEIGHTS
from sffr_gym.types import Array

NAMES = tuple(name for name, _ in FEATURES)


def _check_feature(name: str) -> str:
    """Reject what is not seen of a panel."""
    if name not in NAMES:
        raise check_error(f"must be one of {', '.join(NAMES)}{did_you_mean(name, NAMES)}")
    return name


class BoundSettings(Scheduling):
    """What is searched."""

    scenarios: tuple[str, ...] = Field(default=("excited",), min_length=1, description="whose mean cost counts")
    features: tuple[Annotated[str, AfterValidator(_check_feature)], ...] = Field(
        default=NAMES, description="of a panel that may count: with few a search ends sooner and fits no single episode"
    )
    hidden: int = Field(default=0, ge=0, le=64, description="rectified units between what is seen and the actions")
    episodes: int = Field(default=8, ge=1, le=100, description="of each scenario that draws something")
    population: int = Field(default=12, ge=4, le=100, description="candidates of a generation")
    generations: int = Field(default=60, ge=1, le=10_000, description="how many")
    spread: float = Field(default=0.2, ge=1.0e-6, le=10.0, description="of the first candidates' weights about the law")
    effort_price: float = Field(default=1.0, ge=0.0, le=1.0e6, description="of the piezos, over its price in the score")
    seed: int = Field(default=0, ge=0, le=LARGEST_SEED, description="of the candidates")


class ScenarioEpisodes:
    """Episodes of one scenario, the same for every candidate and for AHSC.

    Args:
        scenario: name or file.
        settings: of the search.

    Raises:
        ConfigError: for a scenario or a law that is not valid, or if AHSC leaves nothing to compare with there.
    """

    def __init__(self, scenario: str, settings: BoundSettings) -> None:
        env = SFFRFlexEnv(scenario)
        env.reset(seed=VALIDATION_SEED)
        self._seeds = [VALIDATION_SEED + k for k in range(settings.episodes if env.episode.drawn else 1)]
        prices = WEIGHTS | {"piezo_effort": settings.effort_price * WEIGHTS["piezo_effort"]}
        self._prices = list(prices.values())
        arguments = {name: getattr(settings, name) for name in Scheduling.model_fields}
        self.batch = _batch(scenario, len(self._seeds) * settings.population, **arguments)
        reference = _batch(scenario, len(self._seeds), law=REFERENCE)
        n_f, n_a = _sizes(reference)
        measures, failed = run_episodes(reference, self._seeds, [np.zeros((1, n_a, n_f + 1))])
        self._usual = measures.mean(axis=(1, 2))
        if failed.any() or not (self._usual > 0.0).all():
            raise ConfigError(f"{scenario}: AHSC fails there, or leaves nothing that a cost could be relative to")

    def costs(self, layers: Sequence[Array]) -> Array:
        """Return the mean cost (population,) of candidates, whose layers are those of :func:`run_episodes`.

        The score, but for the price of effort; an episode that fails counts as ten times AHSC's.
        """
        measures, failed = run_episodes(self.batch, self._seeds * len(layers[0]), layers)
        ratios = np.where(failed, FAILED, measures / self._usual[:, None, None])
        return np.asarray(np.tensordot(self._prices, ratios, axes=1).mean(axis=1))


def _batch(scenario: str, n: int, **arguments: Any) -> SFFRFlexDampingVectorEnv:
    """Return environments of whole episodes, whose price is the squared piezo voltage over time [V2 s]."""
    prices = [f"reward.{name}.weight=0" for name in ("vibration", "tracking")]
    return SFFRFlexDampingVectorEnv(
        n, scenario=scenario, overrides=[*prices, "reward.effort={weight: 1, scale: 1}"], duration=None,
        random_phase=False, autoreset_mode=AutoresetMode.NEXT_STEP, **arguments,
    )  # fmt: skip


def _sizes(batch: SFFRFlexDampingVectorEnv) -> tuple[int, int]:
    """Return how many numbers a schedule sees of a panel, and how many actions that has."""
    return len(batch.obs_names) // batch.params.n_panels, len(batch.action_names) // batch.params.n_panels


def run_episodes(batch: SFFRFlexDampingVectorEnv, seeds: Sequence[int], layers: Sequence[Array]) -> tuple[Array, Mask]:
    """Run schedules from start to end.

    Args:
        batch: an environment for each of ``seeds``, the first ones for the first schedule.
        seeds: of the episodes.
        layers: of the schedules, (schedules, n_out, n_in + 1) with the biases last, from what is seen of a panel to its
            actions; rectified in between.

    Returns:
        What the score counts, in the order of its weights (3, schedules, episodes): mean energy [J] and root mean
        square error [m], both taken after every action, and effort [V2 s]; and which episodes failed.
    """
    shape = (len(layers[0]), -1, batch.params.n_panels, layers[0].shape[-1] - 1)
    obs, _ = batch.reset(seed=list(seeds))
    energy, square, effort, steps = np.zeros((4, len(seeds)))
    running, failed = np.ones((2, len(seeds)), dtype=np.bool_)
    while running.any():  # an environment that is done goes on with another episode, which does not count
        values = obs.reshape(shape)
        for k, layer in enumerate(layers):
            values = np.maximum(values, 0.0) if k else values
            values = np.einsum("paf,pesf->pesa", layer[..., :-1], values) + layer[:, None, None, :, -1]
        actions = np.tanh(values).reshape(len(seeds), -1).astype(np.float32)
        obs, _, terminated, truncated, infos = batch.step(actions)
        failed = np.where(running, terminated, failed)
        energy += np.where(running, infos["vibration"], 0.0)
        square += np.where(running, infos["object_error"], 0.0) ** 2
        effort += np.where(running, batch.step_prices.sum(axis=1), 0.0)
        steps += running
        running &= ~(terminated | truncated)
    measures = np.array([energy / steps, np.sqrt(square / steps), effort])
    return measures.reshape(3, len(layers[0]), -1), failed.reshape(len(layers[0]), -1)


def find_bound(
    settings: BoundSettings, start: LearnedSchedule | None = None
) -> Iterator[tuple[LearnedSchedule, float]]:
    """Search the best schedule of a panel for the episodes.

    Args:
        settings: what is searched.
        start: a schedule of a panel, of the same layers, about which the first candidates are spread; None for weights
            of 0, which make the law itself.

    Yields:
        After every generation the best schedule so far, and its cost there; AHSC's is 1.

    Raises:
        ConfigError: for a scenario or a law that is not valid, or a start that is no such schedule.
    """
    import cma  # of the extra `tune`

    episodes = [ScenarioEpisodes(name, settings) for name in settings.scenarios]
    batch = episodes[0].batch
    for name, other in zip(settings.scenarios, episodes, strict=True):
        if other.batch.action_names != batch.action_names:
            raise ConfigError(
                f"{name}: has the actions {', '.join(other.batch.action_names)}, where {settings.scenarios[0]} has "
                f"{', '.join(batch.action_names)}: search for each by itself"
            )
    n_f, n_a = _sizes(batch)
    sizes = (n_f, settings.hidden, n_a) if settings.hidden else (n_f, n_a)
    options = {"popsize": settings.population, "seed": settings.seed + 1, "verbose": -9}
    first = _layers_of(start, sizes)
    free = np.append(np.tile(np.isin(NAMES, settings.features), settings.stack_size), True)  # the bias always
    strategy = cma.CMAEvolutionStrategy(_searched(first, free), settings.spread, options)
    for _ in range(settings.generations):
        candidates = strategy.ask()
        layers = _with_searched(first, free, np.array(candidates))
        strategy.tell(candidates, np.mean([each.costs(layers) for each in episodes], axis=0))
        best = _with_searched(first, free, np.asarray(strategy.result.xbest))
        matrices, biases = tuple(each[:, :-1].copy() for each in best), tuple(each[:, -1].copy() for each in best)
        network = Network(matrices, biases, relu=settings.hidden > 0, squash=True)
        trained = {"algo": "cma-es", "evaluations": int(strategy.result.evaluations)} | settings.model_dump(mode="json")
        yield LearnedSchedule.of(network, batch, trained), float(strategy.result.fbest)


def _searched(layers: Sequence[Array], free: Mask) -> Array:
    """Return the weights that are searched: all, but of the first layer the free columns alone."""
    return np.concatenate([layers[0][:, free].ravel(), *(layer.ravel() for layer in layers[1:])])


def _with_searched(layers: Sequence[Array], free: Mask, values: Array) -> list[Array]:
    """Return layers whose searched weights have values (..., k), each with the leading sides of these."""
    at, made = 0, []
    for k, layer in enumerate(layers):
        columns = free if k == 0 else np.ones(layer.shape[1], dtype=np.bool_)
        count = len(layer) * int(columns.sum())
        changed = np.tile(layer, (*values.shape[:-1], 1, 1))
        changed[..., columns] = values[..., at : at + count].reshape(*values.shape[:-1], len(layer), -1)
        made.append(changed)
        at += count
    return made


def _layers_of(start: LearnedSchedule | None, sizes: tuple[int, ...]) -> list[Array]:
    """Return what a search begins from, (n_out, n_in + 1) of each layer with the bias last; raises ConfigError."""
    if start is None:
        return [np.zeros((n_out, n_in + 1)) for n_in, n_out in pairwise(sizes)]
    network = start.network
    if network.sizes != sizes or not network.squash or (len(sizes) > 2 and not network.relu):
        raise ConfigError(
            f"a search begins from a schedule with layers of {', '.join(map(str, sizes))}, as this command writes it; "
            f"got {', '.join(map(str, network.sizes))}"
        )
    return [np.column_stack(layer) for layer in zip(network.matrices, network.biases, strict=True)]
