"""Trainings: the same seed gives the same weights, a killed one goes on as if nothing had happened, policies export."""

import json
import subprocess
import sys

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO
from typer.testing import CliRunner

from agents.cli import app
from agents.learned import load_schedule, save_schedule
from agents.learning import energy_scaling
from agents.learning.algorithms import make_model
from agents.learning.config import CONFIGS, load_config
from agents.learning.export import export_run, export_zip, network_of, schedule_of
from agents.learning.folder import BEST, CHECKPOINTS, LAST, PROGRESS
from agents.learning.train import resume, train
from agents.residual_env import SFFRFlexDampingEnv
from baselines import make_policy
from baselines.rollout import rollout
from sffr_gym import ConfigError
from sffr_gym.env import SFFRFlexEnv

SMALL = [
    "n_envs=2", "environment.duration=1.0", "network.hidden=[8, 8]", "validation.scenarios=[nominal]",
    "validation.duration=0.2", "validation.every=150", "checkpoints.every=64",
]  # fmt: skip
PPO_SMALL = [*SMALL, "steps=200", "learning.n_steps=8", "learning.batch_size=16", "learning.n_epochs=2"]
REPLAY_SMALL = [
    *SMALL, "steps=160", "learning.learning_starts=40", "learning.batch_size=16", "learning.buffer_size=500",
]  # fmt: skip
CONTRIB = {"tqc", "crossq"}


def small(algo):
    if algo in CONTRIB:
        pytest.importorskip("sb3_contrib")
    return load_config(algo, PPO_SMALL if algo == "ppo" else REPLAY_SMALL)


def weights(folder):
    last = sorted((folder / CHECKPOINTS).glob("[0-9]*"))[-1]
    return torch.load(last / "weights.pt", weights_only=True)["parameters"]["policy"]


def assert_same(first, second):
    assert first.keys() == second.keys()
    for name, tensor in first.items():
        assert torch.equal(tensor, second[name]), name


class Killed(Exception):
    pass


def kill_at(steps):
    def report(done, total, scores):
        if done >= steps:
            raise Killed

    return report


@pytest.mark.parametrize("algo", CONFIGS)
def test_killed_training_goes_on_as_if_nothing_had_happened(algo, tmp_path):
    """Which is also that the same seed gives the same weights."""
    config = small(algo)
    train(config, 3, tmp_path / "whole")
    with pytest.raises(Killed):
        train(config, 3, tmp_path / "killed", kill_at(110))
    resume(tmp_path / "killed")
    assert_same(weights(tmp_path / "whole"), weights(tmp_path / "killed"))
    tables = [(tmp_path / name / PROGRESS).read_text().splitlines() for name in ("whole", "killed")]
    steps = [[line.split(",")[0] for line in table] for table in tables]
    assert steps[0] == steps[1]


def test_killed_before_the_first_checkpoint_begins_anew(tmp_path):
    config = small("ppo")
    with pytest.raises(Killed):
        train(config, 3, tmp_path / "killed", kill_at(10))
    resume(tmp_path / "killed")
    train(config, 3, tmp_path / "whole")
    assert_same(weights(tmp_path / "whole"), weights(tmp_path / "killed"))


def test_other_seed_gives_other_weights(tmp_path):
    config = small("ppo")
    for seed in (1, 2):
        train(config, seed, tmp_path / str(seed))
    first, second = (weights(tmp_path / str(seed)) for seed in (1, 2))
    assert any(not torch.equal(first[name], second[name]) for name in first)


@pytest.mark.parametrize("algo", CONFIGS)
@pytest.mark.parametrize("per_panel", [True, False])
def test_export_decides_as_torch_does(algo, per_panel, tmp_path):
    changes = [*(PPO_SMALL if algo == "ppo" else REPLAY_SMALL), f"network.per_panel={str(per_panel).lower()}"]
    small(algo)
    config = load_config(algo, changes)
    model, env = make_model(config, seed=0)
    model.learn(config.steps)
    file = tmp_path / "policy.npz"
    save_schedule(file, schedule_of(model, env.unwrapped.env, {"seed": 0}))
    schedule = load_schedule(file)
    rng = np.random.default_rng(0)
    obs = rng.uniform(-1.0, 1.0, (50, 14)).astype(np.float32)
    expected, _ = model.predict(obs.reshape(-1, *model.observation_space.shape), deterministic=True)
    np.testing.assert_allclose(schedule.predict(obs)[0], expected.reshape(50, 4), atol=1e-6)


