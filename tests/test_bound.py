"""The bound for schedules: its prices are the score's, its search improves, and what it finds runs as a policy."""

import numpy as np
import pytest
from typer.testing import CliRunner

from sffr_agents.bound import BoundSettings, ScenarioEpisodes, find_bound
from sffr_agents.config import VALIDATION_SEED
from sffr_baselines import make_policy
from sffr_baselines.learned import load_schedule, save_schedule
from sffr_baselines.rollout import result_of, rollout
from sffr_baselines.schedule import N_FEATURES
from sffr_gym import ConfigError
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.score import WEIGHTS
from sffr_workbench.cli.app import app

pytest.importorskip("cma")


def settings(scenario, **changes):
    return BoundSettings(scenarios=(str(scenario),), **{"episodes": 2, "population": 4, "generations": 3} | changes)


def means(scenario, policy, count):
    """Means of the measures that the score counts, over a policy's episodes."""
    env = SFFRFlexEnv(str(scenario))
    own = make_policy(policy, env)
    results = [result_of(rollout(env, own, VALIDATION_SEED + k)).measures for k in range(count)]
    return np.array([np.mean([each[name] for each in results]) for name in WEIGHTS])


def test_the_law_costs_what_ahsc_does(short_swing):
    """All but the tracking error, which is taken every 0.1 s, is the score's to the last digits."""
    costs = ScenarioEpisodes(short_swing, settings(short_swing)).costs(np.zeros((4, 2, N_FEATURES + 1)))
    np.testing.assert_array_equal(costs, costs[0])
    np.testing.assert_allclose(costs, 1.0, atol=0.1)
    parts = ScenarioEpisodes(short_swing, settings(short_swing))
    parts._usual_error = np.inf
    np.testing.assert_allclose(parts.costs(np.zeros((4, 2, N_FEATURES + 1))), 0.60 + 0.05, rtol=1e-4)


def test_search_improves_and_leaves_a_policy_that_costs_what_it_says(short_swing, tmp_path):
    found = list(find_bound(settings(short_swing)))
    costs = [cost for _, cost in found]
    assert costs == sorted(costs, reverse=True) and costs[-1] < costs[0]
    again = list(find_bound(settings(short_swing)))
    assert [cost for _, cost in again] == costs
    save_schedule(tmp_path / "bound.npz", found[-1][0])
    schedule = load_schedule(tmp_path / "bound.npz")
    assert schedule.trained["algo"] == "cma-es" and schedule.trained["evaluations"] == 12
    vibration, tracking, effort = means(short_swing, tmp_path / "bound.npz", 2) / means(short_swing, "ahsc", 2)
    assert costs[-1] == pytest.approx(0.60 * vibration + 0.35 * tracking + 0.05 * effort, rel=0.05)


def test_a_search_goes_on_from_what_it_has_found(short_swing):
    *_, (found, cost) = find_bound(settings(short_swing))
    ((_, near),) = find_bound(settings(short_swing, generations=1, spread=1e-6), found)
    assert near == pytest.approx(cost, rel=1e-4)
    with pytest.raises(ConfigError, match="begins from a linear schedule of 18 inputs and 2 outputs"):
        next(find_bound(settings(short_swing), load_schedule("ppo")))


def test_a_law_that_pushes_is_searched_likewise(short_swing):
    ((schedule, cost),) = find_bound(settings(short_swing, law="lqr-ff", generations=1))
    assert schedule.action_names == ("left_feedback", "left_reaction", "right_feedback", "right_reaction")
    assert np.isfinite(cost)


def test_command_leaves_the_best_so_far(short_swing, tmp_path):
    file = tmp_path / "bound.npz"
    arguments = ["bound", short_swing, "--law", "hsc", "-n", "1", "--generations", "2", "--out", str(file)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0 and f"{file}: cost " in done.output.replace("\n", "")
    assert load_schedule(file).trained["evaluations"] == 24
    again = CliRunner().invoke(app, arguments)
    assert again.exit_code == 2 and "--overwrite" in again.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nominal", "--law", "ppf"], "law = 'ppf': must be one of"),
        (["nominl"], "did you mean 'nominal'"),
        (["nominal", "--out", "bound.zip"], "ends in .npz"),
        (["nominal", "--rho", "0.5"], "rho = 0.5"),
    ],
)
def test_what_cannot_be_searched_is_named(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["bound", *arguments])
    assert done.exit_code == 2 and message in " ".join(done.output.split())
    assert not list(tmp_path.iterdir())
