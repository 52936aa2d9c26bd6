"""Comparison of runs: the episodes that all of them have in common, the same number of each scenario."""

import json

import pytest

from sffr_gym import ConfigError
from sffr_gym.task.metrics import MEASURES
from sffr_gym.task.score import Result
from sffr_workbench.benchmark.compare import common_episodes, scenario_hashes
from sffr_workbench.benchmark.episodes import PLAN_FILE
from sffr_workbench.evaluation.run_folder import EPISODES_FILE, SUMMARY_FILE, episodes_csv


def episode(policy, scenario, seed, vibration=1.0):
    return Result(scenario, policy, seed, dict.fromkeys(MEASURES, 1.0) | {"vibration": vibration}, "", {})


def write(folder, results):
    folder.mkdir()
    (folder / EPISODES_FILE).write_text(episodes_csv(results))
    hashes = {result.scenario: result.scenario for result in results}
    (folder / PLAN_FILE).write_text(json.dumps({"scenarios": hashes}))
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


def test_hashes_are_those_of_the_benchmark_or_of_the_evaluation(tmp_path):
    assert scenario_hashes(write(tmp_path / "run", [episode("ahsc", "wild", 0)])) == {"wild": "wild"}
    (tmp_path / "run" / PLAN_FILE).unlink()
    (tmp_path / "run" / SUMMARY_FILE).write_text(json.dumps({"scenario": "wild", "scenario_hash": "0123"}))
    assert scenario_hashes(tmp_path / "run") == {"wild": "0123"}
