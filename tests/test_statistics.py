"""Statistics against answers worked out by hand, SciPy, and the bootstrap's coverage of a known distribution."""

import numpy as np
import pytest
from scipy import stats

from sffr_gym.task.statistics import (
    Estimate,
    interquartile_mean,
    mean,
    performance_profile,
    probability_of_improvement,
    resample,
    stratified_bootstrap,
)


def scores(seed, *shape):
    return np.random.default_rng(seed).lognormal(size=shape)


def test_interquartile_mean_by_hand():
    """Of 1 to 8 the middle half is 3 to 6; outliers of both sides have no say."""
    table = np.arange(1.0, 9.0).reshape(4, 2)
    assert interquartile_mean(table) == 4.5
    table[0, 0], table[3, 1] = -1e9, 1e9
    assert interquartile_mean(table) == 4.5
    assert interquartile_mean([[1.0], [2.0], [6.0]]) == 3.0  # fewer than four: nothing to leave out


@pytest.mark.parametrize("shape", [(1, 1), (5, 1), (20, 9), (7, 3)])
def test_interquartile_mean_is_the_trimmed_mean(shape):
    table = scores(0, *shape)
    assert interquartile_mean(table) == pytest.approx(stats.trim_mean(table.ravel(), 0.25), rel=1e-12)


def test_many_tables_at_once():
    """Leading axes are tables by themselves."""
    tables = scores(1, 4, 6, 3)
    for statistic in interquartile_mean, mean:
        np.testing.assert_array_equal(statistic(tables), [statistic(table) for table in tables])
    profiles = performance_profile(tables, [0.5, 1.0])
    np.testing.assert_array_equal(profiles, [performance_profile(table, [0.5, 1.0]) for table in tables])


def test_bootstrap_draws_within_scenarios():
    """Scenarios whose episodes are all alike leave nothing to chance, however much the scenarios differ."""
    table = np.tile([1.0, 5.0, 100.0], (6, 1))
    assert stratified_bootstrap(table, mean) == Estimate(*[pytest.approx(106.0 / 3.0)] * 3)
    estimate = stratified_bootstrap(table)
    assert estimate.low == estimate.value == estimate.high


def test_bootstrap_draws_each_scenario_by_itself():
    """Scores of opposite sign in two scenarios cancel only where both draw the same episodes."""
    one = scores(10, 40, 1)
    for sign in (1.0, -1.0):
        estimate = stratified_bootstrap(np.hstack([one, sign * one]), mean)
        assert estimate.high - estimate.low == pytest.approx(2.0 * 1.96 * one.std() / np.sqrt(80.0), rel=0.15)


def test_bootstrap_is_that_of_scipy():
    """For one scenario and the mean, SciPy's percentile interval, up to the chance of the resampling."""
    table = scores(2, 40, 1)
    estimate = stratified_bootstrap(table, mean, resamples=20_000)
    known = stats.bootstrap(
        (table[:, 0],), np.mean, n_resamples=20_000, method="percentile", rng=np.random.default_rng(3)
    ).confidence_interval
    assert estimate.value == table.mean()
    width = known.high - known.low
    assert estimate.low == pytest.approx(known.low, abs=0.03 * width)
    assert estimate.high == pytest.approx(known.high, abs=0.03 * width)


def test_bootstrap_covers_the_truth_as_often_as_it_says():
    """Intervals of 400 samples of 2 x 50 normal scores around known means; a percentile interval runs a bit short."""
    rng, truth, tries = np.random.default_rng(4), 0.5 * (1.0 + 3.0), 400
    samples = rng.normal([1.0, 3.0], [0.5, 2.0], (tries, 50, 2))
    for confidence in 0.95, 0.5:
        found = [stratified_bootstrap(sample, mean, confidence, 400, seed) for seed, sample in enumerate(samples)]
        share = np.mean([low <= truth <= high for _, low, high in found])
        error = np.sqrt(confidence * (1.0 - confidence) / tries)
        assert confidence - 0.02 - 3.0 * error < share < confidence + 3.0 * error


