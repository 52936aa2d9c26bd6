"""Scores and standings on made-up episodes whose answers are known."""

import math

import numpy as np
import pytest

from sffr_gym import ConfigError
from sffr_gym.task.score import (
    REFERENCE,
    WEIGHTS,
    Result,
    cost_of_episodes,
    cost_of_means,
    costs,
    counted,
    episode_terms,
    ratio,
    ratios,
)
from sffr_gym.task.statistics import Estimate, interquartile_mean
from sffr_workbench.benchmark.scores import paired_differences, score_suite


def episodes(scenario, policy, *values):
    """Episodes of a policy from (vibration, tracking, effort) each, None for a failed one."""
    made = []
    for seed, each in enumerate(values):
        measures = dict(zip(WEIGHTS, each or (1e-9, 1e-9, 1e-9), strict=True))
        made.append(Result(scenario, policy, seed, measures, "" if each else "lost grasp", {}))
    return made


def random_episodes(scenario, policy, count, seed):
    values = np.random.default_rng(seed).lognormal(size=(count, 3))
    return episodes(scenario, policy, *values.tolist())


@pytest.fixture(scope="module")
def suite():
    """Two policies in a scenario of six episodes and in one that draws nothing."""
    return [
        *random_episodes("wild", "ahsc", 6, 0),
        *random_episodes("wild", "other", 6, 1),
        *random_episodes("still", "ahsc", 1, 2),
        *random_episodes("still", "other", 1, 3),
    ]


def group(suite, scenario):
    names = dict.fromkeys(result.policy for result in suite)
    return {name: [r for r in suite if r.policy == name and r.scenario == scenario] for name in names}


def test_weights_add_up_to_one():
    assert list(WEIGHTS.values()) == [0.60, 0.35, 0.05]


def test_cost_of_means_is_that_of_one_scenario(suite):
    wild = group(suite, "wild")
    for policy, terms in episode_terms(wild).items():
        assert cost_of_means(terms[:, None]) == pytest.approx(costs(wild)[policy], rel=1e-12)


def test_costs_of_many_samples_are_those_of_each(suite):
    """Scenarios and episodes are averaged; whatever stands before them, such as draws of a bootstrap, is not."""
    wild = episode_terms(group(suite, "wild"))["other"]
    samples = np.array([np.stack([wild, k * wild[::-1]], axis=1) for k in (1.0, 2.0, 3.0)])
    np.testing.assert_allclose(cost_of_means(samples), [cost_of_means(each) for each in samples], rtol=1e-12)
    samples[..., 3:] = 2.0 * samples[..., :3]
    np.testing.assert_allclose(cost_of_means(samples), 0.5, rtol=1e-12)
    assert cost_of_means(samples).shape == (3,)


def test_cost_of_an_episode_by_hand():
    two = {
        "ahsc": episodes("s", "ahsc", (1.0, 2.0, 4.0), (2.0, 2.0, 2.0)),
        "other": episodes("s", "other", (3.0, 1.0, 4.0), None),
    }
    terms = episode_terms(two)
    np.testing.assert_allclose(cost_of_episodes(terms["other"]), [0.6 * 3.0 + 0.35 * 0.5 + 0.05, 10.0])
    np.testing.assert_array_equal(cost_of_episodes(terms["ahsc"]), 1.0)


def test_cost_is_the_weighted_ratio_of_suite_means():
    own = {
        "ahsc": episodes("s", "ahsc", (1.0, 2.0, 4.0), (3.0, 2.0, 4.0)),
        "other": episodes("s", "other", (1.0, 4.0, 0.0), (1.0, 4.0, 4.0)),
    }
    assert ratios(own, "vibration", "ahsc") == {"ahsc": 1.0, "other": 0.5}  # not (1 + 1/3) / 2
    assert costs(own)["ahsc"] == pytest.approx(1.0)
    assert costs(own)["other"] == pytest.approx(0.60 * 0.5 + 0.35 * 2.0 + 0.05 * 0.5)


def test_failed_episode_counts_ten_times_the_reference_there():
    own = {
        "ahsc": episodes("s", "ahsc", (1.0, 1.0, 1.0), (3.0, 1.0, 1.0)),
        "other": episodes("s", "other", (1.0, 1.0, 1.0), None),
        "lost": episodes("s", "lost", None, None),
    }
    assert ratios(own, "vibration", "ahsc")["other"] == pytest.approx((1.0 + 30.0) / 4.0)
    assert costs(own)["lost"] == pytest.approx(10.0)


def test_reference_that_fails_is_still_the_measure_of_all():
    own = {"ahsc": episodes("s", "ahsc", (2.0, 1.0, 1.0), None), "other": episodes("s", "other", None, (4.0, 1.0, 1.0))}
    assert ratios(own, "vibration", "ahsc") == {"ahsc": 1.0, "other": pytest.approx((20.0 + 4.0) / (2.0 + 20.0))}
    lost = {"ahsc": episodes("s", "ahsc", None), "other": episodes("s", "other", (1.0, 1.0, 1.0))}
    assert all(math.isnan(cost) for cost in costs(lost).values())


