"""`sffr sweep-train`: each is the training of `sffr train`, runs once, and is refused before anything runs."""

import csv

import pytest
from command_line import sffr
from small_training import PPO_SMALL, assert_same, small, weights

from sffr_agents.folder import BEST
from sffr_gym import ConfigError
from sffr_workbench.benchmark.episodes import code_hash
from sffr_workbench.benchmark.sweep import read_axis
from sffr_workbench.benchmark.trainings import TABLE, TRAININGS, TrainingsPlan, run_trainings, train_one
from sffr_workbench.common import Backend

pytest.importorskip("stable_baselines3")

SET = tuple(PPO_SMALL)
GAMMA = "learning.gamma=0.95,0.97"


def table(folder):
    with open(folder / TABLE, newline="") as file:
        return list(csv.DictReader(file))


def test_trainings_are_those_of_the_command_for_one(tmp_path):
    """Bit for bit, with a row for each; a second run does nothing, and more seeds run alone."""
    from sffr_agents.train import train

    options = [word for change in SET for word in ("--set", change)]
    command = ["sweep-train", "ppo", "--over", GAMMA, *options, "-j", "1", "-o", tmp_path / "many"]
    result = sffr(*command, "-n", "1")
    assert result.exit_code == 0, result.stderr
    rows = table(tmp_path / "many")
    assert [(row["learning.gamma"], row["seed"], row["failure"]) for row in rows] == [
        ("0.95", "0", ""),
        ("0.97", "0", ""),
    ]
    scores = train(small("ppo", "learning.gamma=0.97"), 0, tmp_path / "one")
    assert float(rows[1]["cost"]) == pytest.approx(scores["cost"], rel=1e-12)
    own = tmp_path / "many" / rows[1]["folder"]
    assert_same(weights(own), weights(tmp_path / "one"))
    before = {file: file.stat().st_mtime_ns for file in (tmp_path / "many" / TRAININGS).rglob(BEST)}
    assert sffr(*command, "-n", "2").exit_code == 0
    after = {file: file.stat().st_mtime_ns for file in (tmp_path / "many" / TRAININGS).rglob(BEST)}
    assert len(before) == 2 and before.items() <= after.items() and len(after) == len(table(tmp_path / "many")) == 4
    refused = sffr(*command, "-n", "1", "--set", "steps=400")
    assert refused.exit_code == 2 and "holds a training with steps = 200, not 400" in refused.stderr


def test_a_node_that_sees_no_files_sends_what_it_trained(tmp_path):
    """Without checkpoints, which stay where they are of use; a node of other code is refused."""
    config = small("ppo")
    name, files, failure = train_one("ppo-3", config.model_dump(mode="json"), 3, code_hash(), None)
    assert (name, failure) == ("ppo-3", "") and {"best.npz", "progress.csv", "train.json"} <= files.keys()
    assert not any(file.startswith("checkpoints") for file in files)
    with pytest.raises(ConfigError, match="has other code"):
        train_one("ppo-3", config.model_dump(mode="json"), 3, "0" * 16, None)


@pytest.mark.slow
def test_trainings_on_a_cluster_are_those_of_this_machine(tmp_path, monkeypatch):
    """Ray's, which this process starts; what it sent is finished, and goes on to be so."""
    pytest.importorskip("ray")
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")
    plan = TrainingsPlan("ppo", (), range(2), SET)
    here = run_trainings(plan, tmp_path / "here", 2, {})
    there = run_trainings(plan, tmp_path / "there", 2, {}, backend=Backend("ray"))
    assert [each.cost for each in there] == [each.cost for each in here] and len(here) == 2
    for each in plan.trainings:
        paths = [tmp_path / name / TRAININGS / each.name / BEST for name in ("here", "there")]
        assert paths[0].read_bytes() == paths[1].read_bytes()
    before = paths[1].stat().st_mtime_ns
    assert run_trainings(plan, tmp_path / "there", 2, {}, backend=Backend("ray")) == there
    assert paths[1].stat().st_mtime_ns == before


@pytest.mark.parametrize(
    ("over", "seeds", "message"),
    [
        (("learning.gamma=0.9,2",), range(1), "learning.gamma=2: .*learning.gamma"),
        (("learning.gama=0.9",), range(1), "did you mean"),
        (("learning.gamma=0.9", "learning.gamma=0.8"), range(1), "each key once"),
        ((), range(20_000), "must be 1 to"),
        ((), range(899_999, 900_001), "seed = .*training takes"),
    ],
)
def test_what_cannot_be_trained_is_told_before_anything_runs(over, seeds, message):
    with pytest.raises(ConfigError, match=message):
        TrainingsPlan("ppo", tuple(map(read_axis, over)), seeds)
