"""The batch as a `VecEnv`: infos of its own for each row; options and attributes that arrive or are refused."""

import numpy as np
import pytest
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

from sffr_agents.sb3_vec_env import DampingVecEnv, make_sb3_vec_env
from sffr_baselines.damping_env import SFFRFlexDampingEnv
from sffr_gym.task.status import Failure

PER_PANEL = pytest.mark.parametrize("per_panel", [False, True])


def zeros(env):
    return np.zeros((env.num_envs, *env.action_space.shape), np.float32)


@PER_PANEL
def test_infos_are_those_of_single_environments_and_each_rows_own(per_panel):
    """All that an environment tells, of a finished one what its last step told; nothing is shared between rows."""
    env, seeds = make_sb3_vec_env(2, per_panel, duration=0.3), [4, 5]
    singles = [SFFRFlexDampingEnv(duration=0.3) for _ in seeds]
    env.seed(4)
    env.reset()
    expected = [single.reset(seed=seed)[1] for single, seed in zip(singles, seeds, strict=True)]
    rows = env.num_envs // 2
    for k in range(4):
        infos = env.step(zeros(env))[3] if k else list(env.reset_infos)
        for i, info in enumerate(infos):
            single = expected[i // rows]
            assert set(single) <= set(info)
            for key, value in single.items():
                np.testing.assert_array_equal(info[key], value, err_msg=key)
                assert type(info[key]) is type(value)
        for i, info in enumerate(infos):
            info["mine"], info["applied"][:] = i, i
        assert [info["mine"] for info in infos] == list(range(len(infos)))
        assert [info["applied"][0] for info in infos] == list(range(len(infos)))
        if k < 3:
            expected = [single.step(np.zeros(4))[4] for single in singles]
    assert all(info["TimeLimit.truncated"] and "terminal_observation" in info for info in infos)
    assert env.reset_infos[0]["time"] == 0.0
    assert "mine" not in env.step(zeros(env))[3][1]


@PER_PANEL
def test_monitors_record_failures_and_costs(per_panel, tmp_path):
    """The number tells whether, with texts the file why."""
    arguments = {"duration": 2.0, "overrides": ["limits.tip=0.03"], "rho": 1.0, "texts": True}
    keywords = ("failure", "failure_text", "cost")
    env = VecMonitor(make_sb3_vec_env(2, per_panel, **arguments), str(tmp_path / "log"), info_keywords=keywords)
    env.reset()
    finished = [info["episode"] for _ in range(21) for info in env.step(zeros(env))[3] if "episode" in info]
    env.close()
    assert any(episode["failure"] == Failure.TIP_RANGE for episode in finished)
    assert "panel tip beyond the model's range" in (tmp_path / "log.monitor.csv").read_text()


@PER_PANEL
def test_options_reach_the_next_reset(per_panel):
    """The scenario of all rows, once; what cannot be is refused when it is set."""
    env = VecNormalize(make_sb3_vec_env(2, per_panel))
    n = env.num_envs
    env.set_options({"scenario": "nominal"})
    env.reset()
    assert env.get_attr("scenario")[0].name == "nominal"
    env.set_options([{"scenario": "offset"}] * n)
    env.set_options()
    env.reset()
    assert env.get_attr("scenario", 1)[0].name == "nominal", "options were taken back"
    for options in ([{"scenario": "nominal"}] + [{}] * (n - 1), [{}] * (n + 1), {"seed": 3}, {"reset_mask": None}):
        with pytest.raises(ValueError, match=r"options must be the same|unknown reset option"):
            env.set_options(options)


@PER_PANEL
def test_attributes_and_methods_are_those_of_each_rows_environment(per_panel):
    """Or an AttributeError tells what to do instead."""
    env = VecMonitor(make_sb3_vec_env(2, per_panel, scenario="mismatch"))
    env.seed(3)
    env.reset()
    rows = env.num_envs // 2
    assert env.get_attr("np_random_seed") == [3] * rows + [4] * rows and env.has_attr("params")
    assert not env.has_attr("nothing") and env.get_attr("render_mode") == [None] * env.num_envs
    states = env.env_method("state", indices=[0, env.num_envs - 1])
    assert len(states) == 2 and (states[0].qf != states[1].qf).any()
    with pytest.raises(AttributeError, match="of their own"):
        env.env_method("reset")
    with pytest.raises(NotImplementedError):
        env.set_attr("params", None)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_rows_have_the_type_of_the_environments(dtype):
    """In space and observations."""
    env = make_sb3_vec_env(2, True, dtype=dtype)
    assert env.observation_space.dtype == env.reset().dtype == np.dtype(dtype)


@pytest.mark.parametrize("actions", [np.zeros((2, 4)) + 1j, np.zeros((2, 3)), np.full((2, 4), np.nan), [["0"] * 4] * 2])
def test_actions_are_checked_as_they_are_given(actions):
    """Before anything is converted."""
    env = make_sb3_vec_env(2)
    env.reset()
    with pytest.raises(ValueError, match="action"):
        env.step(actions)


def test_a_batch_of_one_environment_takes_seeds_and_options():
    """Its only row is the environment; rows are environments unless they are asked to be panels."""
    env, single = make_sb3_vec_env(1), SFFRFlexDampingEnv()
    assert env.num_envs == 1 and DampingVecEnv(env.env).num_envs == 1
    assert env.observation_space == single.observation_space and env.action_space == single.action_space
    env.seed(6)
    env.set_options({"scenario": "nominal"})
    expected = single.reset(seed=6, options={"scenario": "nominal"})[0]
    np.testing.assert_array_equal(env.reset()[0], expected)
    assert env.get_attr("scenario")[0].name == "nominal"
    assert not np.array_equal(env.reset()[0], expected)  # a seed is of one reset


@PER_PANEL
def test_no_rows_are_wrapped_and_all_rows_of_an_environment_are_it(per_panel):
    env = make_sb3_vec_env(3, per_panel)
    assert env.env_is_wrapped(VecMonitor) == [False] * env.num_envs and env.env_is_wrapped(VecMonitor, [1]) == [False]
    rows = env.num_envs // 3
    assert env.seed(10) == [10] * rows + [11] * rows + [12] * rows
    env.reset()
    assert env.get_attr("np_random_seed", [0, env.num_envs - 1]) == [10, 12]


@PER_PANEL
def test_options_that_say_nothing_are_the_same(per_panel):
    """None and an empty dict, in any row."""
    env = make_sb3_vec_env(2, per_panel)
    env.set_options([None, {}] * (env.num_envs // 2))
    env.set_options(({},) * env.num_envs)
    env.reset()
    assert env.get_attr("scenario")[0].name == SFFRFlexDampingEnv().scenario.name


@PER_PANEL
def test_rows_tell_the_end_of_an_episode_from_its_time_limit(per_panel):
    """Neither a step on the way nor a failure is one, for which a learner would count on what comes after."""
    failing = make_sb3_vec_env(2, per_panel, duration=2.0, overrides=["limits.tip=0.03"])
    failing.seed(0)
    failing.reset()
    told = [
        (info["TimeLimit.truncated"], done)
        for _ in range(12)
        for done, info in zip(*failing.step(zeros(failing))[2:], strict=True)
    ]
    assert any(done for _, done in told) and not any(truncated for truncated, _ in told)
