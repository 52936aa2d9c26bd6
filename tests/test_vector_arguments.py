"""What a batch is asked for: seeds, masks, options and actions, and what it refuses."""

import re

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from stepping import N_ACTIONS

from sffr_gym import ConfigError
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv


def test_integer_seeds_count_up_and_lists_are_taken_as_given():
    """Seed s is s + i for environment i; a list names each; None keeps an environment's own stream."""
    env = SFFRFlexVectorEnv(3, scenario="excited")
    counted, _ = env.reset(seed=40)
    listed, _ = env.reset(seed=[42, 41, 40])
    np.testing.assert_array_equal(listed, counted[::-1])
    np.testing.assert_array_equal(env.reset(seed=np.int64(40))[0], counted)
    for i, obs in enumerate(counted):
        np.testing.assert_array_equal(obs, SFFRFlexEnv("excited").reset(seed=40 + i)[0])
    env.reset(seed=40)
    mixed, _ = env.reset(seed=[None, 41, None])
    np.testing.assert_array_equal(mixed[1], counted[1])
    single = SFFRFlexEnv("excited")
    single.reset(seed=42)
    np.testing.assert_array_equal(mixed[2], single.reset()[0])
    first, second = (SFFRFlexVectorEnv(3, scenario="excited").reset()[0] for _ in range(2))
    assert len({obs.tobytes() for obs in [*first, *second]}) == 6


def test_every_environment_needs_a_reset_before_it_steps():
    """No step before a reset, for none of the environments: a partial first reset leaves the others without a state."""
    env = SFFRFlexVectorEnv(2)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros((2, N_ACTIONS)))
    with pytest.raises((ValueError, gym.error.ResetNeeded)):
        env.reset(seed=0, options={"reset_mask": np.array([True, False])})
        env.step(np.zeros((2, N_ACTIONS)))


def test_a_new_scenario_replaces_what_was_drawn():
    """Info names the draws of the present scenario alone."""
    env = SFFRFlexVectorEnv(2, scenario="excited")
    assert any(key.startswith("drawn_panel0") for key in env.reset(seed=0)[1])
    assert not any(key.startswith("drawn_") for key in env.reset(seed=0, options={"scenario": "nominal"})[1])
    assert env.scenario.name == "nominal"


def test_bad_arguments_raise(user_scenario):
    """Wrong sizes, masks, seeds, modes, actions and options are refused with what is allowed."""
    with pytest.raises(ValueError, match="num_envs must be at least 1 and at most 100000, got 0"):
        SFFRFlexVectorEnv(0)
    with pytest.raises(ValueError, match="render_mode"):
        SFFRFlexVectorEnv(1, render_mode="human")
    with pytest.raises(ValueError, match="is not a valid AutoresetMode"):
        SFFRFlexVectorEnv(1, autoreset_mode="Sometimes")
    with pytest.raises(ConfigError, match="did you mean 'offset'"):
        SFFRFlexVectorEnv(1, scenario="ofset")
    env = SFFRFlexVectorEnv(3, autoreset_mode=AutoresetMode.DISABLED, scenario=user_scenario(duration=0.002))
    for mask in ([True, False, True], np.ones(2, dtype=bool), np.ones(3), np.ones(3, dtype=int)):
        with pytest.raises(ValueError, match="bool array of shape"):
            env.reset(options={"reset_mask": mask})
    with pytest.raises(ValueError, match="at least one"):
        env.reset(options={"reset_mask": np.zeros(3, dtype=bool)})
    with pytest.raises(ValueError, match="3 of them, got 2"):
        env.reset(seed=[1, 2])
    with pytest.raises(ValueError, match="unknown reset option"):
        env.reset(options={"mask": np.ones(3, dtype=bool)})
    env.reset(seed=0)
    for wrong in (np.zeros(N_ACTIONS), np.zeros((2, N_ACTIONS)), np.zeros((3, 14))):
        with pytest.raises(ValueError, match=re.escape(f"(3, 15), got {wrong.shape}")):
            env.step(wrong)
    with pytest.raises(ValueError, match="NaN"):
        env.step(np.full((3, N_ACTIONS), np.nan))
    assert env.step(np.zeros((3, N_ACTIONS)))[3].all()
    with pytest.raises(gym.error.ResetNeeded, match=r"\[0, 1, 2\] are done"):
        env.step(np.zeros((3, N_ACTIONS)))
    env.reset(options={"reset_mask": np.array([True, False, True])})
    with pytest.raises(gym.error.ResetNeeded, match=r"\[1\] are done"):
        env.step(np.zeros((3, N_ACTIONS)))
