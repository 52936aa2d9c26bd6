"""`SFFRFlex-v0`: Gymnasium's contract, reproducibility, and actions."""

import json
import pickle
import re
import subprocess
import sys
import warnings
from importlib.util import find_spec

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stepping import N_ACTIONS, actions, actions_of, assert_healthy, assert_same, rollout

import sffr_gym
from sffr_gym.compile.arguments import Block
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.simulator import Simulator
from sffr_gym.task.reward import REWARDS
from sffr_gym.task.scenario import scenario_names
from sffr_gym.task.signals import SIGNALS

ID = "SFFRFlex-v0"


@pytest.mark.parametrize("scenario", scenario_names())
@pytest.mark.parametrize("made", [True, False])
def test_gymnasium_checker_is_silent(scenario, made):
    """Gymnasium's checker finds nothing and warns of nothing, registered or bare."""
    env = gym.make(ID, scenario=scenario).unwrapped if made else SFFRFlexEnv(scenario)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # It asks for a spec before it tries render modes, a window among them.
        check_env(env, skip_render_check=not made or find_spec("pygame") is None)


@pytest.mark.parametrize("scenario", scenario_names())
@pytest.mark.parametrize("made", [True, False])
def test_stable_baselines3_checker_is_silent(scenario, made):
    """The checker of Stable-Baselines3 finds nothing and warns of nothing, registered or bare."""
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    env = gym.make(ID, scenario=scenario) if made else SFFRFlexEnv(scenario)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(env)


def test_state_is_that_of_the_plant():
    """Tips are those that the observation shows; the modes that the controllers believe in would give others."""
    env = SFFRFlexEnv("mismatch")
    env.reset(seed=3)
    for action in actions(20, size=0.05):
        obs, *_ = env.step(action)
    state = env.state()
    np.testing.assert_allclose(state.qf.ravel(), obs[env.fields["elastic"].slice], rtol=1e-12)
    np.testing.assert_allclose(state.qfd.ravel(), obs[env.fields["elastic_rate"].slice], rtol=1e-12)
    believed = Simulator(env.params).unflatten(state.t, env.positions, env.velocities)
    assert np.abs(believed.qf / state.qf - 1.0).max() > 0.02


