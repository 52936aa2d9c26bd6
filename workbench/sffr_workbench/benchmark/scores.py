"""Every policy's score over a suite of scenarios, with intervals, from its episodes alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sffr_gym import ConfigError
from sffr_gym.task.score import (
    REFERENCE,
    WEIGHTS,
    Result,
    cost_of_episodes,
    cost_of_means,
    episode_terms,
    ratios_of_means,
)
from sffr_gym.task.statistics import Estimate, interquartile_mean, probability_of_improvement, stratified_bootstrap
from sffr_gym.types import Array


@dataclass(frozen=True)
class PolicyScore:
    """A policy's score over some scenarios; everything is relative to AHSC on the same episodes."""

    cost: Estimate  #: from the ratios of means, averaged over the scenarios
    typical: Estimate  #: interquartile mean of the episodes' own costs
    difference: Estimate  #: interquartile mean of the paired differences of cost to AHSC, in units of AHSC's mean
    improvement: float  #: probability that an episode costs less than under AHSC
    ratios: dict[str, float]  #: of means, averaged over the scenarios, by measure
    failed: int  #: episodes that failed
    episodes: int  #: how many there were


@dataclass(frozen=True)
class SuiteScores:
    """All policies on all scenarios."""

    policies: tuple[str, ...]  #: names, in the order of the tables
    scenarios: tuple[str, ...]
    overall: dict[str, PolicyScore]  #: score of each policy over the suite
    single: dict[str, dict[str, PolicyScore]]  #: score of each policy in each scenario alone, by scenario, then policy
    costs: dict[str, Array]  #: (episodes, scenarios) cost of each episode of a policy, AHSC's being 1
    differences: dict[str, Array]  #: (episodes, scenarios) paired differences of cost to AHSC


def score_suite(results: Sequence[Result]) -> SuiteScores:
    """Score policies that ran on the same episodes, AHSC among them.

    A scenario of a single episode, which draws nothing, weighs as much as the others.

    Raises:
        ConfigError: without AHSC, or if the policies did not run on the same episodes.
    """
    groups, policies = paired(results)
    most = max(len(group[REFERENCE]) for group in groups.values())
    terms = {policy: np.empty((most, len(groups), 2 * len(WEIGHTS))) for policy in policies}
    for m, (scenario, group) in enumerate(groups.items()):
        for policy, table in episode_terms(group).items():
            if len(table) not in (1, most):
                raise ConfigError(f"{scenario}: {len(table)} episodes cannot stand beside {most}")
            terms[policy][:, m] = np.tile(table, (most // len(table), 1))
    single = {
        scenario: {policy: _score(terms[policy][:, m : m + 1], group[policy]) for policy in policies}
        for m, (scenario, group) in enumerate(groups.items())
    }
    overall = {
        policy: _score(terms[policy], [result for group in groups.values() for result in group[policy]])
        for policy in policies
    }
    return SuiteScores(
        policies, tuple(groups), overall, single,
        {policy: cost_of_episodes(terms[policy]) for policy in policies},
        {policy: paired_differences(terms[policy]) for policy in policies},
    )  # fmt: skip


def by_scenario(results: Sequence[Result]) -> dict[str, dict[str, list[Result]]]:
    """Group episodes by scenario, then policy, in the order of their first appearance, each sorted by seed."""
    groups: dict[str, dict[str, list[Result]]] = {}
    for result in sorted(results, key=lambda result: result.seed):
        groups.setdefault(result.scenario, {}).setdefault(result.policy, []).append(result)
    scenarios = dict.fromkeys(result.scenario for result in results)
    policies = dict.fromkeys(result.policy for result in results)
    return {
        scenario: {policy: groups[scenario][policy] for policy in policies if policy in groups[scenario]}
        for scenario in scenarios
    }


def paired(results: Sequence[Result]) -> tuple[dict[str, dict[str, list[Result]]], tuple[str, ...]]:
    """Return episodes by scenario, then policy, and the policies in the order of their first appearance.

    Raises:
        ConfigError: without AHSC, or if the policies did not run on the same episodes.
    """
    groups, policies = by_scenario(results), tuple(dict.fromkeys(result.policy for result in results))
    if REFERENCE not in policies:
        raise ConfigError(f"scores are relative to {REFERENCE!r}, which is not among {', '.join(policies)}")
    check_paired(groups, policies)
    return groups, policies


def check_paired(groups: Mapping[str, Mapping[str, Sequence[Result]]], policies: Sequence[str]) -> None:
    """Make sure that every policy ran on the same episodes.

    Raises:
        ConfigError: if one did not.
    """
    for scenario, group in groups.items():
        first = [result.seed for result in group[policies[0]]] if policies[0] in group else []
        for policy in policies:
            seeds = [result.seed for result in group.get(policy, ())]
            if seeds != first or not seeds:
                raise ConfigError(f"{scenario}: {policy} and {policies[0]} did not run on the same episodes")


def paired_differences(terms: Array) -> Array:
    """Return differences of cost to AHSC on the same episode over AHSC's mean, for terms (episodes, scenarios, 6).

    Their mean over the episodes of a scenario is the cost there less 1.
    """
    n = len(WEIGHTS)
    means = terms[..., n:].mean(axis=0)
    return ((terms[..., :n] - terms[..., n:]) / means) @ np.array(list(WEIGHTS.values()))


def _score(terms: Array, results: Sequence[Result]) -> PolicyScore:
    """Score one policy from its terms (episodes, scenarios, 6)."""
    costs = cost_of_episodes(terms)
    return PolicyScore(
        cost=stratified_bootstrap(terms, cost_of_means),
        typical=stratified_bootstrap(costs, interquartile_mean),
        difference=stratified_bootstrap(paired_differences(terms), interquartile_mean),
        improvement=probability_of_improvement(costs, np.ones_like(costs)),
        ratios=dict(zip(WEIGHTS, ratios_of_means(terms).mean(axis=0).tolist(), strict=True)),
        failed=sum(bool(result.failure) for result in results),
        episodes=len(results),
    )
