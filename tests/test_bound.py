"""The bound for schedules: its prices are the score's, its search improves, and what it finds runs as a policy."""

import numpy as np
import pytest
from project import ROOT
from typer.testing import CliRunner

from sffr_agents.bound import BoundSettings, ScenarioEpisodes, _batch, find_bound, run_episodes
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
MODES = [{"mode": 1, "amplitude": [0.05, 0.25]}]


def settings(scenario, **changes):
    return BoundSettings(
        scenarios=(str(scenario),), **{"episodes": 2, "population": 4, "generations": 3, "spread": 0.5} | changes
    )


def means(scenario, policy, count):
    """Means of the measures that the score counts, over a policy's episodes."""
    env = SFFRFlexEnv(str(scenario))
    own = make_policy(policy, env)
    results = [result_of(rollout(env, own, VALIDATION_SEED + k)).measures for k in range(count)]
    return np.array([np.mean([each[name] for each in results]) for name in WEIGHTS])


def test_ahsc_costs_1_and_its_measures_are_the_scores(swinging):
    """Energy and error are taken every 0.1 s, effort is all of it."""
    episodes, law = ScenarioEpisodes(swinging, settings(swinging)), [np.zeros((4, 2, N_FEATURES + 1))]
    np.testing.assert_allclose(episodes.costs(law), 1.0, rtol=1e-12)
    vibration, error, effort = means(swinging, "ahsc", 2)
    assert episodes._usual[2] == pytest.approx(effort, rel=1e-9)
    np.testing.assert_allclose(episodes._usual[:2], [vibration, error], rtol=0.2)


def test_episodes_of_any_length_count_alike_and_what_comes_after_them_does_not(user_scenario):
    """A circle of 2 m is flown once around at 0.3 to 0.6 m/s: 42 s to 21 s."""
    file = user_scenario("lengths", speed=[0.3, 0.6], robot=["path.radius=2.0"])
    episodes = ScenarioEpisodes(file, settings(file))
    first, second = (run_episodes(_batch(file, 1, law="ahsc"), [seed], [np.zeros((1, 2, N_FEATURES + 1))])[0]
                     for seed in (VALIDATION_SEED, VALIDATION_SEED + 1))  # fmt: skip
    np.testing.assert_allclose(episodes._usual, ((first + second) / 2.0).ravel(), rtol=1e-12)
    env = SFFRFlexEnv(file)
    lengths = [env.reset(seed=VALIDATION_SEED + k) and env.ticks for k in (0, 1)]
    assert lengths[0] != lengths[1]


def test_an_episode_that_fails_costs_ten_times_ahscs(short_swing, user_scenario):
    """Here by panels whose model ends at a centimetre; where AHSC fails too there is nothing to be relative to."""
    lost = user_scenario("lost", duration=0.4, robot=["limits.tip=0.01"], panel_modes=MODES)
    episodes = ScenarioEpisodes(short_swing, settings(short_swing))
    episodes.batch = _batch(lost, 8, law="ahsc")
    np.testing.assert_allclose(episodes.costs([np.zeros((4, 2, N_FEATURES + 1))]), 10.0, rtol=1e-12)
    with pytest.raises(ConfigError, match=r"lost.*AHSC fails there"):
        ScenarioEpisodes(lost, settings(lost))


def test_scenarios_of_other_robots_are_not_searched_together(short_swing, user_scenario):
    one = user_scenario("one", duration=0.4, robot=["panel.mounts=[{name: only, root: [0.5, 0], angle: 0}]"],
                        panel_modes=MODES)  # fmt: skip
    together = BoundSettings(scenarios=(short_swing, one), episodes=1, population=4, generations=1)
    with pytest.raises(ConfigError, match=r"one.*has the actions only_q5, only_q6, where .*short"):
        next(find_bound(together))


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
    with pytest.raises(ConfigError, match="begins from a schedule with layers of 18, 2"):
        next(find_bound(settings(short_swing), load_schedule("ppo")))


def test_effort_has_the_price_that_is_asked_for(short_swing):
    """What it costs at thrice the score's price, less the cost at none, is three twentieths of the effort's ratio."""
    layers = [np.random.default_rng(0).normal(size=(4, 2, N_FEATURES + 1))]
    dear, free = (ScenarioEpisodes(short_swing, settings(short_swing, effort_price=price)) for price in (3.0, 0.0))
    measures, _ = run_episodes(dear.batch, dear._seeds * 4, layers)
    effort = (measures[2] / dear._usual[2]).mean(axis=1)
    np.testing.assert_allclose(dear.costs(layers) - free.costs(layers), 0.15 * effort, rtol=1e-9)


