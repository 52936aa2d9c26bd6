"""Statistics of a benchmark: interquartile mean, stratified bootstrap, profiles, probability of improvement.

The definitions are those of Agarwal, Schwarzer, Castro, Courville and Bellemare, "Deep reinforcement learning at the
edge of the statistical precipice" (NeurIPS 2021), with the sign for costs, of which low ones are good. A table of
scores is (episodes, scenarios); a scenario is a stratum.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sffr_gym.types import Array

CONFIDENCE = 0.95
RESAMPLES = 2000
SEED = 0  # of the resampling: the same scores give the same interval

Statistic = Callable[[Array], Array]  # one number for each table, whose axes before the episodes number the tables


class Estimate(NamedTuple):
    """A statistic of the scores and its bootstrap interval."""

    value: float
    low: float
    high: float


def interquartile_mean(scores: ArrayLike) -> Array:
    """Return the mean of the middle half of all scores of a table.

    The lowest and the highest quarter are left out, each rounded down to whole scores.

    Args:
        scores: (..., episodes, scenarios).

    Returns:
        (...) one mean for each table.

    Raises:
        ValueError: without scores.

    Source: Agarwal et al. 2021, sec. 4.3; ``scipy.stats.trim_mean(scores, 0.25)``.
    """
    pooled = np.sort(_tables(scores).reshape(*np.shape(scores)[:-2], -1), axis=-1)
    cut = pooled.shape[-1] // 4
    middle: Array = pooled[..., cut : pooled.shape[-1] - cut].mean(axis=-1)
    return middle


def mean(scores: ArrayLike) -> Array:
    """Return the mean over scenarios of the means over episodes, (...) for tables (..., episodes, scenarios)."""
    value: Array = _tables(scores).mean(axis=(-2, -1))
    return value


def stratified_bootstrap(
    scores: ArrayLike,
    statistic: Statistic = interquartile_mean,
    confidence: float = CONFIDENCE,
    resamples: int = RESAMPLES,
    seed: int = SEED,
) -> Estimate:
    """Return a statistic with its percentile-bootstrap interval, the episodes resampled within each scenario.

    What belongs to the same episode stays together: scores on the same episodes are paired by giving their differences,
    or several numbers for each episode.

    Args:
        scores: (episodes, scenarios), or (episodes, scenarios, numbers) for a statistic of several.
        statistic: of tables (..., episodes, scenarios) or (..., episodes, scenarios, numbers).
        confidence: share of the resampled statistics inside the interval [-].
        resamples: number of resampled tables.
        seed: of the resampling.

    Raises:
        ValueError: without scores, or for a confidence that is not between 0 and 1.

    Source: Agarwal et al. 2021, sec. 4.1; Efron and Tibshirani, "An introduction to the bootstrap", ch. 13.
    """
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence must be between 0 and 1, got {confidence}")
    tail = 0.5 * (1.0 - confidence)
    low, high = np.quantile(statistic(resample(scores, resamples, seed)), [tail, 1.0 - tail])
    return Estimate(float(statistic(_tables(scores))), float(low), float(high))


def resample(scores: ArrayLike, resamples: int = RESAMPLES, seed: int = SEED) -> Array:
    """Return tables whose episodes are drawn with replacement, each scenario by itself.

    Args:
        scores: (episodes, scenarios, ...).
        resamples: number of tables.
        seed: of the resampling.

    Returns:
        (resamples, episodes, scenarios, ...).
    """
    table = _tables(scores)
    drawn = np.random.default_rng(seed).integers(len(table), size=(resamples, *table.shape[:2]))
    return table[drawn, np.arange(table.shape[1])]


def probability_of_improvement(scores: ArrayLike, others: ArrayLike) -> float:
    """Return the probability that a random episode's score is lower than another policy's, ties counting half.

    ``P = 1/M sum_m U_m / (N_m K_m)`` with the Mann-Whitney statistic of each scenario. Here lower is better.

    Args:
        scores: (episodes, scenarios) of a policy.
        others: (other episodes, scenarios) of the policy that it is compared with.

    Raises:
        ValueError: without scores, or if the scenarios differ in number.

    Source: Agarwal et al. 2021, sec. 4.3.
    """
    own, rival = _tables(scores), _tables(others)
    if own.shape[1] != rival.shape[1]:
        raise ValueError(f"scores of {own.shape[1]} and of {rival.shape[1]} scenarios cannot be compared")
    gap = own[:, None, :] - rival[None, :, :]
    return float(np.mean((gap < 0.0) + 0.5 * (gap == 0.0)))


def performance_profile(scores: ArrayLike, thresholds: ArrayLike) -> Array:
    """Return the share of scores up to each threshold, ``F(tau) = 1/M sum_m 1/N sum_n [x_nm <= tau]``.

    Args:
        scores: (..., episodes, scenarios).
        thresholds: (n_t,).

    Returns:
        (..., n_t).

    Source: Agarwal et al. 2021, sec. 4.2 (run-score distributions).
    """
    below = _tables(scores)[..., None] <= np.asarray(thresholds, dtype=np.float64)
    share: Array = below.mean(axis=(-3, -2))
    return share


def _tables(scores: ArrayLike) -> Array:
    """Return scores as an array of tables; raise ValueError if there are none."""
    table = np.asarray(scores, dtype=np.float64)
    if table.ndim < 2 or table.size == 0:
        raise ValueError(f"scores must be a table (episodes, scenarios) with at least one entry, got {table.shape}")
    return table
