"""The memory of a schedule: what it holds, by what its values are scaled, and what is trained with it."""

import numpy as np
import pytest
import torch
from project import ROOT
from small_training import small
from stable_baselines3.common.policies import ActorCriticPolicy

from sffr_agents import energy_scaling
from sffr_agents.algorithms import make_model
from sffr_agents.config import load_config
from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv
from sffr_baselines.schedule import LOG_AMPLITUDE, N_FEATURES
from sffr_gym.task.scenario import load_scenario


@pytest.mark.parametrize("scenario", ["noise", "excited"])
def test_a_memory_holds_what_earlier_actions_saw(scenario):
    """Panel by panel, the newest first, zeros for what was before the start; single, batched, and after a reset."""
    plain, stacked = (SFFRFlexDampingEnv(scenario, duration=1.0, stack_size=size) for size in (1, 3))
    batch = SFFRFlexDampingVectorEnv(3, scenario=scenario, duration=1.0, stack_size=3)
    rng = np.random.default_rng(0)
    for seed in (1, 0):
        seen = [plain.reset(seed=seed)[0].reshape(2, N_FEATURES)]
        obs, rows = stacked.reset(seed=seed)[0], batch.reset(seed=[9, seed, 5])[0]
        for _ in range(5):
            np.testing.assert_array_equal(rows[1], obs)
            newest = [*seen[::-1], *2 * [np.zeros((2, N_FEATURES))]][:3]
            np.testing.assert_array_equal(obs.reshape(2, 3, N_FEATURES), np.stack(newest, axis=1))
            action = rng.uniform(-1.0, 1.0, 4).astype(np.float32)
            seen.append(plain.step(action)[0].reshape(2, N_FEATURES))
            obs, rows = stacked.step(action)[0], batch.step(np.tile(action, (3, 1)))[0]
    names = stacked.obs_names
    assert names[: N_FEATURES + 1] == (*plain.obs_names[:N_FEATURES], "left_mode1_displacement_1")
    assert names[3 * N_FEATURES] == "right_mode1_displacement" and len(names) == len(set(names)) == 6 * N_FEATURES


@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_energy_is_that_of_the_newest_observation(algo):
    """With a memory: older observations tell other energies, by which nothing is divided."""
    model, env = make_model(small(algo, "environment.stack_size=3"), seed=0)
    obs = np.zeros((4, 3, N_FEATURES), np.float32)
    obs[:, :, LOG_AMPLITUDE] = [1.0, -1.0, 0.5]
    obs, actions, unit = obs.reshape(4, -1), np.zeros((4, 2), np.float32), 100.0 + energy_scaling.FLOOR
    assert env.observation_space.shape == (3 * N_FEATURES,)
    if algo == "ppo":
        seen = torch.as_tensor(obs)
        critic = ActorCriticPolicy.predict_values(model.policy, seen)
        for values in (model.policy.predict_values(seen), model.policy(seen)[1]):
            torch.testing.assert_close(values, critic * unit)
        for _ in range(8):
            model.rollout_buffer.add(obs, actions, np.full(4, -50.0), np.zeros(4), torch.zeros(4), torch.zeros(4))
        model.rollout_buffer.compute_returns_and_advantage(torch.zeros(4), np.zeros(4))
        learned = model.rollout_buffer.returns[-1]
    else:
        model.replay_buffer.add(obs, 0.0 * obs, actions, np.full(4, -50.0), np.zeros(4), [{}] * 4)
        samples = model.replay_buffer.sample(8)
        learned = samples.rewards
        np.testing.assert_allclose(samples.discounts, 0.98 * (1.0 + energy_scaling.FLOOR) / unit, rtol=1e-5)
    np.testing.assert_allclose(learned, -50.0 / unit, rtol=1e-5)


def test_robust_agents_are_trained_as_the_page_says():
    """Another configuration would be another training under the same name; ranges are those of docs/agents.md."""
    assert load_config("robust").hash() == "57b6d73c8ec0083e"
    plant = load_scenario("practice/varied").plant
    text = (ROOT / "docs" / "agents.md").read_text(encoding="utf-8")
    shown = f"EI by {plant.EI[0]} to {plant.EI[1]}, mass by {plant.panel_mass[0]} to {plant.panel_mass[1]}, piezos by"
    assert f"{shown} {plant.piezo[0]} to {plant.piezo[1]}" in " ".join(text.split())
    config = load_config("robust").environment
    assert config.stack_size * config.agent_period == 10.0 and config.law == "lqr-ff"