def test_the_first_candidates_spread_is_the_documents():
    text = (ROOT / "docs" / "agents.md").read_text(encoding="utf-8")
    assert f"with the {BoundSettings().spread} of now" in text


def test_features_that_are_left_out_stay_at_the_start(short_swing):
    ((found, _),) = find_bound(settings(short_swing, generations=1, features=("base_error", "log_amplitude")))
    (matrix,), (bias,) = found.network.matrices, found.network.biases
    assert np.flatnonzero(matrix.any(axis=0)).tolist() == [4, 17] and bias.any()
    ((further, _),) = find_bound(settings(short_swing, generations=1, features=()), found)
    np.testing.assert_array_equal(further.network.matrices[0], matrix)
    assert (further.network.biases[0] != bias).all()


def test_a_search_with_a_memory_sees_earlier_observations(short_swing):
    """Its first candidates spread over all of them; features that are left out, are left out of each."""
    wide = settings(short_swing, stack_size=3, generations=1, features=("mode1_rate",))
    ((schedule, cost),) = find_bound(wide)
    (matrix,) = schedule.network.matrices
    assert np.flatnonzero(matrix.any(axis=0)).tolist() == [1, 1 + N_FEATURES, 1 + 2 * N_FEATURES]
    assert schedule.stack_size == 3 and np.isfinite(cost)
    with pytest.raises(ConfigError, match="begins from a schedule with layers of 54, 2"):
        next(find_bound(wide, load_schedule("ppo")))


def test_rectified_units_are_searched_and_run_as_the_policy_does(short_swing, tmp_path):
    """A search goes on from them; what a candidate costs in the search is what its policy costs."""
    own = settings(short_swing, hidden=3, features=("mode1_rate", "base_error"))
    *_, (found, cost) = find_bound(own)
    network = found.network
    assert network.sizes == (N_FEATURES, 3, 2) and network.relu and network.squash
    assert np.flatnonzero(network.matrices[0].any(axis=0)).tolist() == [1, 17]
    ((_, near),) = find_bound(settings(short_swing, hidden=3, generations=1, spread=1e-6), found)
    assert near == pytest.approx(cost, rel=1e-4)
    save_schedule(tmp_path / "units.npz", found)
    vibration, tracking, effort = means(short_swing, tmp_path / "units.npz", 2) / means(short_swing, "ahsc", 2)
    assert cost == pytest.approx(0.60 * vibration + 0.35 * tracking + 0.05 * effort, rel=0.05)
    with pytest.raises(ConfigError, match=r"begins from a schedule with layers of 18, 2, .*got 18, 3, 2"):
        next(find_bound(settings(short_swing), found))


def test_a_law_that_pushes_is_searched_likewise(short_swing):
    ((schedule, cost),) = find_bound(settings(short_swing, law="lqr-ff", generations=1))
    assert schedule.action_names == ("left_feedback", "left_reaction", "right_feedback", "right_reaction")
    assert np.isfinite(cost)


def test_command_leaves_the_best_so_far(short_swing, tmp_path):
    file = tmp_path / "bound.npz"
    arguments = ["bound", short_swing, "--law", "hsc", "-n", "1", "--generations", "2", "--base-tolerance", "0.003",
                 "--out", str(file)]  # fmt: skip
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0 and f"{file}: cost " in done.output.replace("\n", "")
    found = load_schedule(file)
    assert (found.trained["evaluations"], found.base_tolerance) == (24, 0.003)
    again = CliRunner().invoke(app, arguments)
    assert again.exit_code == 2 and "--overwrite" in again.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nominal", "--law", "ppf"], "law = 'ppf': must be one of"),
        (["nominl"], "did you mean 'nominal'"),
        (["nominal", "--out", "bound.zip"], "ends in .npz"),
        (["nominal", "--rho", "0.5"], "rho = 0.5"),
        (["nominal", "--base-tolerance", "0"], "base_tolerance = 0.0"),
        (["nominal", "--feature", "base_eror"], "did you mean 'base_error'"),
    ],
)
def test_what_cannot_be_searched_is_named(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["bound", *arguments])
    assert done.exit_code == 2 and message in " ".join(done.output.split())
    assert not list(tmp_path.iterdir())
