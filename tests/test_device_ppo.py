"""The PPO that trains on a GPU: one update on the processor, which learns what it should."""

import gymnasium as gym
import numpy as np
import pytest
import torch

import sffr_gym  # noqa: F401
from sffr_agents.device_ppo import Learner, Settings
from sffr_baselines import make_policy
from sffr_baselines.schedule import N_FEATURES
from sffr_gym.config.params import load_params


@pytest.fixture(scope="module")
def envs():
    return gym.make_vec("SFFRFlexDamping-v0", num_envs=4, scenario="excited", duration=0.3)


def test_one_update_changes_actor_and_critic(envs):
    learner = Learner(envs, Settings(steps=8, epochs=2, minibatches=2))
    before = [each.detach().clone() for each in learner.agent.parameters()]
    shown = learner.update()
    assert all(np.isfinite(value) for value in shown.values())
    assert shown["reward"] > 0.0
    assert all(not torch.equal(old, new) for old, new in zip(before, learner.agent.parameters(), strict=True))


def test_steps_that_only_reset_are_not_learned_from(envs):
    """Episodes have three actions, and the step after them resets: a quarter of eight steps."""
    learner = Learner(envs, Settings(steps=8))
    rollout, _ = learner._collect()
    assert rollout.counts.reshape(8, 4, 2)[:, :, 0].tolist() == [
        [1.0] * 4 if k not in (3, 7) else [0.0] * 4 for k in range(8)
    ]
    assert (rollout.advantage[3] == 0.0).all()


def test_advantages_are_those_of_the_definition(envs):
    """Of the last action before an end that is no failure: reward and discounted value of what follows, less value."""
    settings = Settings(steps=3)
    learner = Learner(envs, settings)
    rollout, _ = learner._collect()
    assert learner._done.all(), "truncated"
    with torch.no_grad():
        after = learner.agent.value(learner._obs)
    last_reward = rollout.advantage[2] + rollout.value[2] - settings.discount * after
    assert (last_reward > 0.0).all()
    one, two = last_reward.reshape(-1, 2).T
    torch.testing.assert_close(one, two, msg="panels share the reward")


def test_it_learns_to_act_as_rewarded():
    """A stand-in for environments whose reward is the first action: its mean rises."""
    envs = _Bandit()
    learner = Learner(envs, Settings(steps=16, rate=3.0e-3))
    first = learner.update()["reward"]
    for _ in range(15):
        last = learner.update()["reward"]
    assert last > first + 0.3


class _Bandit:
    """Rewards large actions; nothing ever ends."""

    num_envs = 64
    single_action_space = gym.spaces.Box(-1.0, 1.0, (4,), np.float32)

    def reset(self, seed=None):
        return np.ones((self.num_envs, 2 * N_FEATURES), np.float32), {}

    def step(self, actions):
        never = np.zeros(self.num_envs, dtype=np.bool_)
        return (
            np.ones((self.num_envs, 2 * N_FEATURES), np.float32),
            actions.mean(axis=1).astype(np.float64),
            never,
            never,
            {},
        )


def test_what_is_learned_is_a_policy(envs, tmp_path):
    learner = Learner(envs, Settings(steps=2))
    learner.save(tmp_path / "mine.npz")
    assert make_policy(tmp_path / "mine.npz", load_params()).name.endswith("mine")
