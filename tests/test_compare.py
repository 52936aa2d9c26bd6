"""Comparison of runs: the episodes that all of them have in common, the same number of each scenario."""

import json

import pytest

from sffr_gym import ConfigError
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.task.metrics import MEASURES
from sffr_gym.task.score import Result
from sffr_workbench.benchmark.compare import common_episodes
from sffr_workbench.evaluation import (
    EPISODES_FILE,
    PLAN_FILE,
    SUMMARY_FILE,
    Identity,
    episodes_csv,
    open_run,
    scenario_hashes,
)


def episode(policy, scenario, seed, vibration=1.0):
    measures = dict.fromkeys(MEASURES, 1.0) | {"vibration": vibration, "failed": 0.0}
    return Result(scenario, policy, seed, measures, "", {})


def write(folder, results, hashes=None):
    hashes = hashes or {result.scenario: result.scenario for result in results}
    plan = Identity(version="1", code="", config_hash="", scenarios=hashes, policies={})
    with RunFolder.claim(folder, "benchmark") as run:
        run.replace({EPISODES_FILE: episodes_csv(results).encode(), PLAN_FILE: plan.model_dump_json().encode()})
    return folder


def seeds_of(results, policy):
    return {
        scenario: [result.seed for result in results if (result.policy, result.scenario) == (policy, scenario)]
        for scenario in dict.fromkeys(result.scenario for result in results)
    }


def test_unequal_runs_keep_the_lowest_common_seeds_of_each_scenario(tmp_path):
    """Seeds 1 to 5 of the first scenario are common, 0 to 2 of the second, and a single one of the third."""
    runs = {"ahsc": (range(6), range(3), [4]), "hsc": (range(1, 7), range(9), [4])}
    folders = [
        write(tmp_path / policy, [episode(policy, *key) for key in zip_names(seeds)]) for policy, seeds in runs.items()
    ]
    results = common_episodes(folders)
    for policy in runs:
        assert seeds_of(results, policy) == {"wild": [1, 2, 3], "offset": [0, 1, 2], "still": [4]}


@pytest.mark.parametrize(
    ("counts", "kept"), [((3, 2, 1), (2, 2, 1)), ((2, 2, 2), (2, 2, 2)), ((1, 5, 1), (1, 5, 1)), ((1, 1, 1), (1, 1, 1))]
)
def test_scenarios_are_cut_to_the_fewest_seeds_of_those_that_have_several(tmp_path, counts, kept):
    """Two are several; a scenario that draws nothing has one, and cuts none."""
    results = [episode("ahsc", *key) for key in zip_names([range(count) for count in counts])]
    found = seeds_of(common_episodes([write(tmp_path / "run", results)]), "ahsc")
    assert tuple(found.values()) == tuple(list(range(count)) for count in kept)


def zip_names(seeds):
    return [
        (name, seed)
        for name, own in zip(("wild", "offset", "still"), seeds, strict=True)
        for seed in own
    ]  # fmt: skip


def test_a_policy_of_two_runs_is_told_apart_where_its_episodes_differ(tmp_path):
    """Where they agree, the runs' episodes count together."""
    same = write(tmp_path / "same", [episode("ahsc", "wild", seed) for seed in (0, 1)])
    more = write(tmp_path / "more", [episode("ahsc", "wild", seed) for seed in (1, 2)])
    other = write(tmp_path / "other", [episode("ahsc", "wild", seed, vibration=2.0) for seed in (1, 2)])
    assert seeds_of(common_episodes([same, more]), "ahsc") == {"wild": [0, 1, 2]}
    results = common_episodes([same, other])
    assert [(result.policy, result.seed, result.measures["vibration"]) for result in results] == [
        ("ahsc", 1, 1.0), ("ahsc@other", 1, 2.0),
    ]  # fmt: skip
    twin = tmp_path / "twin"
    twin.mkdir()
    with pytest.raises(ConfigError, match="two runs are named 'other'"):
        common_episodes([same, other, write(twin / "other", [episode("ahsc", "wild", 1, vibration=3.0)])])


def test_runs_without_a_common_episode_cannot_be_compared(tmp_path):
    folders = [write(tmp_path / name, [episode(name, "wild", seed)]) for seed, name in enumerate(("ahsc", "hsc"))]
    with pytest.raises(ConfigError, match="no episode was run by all of ahsc, hsc"):
        common_episodes(folders)


def test_scenarios_of_one_name_must_be_the_same(tmp_path):
    """The message says which two runs disagree; a scenario that only one of them has does not matter."""
    one = write(tmp_path / "one", [episode("ahsc", "wild", 0)], {"wild": "a", "still": "b"})
    other = write(tmp_path / "other", [episode("hsc", "wild", 0)], {"wild": "c"})
    with pytest.raises(ConfigError, match=r"other: scenario 'wild' or its parameters are not those of .*one"):
        common_episodes([one, other])
    assert common_episodes([one, write(tmp_path / "third", [episode("hsc", "wild", 0)], {"wild": "a"})])


def test_hashes_are_those_of_the_benchmark_or_of_the_evaluation(tmp_path):
    assert scenario_hashes(open_run(write(tmp_path / "run", [episode("ahsc", "wild", 0)]))) == {"wild": "wild"}
    summary = {"scenario": "wild", "scenario_hash": "0123", "episodes": 1, "seed": 0, "policies": {}}
    with RunFolder.claim(tmp_path / "other", "evaluation") as run:
        run.replace({SUMMARY_FILE: json.dumps(summary).encode()})
    assert scenario_hashes(open_run(tmp_path / "other")) == {"wild": "0123"}
