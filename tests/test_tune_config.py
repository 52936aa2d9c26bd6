"""Configurations of searches: which intervals and choices there are, and what is refused; without torch."""

import pytest

from sffr_agents.tune_config import Dimension, load_tune
from sffr_gym import ConfigError


def test_an_interval_is_of_whole_numbers_if_both_of_its_ends_are():
    ends = [(1, 3), (1, 3.0), (1.0, 3), (1.0, 3.0)]
    assert [Dimension(key="x", low=low, high=high).whole for low, high in ends] == [True, False, False, False]


def test_an_interval_may_be_a_point_and_choices_may_be_one():
    """For a setting that stands in the plan and is not searched; an interval of ratios may lie above 1 or below it."""
    point, below = Dimension(key="x", low=2, high=2), Dimension(key="x", low=0.5, high=1.0, log=True)
    assert point.ends == (2, 2) and point.whole and below.ends == (0.5, 1.0) and not below.whole
    assert Dimension(key="x", choices=("a",)).ends == ("a",)
    for wrong in ({"choices": ()}, {}, {"low": 1}, {"high": 1}, {"low": 1, "high": 2, "choices": (1,)}):
        with pytest.raises(ValueError, match=r"at least 1|either low and high, or choices"):
            Dimension(key="x", **wrong)


@pytest.mark.parametrize(
    ("space", "message"),
    [
        ("{key: learning.gama, low: 0.9, high: 0.99}", "did you mean 'gamma'"),
        ("{key: learning.gamma, low: 0.9, high: 1.5}", "must be at most 1"),
        ("{key: learning.gamma, low: 0.9}", "needs either low and high, or choices"),
        ("{key: learning.gamma, low: 0.9, high: 0.99, choices: [0.95]}", "needs either"),
        ("{key: learning.gamma, low: 0.99, high: 0.9}", "must not exceed"),
        ("{key: learning.ent_coef, low: 0.0, high: 0.1, log: true}", "positive low"),
        ("{key: network.hidden, choices: [wide]}", "must be a list"),
    ],
)
def test_errors_of_a_search_are_named(space, message, tmp_path):
    file = tmp_path / "search.yaml"
    file.write_text(f"train: ppo\nspace:\n  - {space}\n")
    with pytest.raises(ConfigError, match=message):
        load_tune(file)


def test_every_shipped_search_is_valid():
    for name in ("ppo", "sac"):
        assert load_tune(name).train == name
