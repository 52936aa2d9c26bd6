"""Policies of plain Stable-Baselines3, 36 observations and 4 actions, exported without a configuration and scored."""

import numpy as np
import pytest
import torch
from command_line import sffr
from sb3_contrib import TQC, TRPO, CrossQ, RecurrentPPO
from stable_baselines3 import A2C, DDPG, PPO, SAC, TD3

from sffr_agents.sb3_actor import read_actor
from sffr_baselines.damping_env import SFFRFlexDampingEnv
from sffr_baselines.learned import load_schedule
from sffr_gym import ConfigError
from sffr_workbench.evaluation import evaluate

RELU = {"activation_fn": torch.nn.ReLU, "net_arch": {"pi": [32, 16], "vf": [8]}}
SMALL = {"net_arch": [24]}


def saved(kind, folder, **settings):
    """A zip of a model that has not learned but acts visibly, and the model."""
    off_policy = {"buffer_size": 10} if kind in (SAC, TD3, DDPG, TQC, CrossQ) else {}
    name = "MlpLstmPolicy" if kind is RecurrentPPO else "MlpPolicy"
    model = kind(name, "sffr_gym:SFFRFlexDamping-v0", device="cpu", seed=0, **off_policy, **settings)
    heads = [name for name in model.policy.state_dict() if name.startswith(("action_net", "actor.mu."))]
    with torch.no_grad():
        for name, parameter in model.policy.named_parameters():
            if name == max(head for head in heads if head.endswith("weight")):
                parameter *= 40.0
    model.save(folder / "model.zip")
    return folder / "model.zip", model


@pytest.mark.parametrize(
    ("kind", "settings"),
    [(PPO, {}), (PPO, {"policy_kwargs": RELU}), (A2C, {}), (TRPO, {}), (SAC, {}), (TD3, {}), (DDPG, {}), (TQC, {}),
     (SAC, {"policy_kwargs": SMALL | {"activation_fn": torch.nn.Tanh}})],
)  # fmt: skip
def test_an_exported_policy_acts_as_its_model(kind, settings, tmp_path):
    """On any observation, to float32's precision; also where its mean lies beyond the bounds."""
    file, model = saved(kind, tmp_path, **settings)
    result = sffr("export", file, "--out", tmp_path / "plain.npz")
    assert result.exit_code == 0, result.stderr
    schedule = load_schedule(tmp_path / "plain.npz")
    observations = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 36)).astype(np.float32)
    for scale in (1.0, 30.0):
        expected = model.predict(scale * observations, deterministic=True)[0]
        np.testing.assert_allclose(schedule.predict(scale * observations)[0], expected, atol=1e-4)
    assert np.abs(expected).max() > 0.5 and schedule.network.sizes[0] == 36


def test_an_exported_policy_is_scored_as_it_acts(tmp_path):
    """`sffr evaluate` runs it in the compiled loop: the same vibration as step by step in its environment."""
    file, model = saved(PPO, tmp_path, policy_kwargs=RELU)
    sffr("export", file, "--out", tmp_path / "plain.npz", "--set", "law=hsc", "--set", "rho=4")
    scenario = tmp_path / "short.yaml"
    scenario.write_text(
        "name: short\ndescription: a test's\nduration: 2.0\npanel_modes: [{mode: 1, amplitude: [0.1, 0.2]}]"
    )
    scored = evaluate([str(tmp_path / "plain.npz"), "hsc"], scenario, episodes=1, seed=1_000_000)
    env = SFFRFlexDampingEnv(scenario=scenario, law="hsc", rho=4.0, duration=None, random_phase=False)
    obs, info = env.reset(seed=1_000_000)
    done = False
    while not done:
        obs, _, _, done, info = env.step(model.predict(obs, deterministic=True)[0])
    first = next(iter(scored.first.values()))
    assert first.signals[-1, list(info).index("vibration")] == pytest.approx(info["vibration"], rel=1e-5)
    (own,), (law,) = scored.results.values()
    assert own.measures["vibration"] != pytest.approx(law.measures["vibration"], rel=1e-4)


@pytest.mark.parametrize(
    ("kind", "settings", "message"),
    [
        (CrossQ, {}, "normalises layers .*--algo"),
        (PPO, {"policy_kwargs": {"activation_fn": torch.nn.ELU}}, "has the units ELU, not one of Tanh, ReLU"),
        (RecurrentPPO, {}, "lstm"),
    ],
)
def test_a_network_without_counterpart_is_refused(kind, settings, message, tmp_path):
    """In a line that says what it has."""
    file, _ = saved(kind, tmp_path, **settings)
    with pytest.raises(ConfigError, match=message):
        read_actor(file)


def test_a_policy_of_another_environment_is_refused(tmp_path):
    """With both sizes; and arguments of the environment are checked."""
    PPO("MlpPolicy", "Pendulum-v1", device="cpu").save(tmp_path / "model.zip")
    result = sffr("export", tmp_path / "model.zip", "--out", tmp_path / "a.npz")
    assert result.exit_code == 2 and "3 inputs and 1 outputs does not fit 36 observations" in result.stderr
    file, _ = saved(PPO, tmp_path)
    for change, message in (
        ("rho=0", "rho"),
        ("lwa=hsc", "did you mean 'law'"),
        ("overrides=[panel.EJ=3]", "panel.EJ"),
    ):
        result = sffr("export", file, "--out", tmp_path / "a.npz", "--set", change)
        assert result.exit_code == 2 and message in result.stderr, result.stderr
    result = sffr("export", file, "--out", tmp_path / "a.npz", "--algo", "ppo", "--set", "rho=2")
    assert result.exit_code == 2 and "--set is for zips without --algo" in result.stderr
