"""Scenarios that change the robot: for plant and controllers alike, or the plant alone."""

import pickle
from functools import partial

import numpy as np
import pytest
from command_line import sffr
from stepping import actions_of, assert_same, rollout

from sffr_agents.config import VALIDATION_SEED, Validation
from sffr_agents.validation import Validator
from sffr_baselines import make_policy
from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv
from sffr_baselines.rollout import result_of
from sffr_baselines.rollout import rollout as rollout_of
from sffr_gym.config.params import load_params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.task.scenario import load_scenario
from sffr_workbench.evaluation import evaluate
from sffr_workbench.figures.animation import MovieOptions, animate

TWO = {"settings": ["panel.elements=2", "panel.foreshortening=true"]}


def test_robot_is_known_to_all():
    """Parameters, actions and plant are those of the assignments, beside what came with the call."""
    env = SFFRFlexEnv("patches", overrides=["actuators.piezo.array=patches", "panel.EI=25"])
    env.reset(seed=0)
    assert env.params.actuators.piezo.array == env.plant.actuators.piezo.array == "patches"
    assert env.params.panel.EI == env.plant.panel.EI == 25.0
    assert env.action_space.shape == (2 * 8 + 9,)
    assert env.plant_task is env.prior_task


def test_settings_of_the_plant_are_unknown_to_controllers():
    """The controllers go on with one linear element; observation and action are those of their robot."""
    env, plain = SFFRFlexEnv("truth"), SFFRFlexEnv()
    env.reset(seed=0)
    assert (env.params.panel.elements, env.params.panel.foreshortening) == (1, False)
    assert (env.plant.panel.elements, env.plant.panel.foreshortening) == (8, True)
    assert env.plant_task.model.omega2.shape[1] == 6 > env.prior_task.model.omega2.shape[1]
    assert env.observation_space == plain.observation_space and env.action_space == plain.action_space
    assert len(env.positions) > len(env.prior_task.model.shapes)
    assert env.state().qf.shape == (2, 24)


@pytest.mark.parametrize("scenario", ["truth", "sprint", "weak", "thrust"])
def test_states_and_copies_go_on_alike(scenario):
    """What is restored, pickled or one of a batch has the plant's modes."""
    env, twin = SFFRFlexEnv(scenario), SFFRFlexEnv(scenario)
    env.reset(seed=4)
    rollout(env, actions_of(env, 10))
    twin.reset(seed=0)
    twin.set_state(env.get_state())
    copied = pickle.loads(pickle.dumps(env))
    future = rollout(env, actions_of(env, 20, seed=1))
    assert_same(rollout(twin, actions_of(env, 20, seed=1)), future)
    assert_same(rollout(copied, actions_of(env, 20, seed=1)), future)
    batch, again = (SFFRFlexVectorEnv(3, scenario=scenario) for _ in range(2))
    batch.reset(seed=4)
    again.reset(seed=0)
    again.set_state(batch.get_state())
    for each in actions_of(batch, 5):
        assert_same(again.step(each), batch.step(each))


def test_factors_of_actuators_are_of_the_plant():
    """Force for a volt, and limits of the thrusters; an action asks for a part of what is believed."""
    env = SFFRFlexEnv({"name": "x", "description": "", "plant": {"piezo": [0.5, 0.5], "thruster": [0.25, 0.25]}})
    env.reset(seed=0)
    plant, prior = env.plant_task, env.prior_task
    np.testing.assert_allclose(plant.actuators.gain, 0.5 * prior.actuators.gain)
    np.testing.assert_array_equal(plant.scale, prior.scale)
    at = slice(plant.actuators.at.thrust, plant.actuators.at.joints)
    np.testing.assert_allclose(plant.actuators.limit[at], 0.25 * prior.actuators.limit[at])
    assert env.episode.drawn == {"piezo_factor": 0.5, "thruster_factor": 0.25}
    *_, info = env.step(np.ones(15))
    np.testing.assert_allclose(info["applied"][at], [25.0, 25.0, 25.0])


def test_another_robot_needs_another_environment():
    """A reset changes between scenarios of one robot and plant, and refuses others, which leaves all as it was."""
    for env in SFFRFlexEnv("truth"), SFFRFlexVectorEnv(2, scenario="truth"):
        env.reset(seed=0)
        with pytest.raises(ConfigError, match="scenario excited: has another robot or plant than 'truth'"):
            env.reset(options={"scenario": "excited"})
        env.reset(options={"scenario": load_scenario("truth").with_changes(name="calm", panel_modes=())})
        assert env.scenario.name == "calm"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"robot": ["panel.EI=-1"]}, r"scenario mine: robot: override 'panel\.EI=-1': panel\.EI = -1"),
        ({"robot": ["panel.eI=1"]}, r"scenario mine: robot: .*did you mean 'EI'"),
        ({"plant": {"settings": ["panel.mass=0"]}}, r"scenario mine: plant\.settings: .*panel\.mass = 0"),
        ({"plant": {"settings": ["actuators.piezo.array=patches"]}}, r"plant\.settings: the plant must have the act"),
        ({"plant": {"settings": ["control.period=0.001"]}}, r"plant\.settings: the plant must have the actuators"),
        ({"plant": {"settings": ["object=null"]}}, r"plant\.settings: the plant must have the actuators, the obs"),
        ({"robot": [3]}, r"robot\.0 = 3: must be a text"),
    ],
)
def test_assignments_that_are_not_valid(changes, message):
    for make in SFFRFlexEnv, lambda scenario: SFFRFlexVectorEnv(2, scenario=scenario):
        with pytest.raises(ConfigError, match=message):
            make({"name": "mine", "description": "", **changes})