def test_prefixed_id_needs_no_import():
    """`gym.make` and `gym.make_vec` import the package by the prefix of the id, in a fresh interpreter."""
    code = (
        "import gymnasium as gym, sys\n"
        "env = gym.make('sffr_gym:SFFRFlex-v0', scenario='offset')\n"
        "vector = gym.make_vec('sffr_gym:SFFRFlex-v0', num_envs=2)\n"
        "print(env.spec.id, env.unwrapped.scenario.name, type(vector).__name__)\n"
        "print('torch' in sys.modules or 'stable_baselines3' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [ID, "offset", "SFFRFlexVectorEnv", "False"]


def test_spec_survives_json():
    """The spec is plain data, and an environment made from its JSON is the same environment."""
    env = gym.make(ID, scenario="excited", overrides=["panel.EI=25"])
    text = env.spec.to_json()
    assert json.loads(text)["kwargs"] == {"scenario": "excited", "overrides": ["panel.EI=25"]}
    again = gym.make(gym.envs.registration.EnvSpec.from_json(text))
    assert again.unwrapped.params == env.unwrapped.params
    assert_same(env.reset(seed=5), again.reset(seed=5))


@pytest.mark.parametrize("scenario", scenario_names())
def test_seeded_rollouts_are_identical(scenario):
    """Two environments with one seed and the same actions return the same bits; numpy's global state is not touched."""
    before = pickle.dumps(np.random.get_state())  # noqa: NPY002 (it must not be used)
    results = []
    for env in (SFFRFlexEnv(scenario), SFFRFlexEnv(scenario)):
        some, more = actions_of(env, 60), actions_of(env, 5)
        results.append([env.reset(seed=11), rollout(env, some), env.reset(), rollout(env, more)])
    assert_same(*results)
    assert pickle.dumps(np.random.get_state()) == before  # noqa: NPY002


def test_pickle_keeps_the_future():
    """An environment pickled in the middle of an episode goes on as the original does, its next episodes included."""
    env = SFFRFlexEnv("excited")
    env.reset(seed=1)
    rollout(env, actions(20))
    other = pickle.loads(pickle.dumps(env))
    assert_same(rollout(env, actions(20, 1)), rollout(other, actions(20, 1)))
    assert_same(env.reset(), other.reset())


@pytest.mark.parametrize("scenario", ["excited", "noise", "impulse", "mismatch"])
def test_state_restores_the_future(scenario):
    """`set_state` brings back what `get_state` returned, in any environment of the robot and as often as asked."""
    env, other = SFFRFlexEnv(scenario), SFFRFlexEnv("nominal")
    env.reset(seed=2)
    rollout(env, actions(15))
    state = env.get_state()
    future = [rollout(env, actions(15, 1)), env.reset(), env.time]
    env.reset(seed=3, options={"scenario": "offset"})
    rollout(env, actions(7, 2))
    for restored in (env, other):
        restored.set_state(state)
        assert_same([rollout(restored, actions(15, 1)), restored.reset(), restored.time], future)
        assert restored.scenario.name == scenario


@pytest.mark.parametrize("scenario", scenario_names())
def test_reset_forgets_a_messy_episode(scenario):
    """A seeded reset after saturated, failed steps equals that of a fresh environment, and so does what follows."""
    env, fresh = SFFRFlexEnv(scenario), SFFRFlexEnv(scenario)
    env.reset(seed=8)
    rollout(env, actions_of(env, 400, size=5.0))
    push = np.full(env.action_space.shape, 5.0)
    assert any(env.step(push)[2] for _ in range(10_000)), "the episode should have failed"
    assert_same(env.reset(seed=9), fresh.reset(seed=9))
    assert_same(rollout(env, actions_of(env, 20)), rollout(fresh, actions_of(fresh, 20)))


def test_reward_is_the_sum_of_its_terms():
    """The reward is the sum of the terms in info, each the docstring's formula of the measures in info."""
    env = SFFRFlexEnv("excited")
    env.reset(seed=4)
    weights = env.params.reward
    for _, reward, _, _, info in rollout(env, actions(30)):
        assert reward == pytest.approx(sum(info[f"reward_{name}"] for name in REWARDS), rel=1e-12)
        sizes = {
            "tracking": (info["object_error"] / weights.tracking.scale) ** 2,
            "vibration": info["vibration"] / weights.vibration.scale,
            "effort": np.sum(info["applied"][:6] ** 2) / weights.effort.scale**2,
        }
        expected = [getattr(weights, name).weight / (1.0 + np.log(1.0 + x)) for name, x in sizes.items()]
        assert [info[f"reward_{name}"] for name in REWARDS] == pytest.approx(expected, rel=1e-12)
    assert min(sizes.values()) > 0.0


@pytest.mark.parametrize("scenario", scenario_names())
def test_info_has_constant_keys_and_types(scenario):
    """Reset and steps, the last one of a failed episode included, return the same keys with the same types."""
    env = SFFRFlexEnv(scenario)
    _, first = env.reset(seed=0)
    keys = {*SIGNALS, *(f"reward_{name}" for name in REWARDS), "time", "clipped", "failure", "cost", "applied"}
    drawn = {f"drawn_{name}" for name in env.episode.drawn}
    assert set(first) == keys | drawn and bool(drawn) == (scenario not in ("nominal",))
    assert {type(value) for value in first.values()} <= {int, float, np.ndarray}
    for *_, info in [*rollout(env, actions_of(env, 300, size=5.0)), (env.reset()[1],)]:
        assert {key: type(value) for key, value in info.items()} == {key: type(value) for key, value in first.items()}


@pytest.mark.parametrize("size", [0.1, 1.2])
def test_cost_counts_saturated_and_failed_periods(size):
    """The cost is 1 in a period in which an actuator is at its limit or that ends in a failure, else 0."""
    env = SFFRFlexEnv("excited")
    assert env.reset(seed=0)[1]["cost"] == 0.0
    costs = set()
    for inputs in actions(400, size=size):
        _, _, terminated, _, info = env.step(inputs)
        saturated = (np.abs(info["applied"]) >= env.plant_task.actuators.limit).any()
        assert info["cost"] == float(saturated or terminated)
        costs.add(info["cost"])
    assert costs == ({0.0} if size < 1.0 else {0.0, 1.0})


NAN = np.where(np.isin(np.arange(N_ACTIONS), [3, 7]), np.nan, 0.0)


@pytest.mark.parametrize("action", [np.zeros(shape) for shape in ((), (14,), (16,), (1, 15), (15, 1))] + [NAN])
def test_bad_actions_raise(action):
    """A wrong shape is refused with both shapes named, NaN with its places, and nothing moves."""
    env = SFFRFlexEnv()
    env.reset(seed=0)
    message = "NaN at [3, 7]" if action is NAN else f"(15,), got {action.shape}"
    with pytest.raises(ValueError, match=re.escape(message)):
        env.step(action)
    assert env.time == 0.0


def test_actions_out_of_range_are_clipped_and_counted():
    """An action beyond the bounds, infinite ones included, acts as the clipped one, and info counts its entries."""
    wild = actions(1)[0]
    wild[[0, 6, 9, 14]] = [3.0, -1.0001, np.inf, -np.inf]
    results = []
    for action in (wild, np.clip(wild, -1.0, 1.0)):
        env = SFFRFlexEnv()
        env.reset(seed=0)
        obs, reward, *_, info = env.step(action)
        results.append([obs, reward, info["applied"]])
        assert info["clipped"] == (4 if action is wild else 0)
        assert env.step(np.zeros(N_ACTIONS))[4]["clipped"] == 0
    assert_same(*results)


def test_float32_actions_are_taken_as_they_are():
    """What the action space samples acts as its exact float64 value."""
    results = []
    for kind in (np.float32, np.float64):
        env = SFFRFlexEnv()
        env.reset(seed=0)
        results.append(rollout(env, actions(5).astype(np.float32).astype(kind)))
    assert_same(*results)


def test_step_before_reset_raises():
    """An environment that was never reset cannot step."""
    for env in (gym.make(ID), SFFRFlexEnv()):
        with pytest.raises(gym.error.ResetNeeded):
            env.step(np.zeros(N_ACTIONS))


def test_unknown_arguments_raise():
    """Reset options, scenarios, render modes, keys and files that do not exist are refused by name."""
    env = SFFRFlexEnv()
    with pytest.raises(ValueError, match=r"unknown reset option \['scenarioo'\]; known: \['scenario'\]"):
        env.reset(options={"scenarioo": "offset"})
    with pytest.raises(sffr_gym.ConfigError, match="did you mean 'excited'"):
        SFFRFlexEnv("excitd")
    with pytest.raises(sffr_gym.ConfigError, match="did you mean 'offset'"):
        env.reset(options={"scenario": "ofset"})
    with pytest.raises(sffr_gym.ConfigError, match="did you mean 'mass'"):
        SFFRFlexEnv(overrides=["panel.mas=3"])
    with pytest.raises(ValueError, match="render_mode must be"):
        SFFRFlexEnv(render_mode="humans")


def test_options_and_overrides_take_effect():
    """`options` change the scenario for good; `overrides` and `params` build another robot."""
    env = SFFRFlexEnv("nominal")
    assert env.reset(seed=0, options={"scenario": "offset"})[1].keys() & {f"drawn_{name}" for name in env.episode.drawn}
    assert env.episode.drawn and env.reset(seed=0)[1]["drawn_offset_m"], "the scenario stays"
    free = SFFRFlexEnv(params=env.params, overrides=["object=null"])
    obs, _ = free.reset(seed=0)
    assert free.params.object is None and free.fields["object_error"].size == 0
    assert obs.size == 52 - 6 - 8 + 4  # without object and grippers; four more joints hold their angles
    assert_healthy(free, [free.step(np.zeros(N_ACTIONS))])


@pytest.mark.parametrize("mounts", ["[]", "[{name: one, root: [0.3, -0.7], angle: 2.1}]"])
def test_any_number_of_panels_runs_the_same_compiled_code(mounts):
    """Robots without a panel or with one need no compilation of their own (a minute), and work."""
    env = SFFRFlexEnv(overrides=[f"panel.mounts={mounts}"])
    assert Block((env.plant_task,)).form == Block((SFFRFlexEnv().plant_task,)).form
    obs, _ = env.reset(seed=0)
    n_p = env.params.n_panels
    assert env.action_space.shape == (9 + 3 * n_p,) and obs.size == 52 - 12 + 6 * n_p
    assert_healthy(env, [env.step(np.zeros(9 + 3 * n_p))])