def test_compiled_loop_acts_as_the_policy_in_the_environment(tmp_path):
    model, env = make_model(load_config("ppo", PPO_SMALL), seed=0)
    with torch.no_grad():
        model.policy.action_net.weight *= 100.0  # else it hardly acts
    schedule = schedule_of(model, env.unwrapped.env, {})
    bare, damping = SFFRFlexEnv(scenario="excited"), SFFRFlexDampingEnv(duration=1.0, random_phase=False)
    bare.scenario = damping._distribution()
    policy = schedule.policy(bare.params)
    compiled = rollout(bare, policy, seed=4)
    obs, _ = damping.reset(seed=4)
    for k in range(10):
        actions, _ = schedule.predict(obs)
        assert np.abs(actions).max() > 0.1
        obs, *_, info = damping.step(actions)
        assert info["vibration"] == pytest.approx(compiled.signals[50 * k + 49, 2], rel=1e-5)
    seen, _ = bare.reset(seed=4)
    policy.reset()
    for k in range(120):  # through the interface, step by step
        seen, *_, info = bare.step(policy(seen))
        assert info["vibration"] == pytest.approx(compiled.signals[k, 2], rel=1e-12)


def test_policies_run_without_torch(tmp_path):
    model, env = make_model(load_config("ppo", PPO_SMALL), seed=0)
    file = tmp_path / "policy.npz"
    save_schedule(file, schedule_of(model, env.unwrapped.env, {}))
    code = f"""
import pathlib, sys
sys.modules["torch"] = sys.modules["stable_baselines3"] = None
from typer.testing import CliRunner
from agents.cli import app
from agents.learned import load_schedule
load_schedule({str(file)!r}).predict([0.0] * 14)
scenario = {str(tmp_path / "short.yaml")!r}
pathlib.Path(scenario).write_text("name: short\\ndescription: short\\nduration: 0.5\\n")
out = {str(tmp_path / "run")!r}
result = CliRunner().invoke(app, ["evaluate", {str(file)!r}, "ahsc", "-s", scenario, "--no-figures", "-o", out])
sys.exit(result.exit_code)
"""
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)
    assert set(json.loads((tmp_path / "run" / "summary.json").read_text())["policies"]) == {"policy", "ahsc"}


def test_run_folder_and_zip_export_the_same_policy(tmp_path):
    config = small("ppo")
    train(config, 0, tmp_path / "run")
    export_run(tmp_path / "run", tmp_path / "run.npz")
    assert {BEST, LAST, PROGRESS} <= {path.name for path in (tmp_path / "run").iterdir()}
    model, _ = make_model(config, seed=1)
    model.save(tmp_path / "model.zip")
    for trust in (False, True):
        export_zip(tmp_path / "model.zip", config, tmp_path / "zip.npz", trust)
        obs = np.linspace(-1.0, 1.0, 14)
        np.testing.assert_allclose(
            load_schedule(tmp_path / "zip.npz").predict(obs)[0],
            np.clip(network_of(model)(obs.reshape(2, 7)).ravel(), -1.0, 1.0),
            atol=1e-6,
        )


class Bomb:
    def __reduce__(self):
        return (exec, ("raise SystemExit('code of a file was run')",))


def test_a_zips_code_is_not_run(tmp_path):
    config = small("ppo")
    model, _ = make_model(config, seed=1)
    model.bomb = Bomb()
    model.save(tmp_path / "model.zip")
    export_zip(tmp_path / "model.zip", config, tmp_path / "zip.npz")
    with pytest.raises(SystemExit, match="code of a file"):
        PPO.load(tmp_path / "model.zip")


@pytest.mark.parametrize("seed", [-1, 900_000, 1_000_000])
def test_seeds_of_evaluation_are_refused(seed, tmp_path):
    with pytest.raises(ConfigError, match="evaluation alone"):
        train(small("ppo"), seed, tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--algo", "ppoo"], "did you mean 'ppo'?"),
        (["--set", "learning.gama=0.9"], "did you mean 'gamma'?"),
        (["--set", "learning.tau=0.9"], "unknown key"),
        (["--n-envs", "0"], "must be at least 1"),
        (["--resume"], "--out"),
        (["--resume", "--out", "nothing"], "holds no training"),
    ],
)
def test_faults_of_the_user_are_named(arguments, message):
    result = CliRunner().invoke(app, ["train", *arguments])
    assert result.exit_code == 2
    assert message in result.output


def test_every_shipped_configuration_is_valid():
    for algo in CONFIGS:
        assert load_config(algo).algo == algo


def test_advantages_count_alike_at_any_amplitude():
    """A buffer whose rewards and values are a hundred times larger at ten times the amplitude gives the same."""
    _, env = make_model(load_config("ppo", PPO_SMALL), seed=0)
    results = []
    for size in (1.0, 10.0):
        buffer = energy_scaling.EnergyRolloutBuffer(4, env.observation_space, env.action_space, n_envs=1, gamma=0.9)
        rng = np.random.default_rng(0)
        for _ in range(4):
            obs = rng.uniform(-1.0, 1.0, (1, 7))
            obs[:, 4] = 1.0 + np.log10(size)
            value = torch.tensor(rng.normal(size=1) * size**2)
            buffer.add(obs, np.zeros((1, 2)), rng.normal(size=1) * size**2, np.zeros(1), value, torch.zeros(1))
        buffer.compute_returns_and_advantage(torch.tensor([size**2]), np.zeros(1))
        results.append(buffer.advantages)
    np.testing.assert_allclose(results[0], results[1], rtol=1e-3)
    assert make_policy("ahsc", env.unwrapped.env.params).law.schedule.hold == 0