@pytest.mark.parametrize("name", ["truth", "weak", "patches", "thrust", "sprint"])
def test_laws_and_learned_policies_run_with_another_robot(user_scenario, name):
    """For two tenths of a second, with oracles where the plant is another one."""
    keys = load_scenario(name).model_dump(mode="json", exclude={"name", "description"})
    evaluation = evaluate(["ahsc", "lqr-kf", "sac"], user_scenario(name, **keys | {"duration": 0.2}), episodes=1)
    assert all(not result.failure for results in evaluation.results.values() for result in results)
    assert ("ahsc-oracle" in evaluation.results) == (name != "patches")


CONFLICT = "actuators.piezo.force=1"


@pytest.mark.parametrize("make", [SFFRFlexEnv, partial(SFFRFlexVectorEnv, 2), SFFRFlexDampingEnv])
def test_an_override_that_the_scenario_would_undo_is_refused(make):
    """Nobody's assignment is dropped in silence; one that agrees, or is of something else, is taken."""
    with pytest.raises(ConfigError, match=r"override 'actuators\.piezo\.force=1': scenario weak sets it otherwise"):
        make(scenario="weak", overrides=["panel.EI=25", CONFLICT])
    agreeing = make(scenario="weak", overrides=["actuators.piezo.force=0.04", "actuators.piezo.voltage=100"])
    assert agreeing.params.actuators.piezo.voltage == 100.0


@pytest.mark.parametrize("command", ["evaluate", "benchmark", "animate", "tune-law"])
def test_commands_refuse_it_too(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    policies = ["lqr"] if command == "tune-law" else ["ahsc"]
    result = sffr(command, *policies, "--scenario", "weak", "--set", CONFLICT, "--out", tmp_path / "out.gif")
    assert result.exit_code == 2 and "scenario weak sets it otherwise" in " ".join(result.output.split())


def test_every_policy_believes_in_the_scenarios_robot(user_scenario, tmp_path):
    """Whoever makes it: the environment's own policy, evaluation, animation and a training's comparison agree."""
    keys = load_scenario("weak").model_dump(mode="json", exclude={"name", "description"})
    file = user_scenario("feeble", **keys | {"duration": 0.6})
    env = SFFRFlexEnv(file)
    seed = 7
    expected = rollout_of(env, make_policy("ahsc", env), seed)
    assert np.abs(expected.applied[:, :6]).max() > 10.0  # volts, not the hundredths that strong piezos would need
    (shown,) = animate(["ahsc"], tmp_path / "a.gif", file, seed, options=MovieOptions(size=200, speed=1.0, fps=5))
    np.testing.assert_array_equal(shown.applied, expected.applied)
    evaluated = evaluate(["ahsc"], file, episodes=1, seed=seed).first["ahsc"]
    np.testing.assert_array_equal(evaluated.applied, expected.applied)
    validator = Validator(Validation(scenarios=(file,), episodes=1), load_params())
    own = result_of(rollout_of(env, make_policy("ahsc", env), VALIDATION_SEED)).measures
    assert validator._reference["feeble"][0].measures == own


@pytest.mark.parametrize("scenario", ["noise", "truth", {"name": "stiff", "description": "", "plant": {
    "settings": ["panel.foreshortening=true", "panel.elements=3"], "EI": [0.8, 1.2]}}])  # fmt: skip
def test_laws_with_every_option_run_in_lanes_as_alone(scenario):
    """Feed-forward, integral, delay and filter, on plants that keep their length and may differ, bit for bit."""
    levels = dict.fromkeys(("position", "angle", "velocity", "rate", "acceleration", "angular_acceleration"), 0.01)
    observer = str(levels).replace("'", "")
    changes = ["control.Ki=600", "control.feedforward=true", "control.delay_compensation=true"]
    changes.append(f"control.observer={observer}")
    batch = SFFRFlexDampingVectorEnv(11, scenario=scenario, overrides=changes, duration=2.0)
    first, _ = batch.reset(seed=40)
    actions = actions_of(batch, 4)
    together = [first] + [batch.step(each)[0] for each in actions]
    lates = set()
    for i in range(11):
        env = SFFRFlexDampingEnv(scenario, overrides=changes, duration=2.0)
        alone = [env.reset(seed=40 + i)[0]] + [env.step(each[i])[0] for each in actions]
        np.testing.assert_array_equal(alone, [each[i] for each in together])
        for name, array in env._damping.law._asdict().items():
            np.testing.assert_array_equal(getattr(batch._damping.law, name)[i], array[0])
        lates.add(float(env._damping.law.late[0, 0]))
        assert env._damping.law.integral.any()
    assert lates == ({0.0, 1.0} if scenario == "noise" else {0.0})