def test_ratio_to_nothing_is_one_for_nothing_and_infinite_for_something():
    own = {"none": episodes("s", "none", (1.0, 1.0, 0.0)), "off": episodes("s", "off", (1.0, 1.0, 0.0))}
    own["hsc"] = episodes("s", "hsc", (1.0, 1.0, 5.0))
    assert ratios(own, "piezo_effort", "none") == {"none": 1.0, "off": 1.0, "hsc": math.inf}
    assert all(math.isnan(cost) for cost in costs(own).values())  # no AHSC, no cost


def test_episode_that_nobody_finished_tells_nothing():
    """Where AHSC and another policy both fail, the other is as good as AHSC; one that finishes is far better."""
    lost = {
        "ahsc": episodes("s", "ahsc", (1.0, 1.0, 1.0), None),
        "other": episodes("s", "other", (1.0, 1.0, 1.0), None),
        "whole": episodes("s", "whole", (1.0, 1.0, 1.0), (1.0, 1.0, 1.0)),
    }
    terms = episode_terms(lost)
    np.testing.assert_allclose(cost_of_episodes(terms["other"]), [1.0, 1.0])
    np.testing.assert_allclose(cost_of_episodes(terms["whole"]), [1.0, 0.1])
    assert counted({"ahsc": episodes("s", "ahsc", None)}, "vibration")["ahsc"] == pytest.approx([math.nan], nan_ok=True)


def test_ratio_of_nothing():
    np.testing.assert_array_equal(
        ratio([0.0, 1.0, 3.0, 1.0], [0.0, 0.0, 2.0, math.nan]), [1.0, math.inf, 1.5, math.nan]
    )


def test_ahsc_scores_exactly_one(suite):
    table = score_suite(suite)
    for score in (table.overall[REFERENCE], *(scores[REFERENCE] for scores in table.single.values())):
        assert score.cost == Estimate(1.0, 1.0, 1.0) == score.typical
        assert score.difference == Estimate(0.0, 0.0, 0.0)
        assert score.improvement == 0.5
        assert set(score.ratios.values()) == {1.0}


def test_standings_by_hand(suite):
    """Every scenario weighs the same, the one with a single episode too."""
    table = score_suite(suite)
    assert table.policies == ("ahsc", "other") and table.scenarios == ("wild", "still")
    wild, still = costs(group(suite, "wild"))["other"], costs(group(suite, "still"))["other"]
    other = table.overall["other"]
    assert table.single["wild"]["other"].cost.value == pytest.approx(wild, rel=1e-12)
    assert table.single["still"]["other"].cost == Estimate(*[pytest.approx(still, rel=1e-12)] * 3)
    assert other.cost.value == pytest.approx(0.5 * (wild + still), rel=1e-12)
    assert other.cost.low < other.cost.value < other.cost.high
    own = cost_of_episodes(episode_terms(group(suite, "wild"))["other"])
    alone = cost_of_episodes(episode_terms(group(suite, "still"))["other"])
    pooled = np.column_stack([own, np.tile(alone, 6)])
    np.testing.assert_allclose(table.costs["other"], pooled, rtol=1e-12)
    assert other.typical.value == pytest.approx(float(interquartile_mean(pooled)), rel=1e-12)
    assert other.improvement == pytest.approx((pooled < 1.0).mean())
    assert (other.failed, other.episodes) == (0, 7)


def test_mean_of_the_paired_differences_is_the_cost_less_one(suite):
    wild = group(suite, "wild")
    gaps = paired_differences(episode_terms(wild)["other"][:, None])
    assert gaps.mean() == pytest.approx(costs(wild)["other"] - 1.0, rel=1e-12)


def test_order_of_the_episodes_does_not_matter(suite):
    assert (
        score_suite(suite).overall
        == score_suite(sorted(suite, key=lambda r: (r.scenario != "wild", r.policy, -r.seed))).overall
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda suite: [r for r in suite if r.policy != "ahsc"], "relative to 'ahsc'"),
        (lambda suite: suite[:-2] + suite[-1:], "did not run on the same episodes"),
        (lambda suite: [r for r in suite if (r.policy, r.seed) != ("other", 3)], "wild: other and ahsc did not run"),
        (lambda suite: suite + random_episodes("third", "ahsc", 4, 5) + random_episodes("third", "other", 4, 6),
         "third: 4 episodes cannot stand beside 6"),
    ],
)  # fmt: skip
def test_what_cannot_be_compared_is_rejected(suite, change, message):
    with pytest.raises(ConfigError, match=message):
        score_suite(change(suite))
