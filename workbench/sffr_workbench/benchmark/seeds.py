"""Scores of algorithms over their training seeds, from the episodes that a benchmark ran with every seed's policy."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sffr_baselines.laws import ORACLES
from sffr_gym.task.score import REFERENCE, WEIGHTS, Result, counted, ratio
from sffr_gym.task.statistics import CONFIDENCE, RESAMPLES, SEED, Estimate, interquartile_mean
from sffr_gym.types import Array
from sffr_workbench.benchmark.scores import paired

SEEDED = re.compile(r"(?P<algo>.+?)[-_]?(?P<seed>\d+)(/.*)?$")  # such as ppo-3/best


class SeedScore(NamedTuple):
    """An algorithm in one scenario."""

    seeds: int  #: how many there were, and episodes that failed
    episodes: int
    failed: int
    ratios: dict[str, Estimate]  #: each measure relative to AHSC's on the same episode, over seeds and episodes
    cost: Estimate  #: from these ratios, likewise


def score_seeds(results: Sequence[Result]) -> dict[str, dict[str, SeedScore]]:
    """Return scores by scenario, then algorithm or policy without seeds.

    Args:
        results: episodes of a benchmark, AHSC's among them; oracles, which do not run everywhere, are left out.
            Policies with seeds are called ``<algorithm><seed>``, with or without a file's name behind.

    Raises:
        ConfigError: without AHSC, or if the policies did not run on the same episodes.
    """
    groups, policies = paired([result for result in results if result.policy not in ORACLES.values()])
    families: dict[str, list[str]] = {}
    for policy in policies:
        match = SEEDED.fullmatch(policy)
        families.setdefault(match["algo"] if match else policy, []).append(policy)
    return {
        scenario: {family: _score(group, own) for family, own in families.items()} for scenario, group in groups.items()
    }


def over_seeds(costs: Array) -> Estimate:
    """Return the interquartile mean over training seeds and episodes, with a bootstrap interval that resamples both.

    The episodes drawn are the same for every seed, as they were when the policies ran.

    Args:
        costs: (episodes, seeds) of the episodes, or one of their ratios.
    """
    rng = np.random.default_rng(SEED)
    episodes, seeds = costs.shape
    rows = rng.integers(episodes, size=(RESAMPLES, episodes, 1))
    columns = rng.integers(seeds, size=(RESAMPLES, 1, seeds))
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = np.quantile(interquartile_mean(costs[rows, columns]), [tail, 1.0 - tail])
    return Estimate(float(interquartile_mean(costs)), float(low), float(high))


def _score(group: dict[str, list[Result]], family: list[str]) -> SeedScore:
    """Score the policies of one family in one scenario."""
    tables = {}
    for name in WEIGHTS:
        values = counted(group, name)
        tables[name] = np.column_stack([ratio(values[policy], values[REFERENCE]) for policy in family])
    cost = sum(weight * tables[name] for name, weight in WEIGHTS.items())
    own = [result for policy in family for result in group[policy]]
    return SeedScore(
        len(family), len(own) // len(family), sum(bool(result.failure) for result in own),
        {name: over_seeds(table) for name, table in tables.items()}, over_seeds(np.asarray(cost)),
    )  # fmt: skip
