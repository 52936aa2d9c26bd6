"""What clients and notebooks find: bare environments, reprs, copies, specs, policies inside the action space."""

import copy
import inspect
import pydoc
import subprocess
import sys
import time

import gymnasium as gym
import numpy as np
import pytest
from both_ids import IDS, SHORT, SINGLES, VECTORS, zeros

import sffr_gym
from sffr_baselines import POLICIES, make_policy
from sffr_baselines.damping_env import SFFRFlexDampingEnv
from sffr_baselines.laws import ORACLES
from sffr_baselines.learned import load_schedule
from sffr_gym.envs.single import SFFRFlexEnv


@pytest.mark.parametrize("env_id", IDS)
def test_what_is_made_is_the_environment_and_its_help_is_ours(env_id):
    """No wrapper stands before it, and it demands a reset itself."""
    env = gym.make(env_id)
    assert env is env.unwrapped
    assert "## Action space" in pydoc.render_doc(env)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(env.action_space.sample())
    limited = gym.make(env_id, max_episode_steps=2)
    limited.reset(seed=0)
    assert [limited.step(limited.action_space.sample())[3] for _ in range(2)] == [False, True]


@pytest.mark.parametrize(
    ("env_id", "arguments", "steps"),
    [
        ("SFFRFlex-v0", {}, 55_440),
        ("SFFRFlex-v0", {"scenario": "fast"}, 78_540),  # 2 pi 15 m at 0.6 m/s
        ("SFFRFlex-v0", {"scenario": SHORT}, 100),
        ("SFFRFlexDamping-v0", {}, 300),
        ("SFFRFlexDamping-v0", {"duration": None}, 1109),
        ("SFFRFlexDamping-v0", {"scenario": SHORT, "duration": None, "agent_period": 0.01}, 20),
    ],
)
def test_the_spec_of_an_environment_tells_its_longest_episode(env_id, arguments, steps):
    """And another scenario of a reset changes it; an episode of the slowest speed is so long."""
    env = gym.make(env_id, **arguments)
    assert env.spec.max_episode_steps == steps
    env.reset(options={"scenario": SHORT})
    if env_id == IDS[0]:
        assert env.spec.max_episode_steps == 100
    if arguments.get("scenario") == SHORT:
        env.reset(seed=0)
        ends = [env.step(zeros(env))[3] for _ in range(steps)]
        assert ends == [False] * (steps - 1) + [True]


@pytest.mark.parametrize("kind", [*SINGLES, *VECTORS])
@pytest.mark.parametrize("scenario", ["excited", "mismatch"])
def test_a_deep_copy_is_cheap_and_goes_on_bit_for_bit(kind, scenario):
    """In milliseconds, before and after a first step; planners copy thousands of times."""
    env = kind(scenario=scenario)
    env.reset(seed=0)
    for _ in range(2):
        begun = time.perf_counter()
        twin = copy.deepcopy(env)
        ahead = twin.step(zeros(env) + 0.3)
        assert time.perf_counter() - begun < 2.0
        now = env.step(zeros(env) + 0.3)
        np.testing.assert_array_equal(ahead[0], now[0])
        assert set(ahead[4]) == set(now[4])


def test_objects_show_themselves():
    """In a line and, in a notebook, as a table; names of scenarios cannot break it."""
    hostile = {"name": "mine", "description": "<script>alert(1)</script>", "duration": 0.2}
    env = SFFRFlexEnv(scenario=hostile)
    assert repr(env) == "SFFRFlexEnv(scenario='mine', time=None, render_mode=None)"
    env.reset(seed=0)
    env.step(zeros(env))
    assert "time=0.002" in repr(env)
    shown = env._repr_html_()
    assert "&lt;script&gt;" in shown and "<script>" not in shown and "Box(15,) float32" in shown
    assert repr(VECTORS[1](3)).startswith("SFFRFlexDampingVectorEnv(scenario='excited', num_envs=3")
    assert "integrator='etdrk4'" in repr(sffr_gym.Simulator()) and "<table>" in sffr_gym.Simulator()._repr_html_()
    policy = make_policy("ahsc", env)
    assert repr(policy) == "LawPolicy(name='ahsc', observations=52, actions=15, tick=0)"
    assert "ahsc" in policy._repr_html_()


def test_the_batch_says_by_its_bases_what_it_is():
    """skrl looks at the classes that are named in the class statement."""
    for kind, base in zip([*SINGLES, *VECTORS], [gym.Env] * 2 + [gym.vector.VectorEnv] * 2, strict=True):
        assert base in kind.__bases__


@pytest.mark.parametrize("name", [name for name in POLICIES if name not in ORACLES.values()])
def test_actions_lie_in_the_action_space_if_asked_for(name):
    """As float32, clipped as the environment clips; one for one observation, rows for rows."""
    env = SFFRFlexEnv(scenario="offset")
    policy, plain = make_policy(name, env, dtype="float32"), make_policy(name, env)
    obs, _ = env.reset(seed=0)
    for each in (policy, plain):
        each.reset(seed=3)
    for _ in range(5):
        action, exact = policy(obs), plain(obs)
        assert action in env.action_space
        np.testing.assert_array_equal(action, np.clip(exact, -1.0, 1.0).astype(np.float32))
        obs = env.step(action)[0]
    policy.reset()
    assert policy(np.stack([obs, obs])).shape == (2, 15)
    again = copy.deepcopy(policy)
    assert again.name == name
    with pytest.raises(ValueError, match="dtype = 'int8'"):
        make_policy(name, env, dtype="int8")


def test_policies_of_the_damping_environment():
    """A learned schedule acts as it predicts, the law inside is action 0, and a law of actuators is refused."""
    env = gym.make("SFFRFlexDamping-v0", scenario="excited")
    obs, _ = env.reset(seed=0)
    np.testing.assert_array_equal(make_policy("sac", env)(obs), load_schedule("sac").predict(obs)[0])
    assert make_policy("sac", env)(obs) in env.action_space and np.abs(make_policy("sac", env)(obs)).max() > 0.1
    np.testing.assert_array_equal(make_policy("ahsc", env)(obs), np.zeros(4))
    assert make_policy("random", env, dtype="float32")(obs) in env.action_space
    batch = gym.make_vec("SFFRFlexDamping-v0", num_envs=3)
    assert make_policy("sac", batch)(batch.reset(seed=0)[0]).shape == (3, 4)
    for wrong in ("hsc", "lqr"):
        with pytest.raises(sffr_gym.ConfigError, match=f"{wrong} commands the actuators of SFFRFlex-v0"):
            make_policy(wrong, env)
    with pytest.raises(sffr_gym.ConfigError, match="unknown policy 'scc'"):
        make_policy("scc", env)
    single = "panel.mounts=[{name: single, root: [-0.3, 0.5], angle: 1.5707963}]"
    with pytest.raises(sffr_gym.ConfigError, match="was made for another environment: law=ahsc, stack_size=1"):
        make_policy("sac", SFFRFlexDampingEnv(overrides=[single]))


def test_the_package_runs_as_a_module():
    """`python -m sffr_gym` is `sffr`."""
    shown = subprocess.run([sys.executable, "-m", "sffr_gym", "--version"], capture_output=True, text=True)
    assert shown.stdout.startswith("sffr-gym 0.") and shown.returncode == 0


def test_arguments_of_all_environments_are_documented():
    """Each argument of a constructor stands in the docstring of its class."""
    for kind in [*SINGLES, *VECTORS]:
        words = inspect.getdoc(kind)
        missing = [name for name in list(inspect.signature(kind).parameters) if name not in words]
        assert not missing, (kind, missing)
