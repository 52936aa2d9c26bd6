"""Scores over training seeds: which policies belong together, and intervals that know both kinds of seeds."""

import numpy as np
import pytest
from typer.testing import CliRunner

from sffr_gym import ConfigError
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.task.metrics import MEASURES
from sffr_gym.task.score import Result
from sffr_gym.task.statistics import stratified_bootstrap
from sffr_workbench.benchmark.seeds import over_seeds, score_seeds
from sffr_workbench.cli.app import app
from sffr_workbench.evaluation import EPISODES_FILE, PLAN_FILE, Identity, episodes_csv


def episode(policy, seed, vibration, failure=""):
    measures = dict.fromkeys(MEASURES, 1.0) | {"vibration": vibration, "failed": float(bool(failure))}
    return Result("excited", policy, seed, measures, failure, {})


@pytest.fixture
def results():
    """Two seeds of an algorithm at 0.4 and 0.6 of AHSC's vibration, on four episodes."""
    rows = []
    for seed in range(4):
        rows += [episode("ahsc", seed, 2.0 + seed), episode("hsc-tuned", seed, 0.9 * (2.0 + seed))]
        rows += [episode(f"ppo-{k}/best", seed, (0.4 + 0.2 * k) * (2.0 + seed)) for k in (0, 1)]
    return rows


def test_seeds_of_an_algorithm_count_together(results):
    scores = score_seeds(results)["excited"]
    assert list(scores) == ["ahsc", "hsc-tuned", "ppo"]
    assert (scores["ppo"].seeds, scores["ppo"].episodes, scores["ppo"].failed) == (2, 4, 0)
    assert scores["ppo"].ratios["vibration"].value == pytest.approx(0.5)
    assert scores["ppo"].ratios["vibration"][1:] == pytest.approx((0.4, 0.6))  # two seeds tell no more
    assert scores["ppo"].cost.value == pytest.approx(0.6 * 0.5 + 0.4)
    assert scores["hsc-tuned"].ratios["vibration"] == pytest.approx((0.9, 0.9, 0.9))
    assert scores["ahsc"].cost == pytest.approx((1.0, 1.0, 1.0))


def test_oracles_are_left_out(results):
    """They run only where the controllers' model is wrong, so they are on other episodes than the rest."""
    scores = score_seeds([*results, episode("ahsc-oracle", 0, 0.1)])
    assert scores == score_seeds(results)


def test_failures_count_ten_times(results):
    results[2] = episode("ppo-0/best", 0, 0.1, "lost")
    score = score_seeds(results)["excited"]["ppo"]
    assert score.failed == 1 and score.ratios["vibration"].high > 1.0


def test_interval_covers_the_training_seeds():
    """Episodes that differ little do not hide that training seeds differ a lot."""
    rng = np.random.default_rng(0)
    seeds = rng.normal(0.5, 0.05, 5)
    table = seeds + 0.001 * rng.normal(size=(100, 5))
    estimate = over_seeds(table)
    assert estimate.low < estimate.value < estimate.high
    assert estimate.high - estimate.low > 0.5 * seeds.std()
    assert over_seeds(table[:, :1]).high - over_seeds(table[:, :1]).low < 0.001


def test_interval_of_one_seed_is_that_of_its_episodes():
    """As wide as the one of the benchmark, but for the draws."""
    table = np.random.default_rng(2).lognormal(size=(300, 1))
    found, known = over_seeds(table), stratified_bootstrap(table)
    assert found.value == pytest.approx(known.value, rel=1e-12)
    assert found.high - found.low == pytest.approx(known.high - known.low, rel=0.08)


def test_seeds_that_agree_share_their_episodes():
    """A second seed that scores the same on every episode adds nothing: the episodes drawn are the same for both."""
    one = np.random.default_rng(1).lognormal(size=(40, 1))
    assert over_seeds(np.tile(one, (1, 8))) == pytest.approx(over_seeds(one), rel=1e-12)


def test_without_ahsc_or_pairs_there_is_no_score(results):
    with pytest.raises(ConfigError, match="relative to 'ahsc'"):
        score_seeds([result for result in results if result.policy != "ahsc"])
    with pytest.raises(ConfigError, match="same episodes"):
        score_seeds(results[:-1])


def test_command_prints_a_table(results, tmp_path):
    plan = Identity(version="1", code="", config_hash="", scenarios={"excited": ""}, policies={})
    with RunFolder.claim(tmp_path / "run", "benchmark") as run:
        run.replace({EPISODES_FILE: episodes_csv(results).encode(), PLAN_FILE: plan.model_dump_json().encode()})
    result = CliRunner().invoke(app, ["seeds", str(tmp_path / "run")])
    assert result.exit_code == 0, result.output
    assert (
        "| excited | `ppo` | 2 x 4 | 0.500 [0.400, 0.600] | 1.00 | 1.00 | 0.700 [0.640, 0.760] | 0 |" in result.output
    )
