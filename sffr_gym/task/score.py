"""The score: measures of a policy relative to AHSC's on the same episodes, and the cost that they add up to.

``cost = 0.60 V/V_ahsc + 0.35 E/E_ahsc + 0.05 U/U_ahsc`` with the vibration V, the tracking error E and the piezo effort
U; AHSC costs 1, and lower is better.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import nan

import numpy as np

from sffr_gym.types import Array

REFERENCE = "ahsc"
WEIGHTS = {"vibration": 0.60, "track_rmse": 0.35, "piezo_effort": 0.05}  # of the cost
FAILED = 10.0  # a failed episode counts as this many times the reference's


@dataclass(frozen=True)
class Result:
    """One episode of a policy."""

    scenario: str  #: names
    policy: str
    seed: int  #: of the episode
    measures: dict[str, float]  #: the values of ``metrics.MEASURES``
    failure: str  #: why it failed; empty if it did not
    drawn: dict[str, float]  #: what the scenario drew
    file: str = ""  #: hash of the file that the policy was given by; empty for a shipped one


Results = Mapping[str, Sequence[Result]]  # by policy, each with the same episodes of one scenario in the same order


def counted(results: Results, name: str, reference: str = REFERENCE) -> dict[str, Array]:
    """Return what each episode counts for in a measure, (episodes,) of each policy.

    A failed episode counts as ten times what the reference has there; where the reference itself failed, its mean over
    the episodes that it finished stands in. NaN if it finished none.
    """
    finished = [result.measures[name] for result in results[reference] if not result.failure]
    usual = float(np.mean(finished)) if finished else nan
    base = [usual if result.failure else result.measures[name] for result in results[reference]]
    return {
        policy: np.array([FAILED * b if r.failure else r.measures[name] for r, b in zip(own, base, strict=True)])
        for policy, own in results.items()
    }


def ratios(results: Results, name: str, reference: str) -> dict[str, float]:
    """Return each policy's mean of a measure relative to a reference policy's; failures as in :func:`counted`."""
    means = {policy: values.mean() for policy, values in counted(results, name, reference).items()}
    return {policy: float(ratio(mean, means[reference])) for policy, mean in means.items()}


def costs(results: Results) -> dict[str, float]:
    """Return the cost of each policy from the ratios of its means over the episodes; NaN without AHSC."""
    if REFERENCE not in results:
        return dict.fromkeys(results, nan)
    terms = {name: ratios(results, name, REFERENCE) for name in WEIGHTS}
    return {policy: sum(weight * terms[name][policy] for name, weight in WEIGHTS.items()) for policy in results}


def episode_terms(results: Results) -> dict[str, Array]:
    """Return what :func:`cost_of_means` and :func:`cost_of_episodes` need of each policy, (episodes, 6).

    The counted values of the measures in ``WEIGHTS``, then AHSC's on the same episodes.

    Raises:
        KeyError: without AHSC.
    """
    values = [counted(results, name) for name in WEIGHTS]
    return {
        policy: np.column_stack([*(each[policy] for each in values), *(each[REFERENCE] for each in values)])
        for policy in results
    }


def ratios_of_means(terms: Array) -> Array:
    """Return ratios (..., scenarios, 3) of means over the episodes, for terms (..., episodes, scenarios, 6)."""
    return _to_reference(terms.mean(axis=-3))


def cost_of_means(terms: Array) -> Array:
    """Return costs (...) by ratios of means, averaged over the scenarios, for terms (..., episodes, scenarios, 6)."""
    cost: Array = (ratios_of_means(terms) @ np.array(list(WEIGHTS.values()))).mean(axis=-1)
    return cost


def cost_of_episodes(terms: Array) -> Array:
    """Return the cost of each episode by itself (...), for terms (..., 6): AHSC's is 1 in every one."""
    cost: Array = _to_reference(terms) @ np.array(list(WEIGHTS.values()))
    return cost


def ratio(values: Array, reference: Array) -> Array:
    """Return ratios of non-negative measures; 1 where both vanish, infinite where only the reference does."""
    values, reference = np.broadcast_arrays(np.asarray(values, np.float64), np.asarray(reference, np.float64))
    otherwise = np.where(values == 0.0, 1.0, np.inf)
    otherwise[np.isnan(reference)] = nan
    return np.divide(values, reference, out=otherwise, where=reference > 0.0)


def _to_reference(terms: Array) -> Array:
    """Return ratios (..., 3) of the counted values to AHSC's, for terms (..., 6)."""
    return ratio(*np.split(terms, 2, axis=-1))