def test_width_follows_the_number_of_episodes():
    """Of a normal distribution the interval of the mean is 2 x 1.96 sigma / sqrt(n) wide."""
    table = np.random.default_rng(5).normal(0.0, 1.0, (400, 1))
    estimate = stratified_bootstrap(table, mean)
    assert estimate.high - estimate.low == pytest.approx(2.0 * 1.96 * table.std() / 20.0, rel=0.08)


def test_bootstrap_repeats_and_follows_confidence_and_seed():
    table = scores(6, 20, 3)
    first = stratified_bootstrap(table)
    assert stratified_bootstrap(table) == first
    assert stratified_bootstrap(table, seed=1) != first
    narrow = stratified_bootstrap(table, confidence=0.5)
    assert first.low < narrow.low < narrow.value < narrow.high < first.high


def test_intervals_are_of_95_percent_2000_tables_and_one_seed_if_nothing_else_is_said():
    """As the published ones are, which anybody can compute again."""
    table = scores(11, 9, 2)
    assert stratified_bootstrap(table) == stratified_bootstrap(table, interquartile_mean, 0.95, 2000, 0)
    np.testing.assert_array_equal(resample(table), resample(table, 2000, 0))


def test_numbers_of_an_episode_stay_together():
    """Whatever is drawn, and however many numbers an episode has; each table has as many episodes as there are."""
    table = np.stack([scores(12, 5, 3), scores(13, 5, 3)], axis=-1)
    drawn = resample(table, 40)
    assert drawn.shape == (40, 5, 3, 2)
    for m in range(3):
        episodes = {tuple(numbers) for numbers in table[:, m].tolist()}
        assert {tuple(numbers) for numbers in drawn[:, :, m].reshape(-1, 2).tolist()} == episodes
    estimate = stratified_bootstrap(np.stack([table[..., 0], -table[..., 0]], axis=-1), lambda each: mean(each.sum(-1)))
    assert estimate == Estimate(0.0, 0.0, 0.0)


def test_probability_of_improvement_by_hand():
    """Of the pairs (1, 2), (1, 1), (3, 2), (3, 1) one is lower, one ties and two are higher."""
    assert probability_of_improvement([[1.0], [3.0]], [[2.0], [1.0]]) == 1.5 / 4.0
    table = scores(7, 5, 2)
    assert probability_of_improvement(table, table + 100.0) == 1.0
    assert probability_of_improvement(table, table) == 0.5


def test_probability_of_improvement_is_mann_whitney_in_each_scenario():
    own, others = scores(8, 12, 3), scores(9, 7, 3)
    shares = [stats.mannwhitneyu(others[:, m], own[:, m]).statistic / (12 * 7) for m in range(3)]
    assert probability_of_improvement(own, others) == pytest.approx(np.mean(shares), rel=1e-12)
    swapped = probability_of_improvement(others, own)
    assert probability_of_improvement(own, others) + swapped == pytest.approx(1.0, rel=1e-12)


def test_performance_profile_by_hand():
    table = [[1.0, 2.0], [3.0, 4.0]]
    np.testing.assert_array_equal(performance_profile(table, [0.5, 1.0, 2.5, 4.0, 9.0]), [0.0, 0.25, 0.5, 1.0, 1.0])


@pytest.mark.parametrize("empty", [[], [[]], 1.0, [1.0, 2.0]])
def test_what_is_no_table_raises(empty):
    for function in (interquartile_mean, mean, stratified_bootstrap, lambda table: performance_profile(table, [1.0])):
        with pytest.raises(ValueError, match=r"must be a table \(episodes, scenarios\)"):
            function(empty)


def test_errors_are_named():
    for confidence in 95, 1.0, 0.0, -0.1:
        with pytest.raises(ValueError, match=f"confidence must be between 0 and 1, got {confidence}"):
            stratified_bootstrap(scores(0, 3, 1), confidence=confidence)
    with pytest.raises(ValueError, match="2 and of 3 scenarios"):
        probability_of_improvement(scores(0, 4, 2), scores(0, 4, 3))
