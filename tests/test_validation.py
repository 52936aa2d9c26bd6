"""Validation during training: what a schedule costs beside AHSC on all episodes, and that the best model is kept."""

import numpy as np
import pytest
from small_training import small

from sffr_agents import train as module
from sffr_agents.config import VALIDATION_SEED, Validation
from sffr_agents.folder import BEST, LAST
from sffr_agents.validation import Validator, hash_of_suite, suite
from sffr_baselines import make_policy
from sffr_baselines.damping_env import SFFRFlexDampingEnv
from sffr_baselines.learned import LearnedSchedule, Network, load_schedule
from sffr_baselines.rollout import rollout
from sffr_baselines.schedule import N_FEATURES
from sffr_gym import load_params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.scenario import load_scenario, suite_hash
from sffr_gym.task.signals import ERROR, PIEZO, VIBRATION

SETTINGS = Validation(scenarios=("excited", "nominal"), episodes=3, duration=0.2)
PARAMS = load_params()


@pytest.fixture(scope="module")
def schedule():
    """A schedule that always damps as strongly as it may."""
    network = Network((np.zeros((2, N_FEATURES)),), (np.ones(2),), relu=False, squash=False)
    return LearnedSchedule.of(network, SFFRFlexDampingEnv(), {})


@pytest.fixture(scope="module")
def validator():
    return Validator(SETTINGS, PARAMS)


@pytest.fixture(scope="module")
def measured(schedule):
    """Vibration, tracking error and effort (episodes, 3) of AHSC and of the schedule, by scenario."""
    found = {}
    for scenario, count in (("excited", 3), ("nominal", 1)):  # the second draws nothing
        env = SFFRFlexEnv(load_scenario(scenario).model_copy(update={"duration": 0.2}))
        policies = make_policy("ahsc", PARAMS), schedule.policy(PARAMS)
        found[scenario] = [
            np.array([measures(rollout(env, policy, VALIDATION_SEED + k)) for k in range(count)]) for policy in policies
        ]
    return found


def measures(trajectory):
    signals = trajectory.signals
    return signals[:, VIBRATION].mean(), np.sqrt((signals[:, ERROR] ** 2).mean()), signals[:, PIEZO].mean()


def test_scores_are_those_of_all_episodes_and_scenarios(validator, schedule, measured):
    expected = {}
    for scenario, (ahsc, own) in measured.items():
        ratios = own.mean(axis=0) / ahsc.mean(axis=0)
        expected[f"{scenario}/vibration"], expected[f"{scenario}/tracking"] = ratios[:2]
        expected[f"{scenario}/cost"] = ratios @ [0.60, 0.35, 0.05]
    expected["cost"] = 0.5 * (expected["excited/cost"] + expected["nominal/cost"])
    assert validator(schedule) == pytest.approx(expected, rel=1e-9)
    assert all(abs(expected[name] - 1.0) > 1e-3 for name in ("excited/cost", "nominal/cost"))  # AHSC costs 1
    assert expected["excited/cost"] != pytest.approx(expected["nominal/cost"], rel=1e-3)


def test_each_episode_has_a_seed_of_its_own(validator, schedule, measured):
    """Costs by episode; the scenario that draws nothing repeats its only one."""
    columns = [(own / ahsc) @ [0.60, 0.35, 0.05] for ahsc, own in measured.values()]
    costs = validator.episode_costs(schedule)
    np.testing.assert_allclose(costs, np.column_stack([columns[0], np.tile(columns[1], 3)]), rtol=1e-9)
    assert len(set(costs[:, 0])) == 3


def test_a_scenario_that_draws_nothing_runs_once(schedule):
    settings = Validation(scenarios=("nominal",), episodes=3, duration=0.2)
    assert Validator(settings, PARAMS).episode_costs(schedule).shape == (1, 1)


def test_suite_is_what_the_settings_say():
    assert [(scenario.name, scenario.duration) for scenario in suite(SETTINGS)] == [("excited", 0.2), ("nominal", 0.2)]
    whole = suite(Validation(scenarios=("nominal",)))
    assert whole == [load_scenario("nominal")]
    assert hash_of_suite(SETTINGS, PARAMS) == suite_hash(suite(SETTINGS), PARAMS)


def test_best_policy_is_that_of_the_lowest_cost(tmp_path, monkeypatch):
    """Neither the first nor the last: whatever the comparisons said, in their order."""
    compared = []

    class Scores:
        def __init__(self, settings, params):
            self.costs = iter([0.9, 0.5, 0.7, 0.6, 0.8])

        def __call__(self, schedule):
            compared.append((next(self.costs), schedule.trained["steps"]))
            return {"cost": compared[-1][0]}

    monkeypatch.setattr(module, "Validator", Scores)
    scores = module.train(small("ppo", "validation.every=64", "steps=250"), 0, tmp_path)
    assert len(compared) > 2 and scores == {"cost": 0.5}
    assert load_schedule(tmp_path / BEST).trained["steps"] == compared[1][1]
    assert load_schedule(tmp_path / LAST).trained["steps"] == compared[-1][1] > compared[1][1]
