"""Trainings: the same seed gives the same weights, and a killed one resumes with the same ones."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from small_training import PPO_SMALL, assert_same, small, weights
from stable_baselines3.common.policies import ActorCriticPolicy
from typer.testing import CliRunner

from sffr_agents import energy_scaling
from sffr_agents.algorithms import make_model
from sffr_agents.checkpoint import Notes, load_checkpoint, save_checkpoint
from sffr_agents.config import CONFIGS, load_config
from sffr_agents.export import network_of
from sffr_agents.folder import BEST, CHECKPOINTS, LAST, PROGRESS, SECONDS
from sffr_agents.log import Board, CsvLog
from sffr_agents.progress import read_progress
from sffr_agents.train import resume, train
from sffr_agents.validation import hash_of_suite
from sffr_baselines.learned import load_schedule
from sffr_baselines.schedule import N_FEATURES
from sffr_gym import ConfigError, load_params
from sffr_workbench.cli.app import app

ROOT = Path(__file__).parents[1]


class Killed(Exception):
    pass


def kill_at(steps):
    def report(done, total, scores):
        if done >= steps:
            raise Killed

    return report


def progress(folder):
    """The log of a training but for the time that it took."""
    rows = read_progress(folder / PROGRESS)
    return [{name: value for name, value in row.items() if name != SECONDS} for row in rows]


@pytest.mark.parametrize("algo", CONFIGS)
def test_killed_training_resumes_with_the_same_weights(algo, tmp_path):
    """Which is also that the same seed gives the same weights."""
    config = small(algo)
    train(config, 3, tmp_path / "whole")
    with pytest.raises(Killed):
        train(config, 3, tmp_path / "killed", kill_at(110))
    resume(tmp_path / "killed")
    assert_same(weights(tmp_path / "whole"), weights(tmp_path / "killed"))
    assert progress(tmp_path / "whole") == progress(tmp_path / "killed")
    for name in (BEST, LAST):
        assert (tmp_path / "whole" / name).read_bytes() == (tmp_path / "killed" / name).read_bytes()


def test_training_killed_at_any_moment_resumes(tmp_path):
    """A process that is killed without warning leaves a folder from which --resume ends with the same weights."""
    rate = [f"learning.{name}=1.0e-3" for name in ("learning_rate", "final_learning_rate")]  # whatever the steps
    settings = [*PPO_SMALL, *rate, "steps=100000", "checkpoints.every=16"]
    changes = [part for setting in settings for part in ("--set", setting)]
    command = [
        sys.executable,
        "-m",
        "sffr_workbench.cli.app",
        "train",
        "--seed",
        "3",
        *changes,
        "-o",
        str(tmp_path / "killed"),
    ]
    running = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.DEVNULL)
    while len(list((tmp_path / "killed" / CHECKPOINTS).glob("00*"))) < 2:
        assert running.poll() is None
        time.sleep(0.05)
    time.sleep(0.3)
    os.kill(running.pid, signal.SIGKILL)
    running.wait()
    kept = tmp_path / "killed" / "train.json"
    begun = json.loads(kept.read_text())
    last = sorted((tmp_path / "killed" / CHECKPOINTS).glob("00*"))[-1]
    steps = json.loads((last / "state.json").read_text())["notes"]["items"]["saved"] + 100
    begun["config"]["steps"] = steps  # not the whole way
    kept.write_text(json.dumps(begun))
    resume(tmp_path / "killed")
    train(load_config("ppo", [*settings, f"steps={steps}"]), 3, tmp_path / "whole")
    assert_same(weights(tmp_path / "whole"), weights(tmp_path / "killed"))


def test_killed_before_the_first_checkpoint_starts_again(tmp_path):
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
    assert any(not np.array_equal(first[name], second[name]) for name in first)


def test_best_policy_is_the_one_that_cost_least(tmp_path, monkeypatch):
    """Not the last one, even if that costs as little; its scores are returned, and its weights kept."""
    costs = [3.0, 1.0, 1.0]

    class Scripted:
        def __init__(self, settings, params):
            self._left = iter(costs)

        def __call__(self, schedule):
            return {"cost": next(self._left)}

    monkeypatch.setattr("sffr_agents.train.Validator", Scripted)
    config = small("ppo", "steps=96", "validation.every=32")
    assert train(config, 0, tmp_path) == {"cost": 1.0}
    best, last = (load_schedule(tmp_path / name) for name in (BEST, LAST))
    assert (best.trained["steps"], last.trained["steps"]) == (64, 96)
    assert not np.array_equal(best.network.flat(), last.network.flat())


def test_checkpoints_are_written_as_often_as_they_should_be(tmp_path):
    """Once at least so many steps were done since the last one, and at the end; each tells the time so far."""
    begun = time.perf_counter()
    train(small("ppo", "steps=192", "checkpoints.every=64", "checkpoints.keep=9", "n_envs=1"), 0, tmp_path)
    took = time.perf_counter() - begun
    states = [json.loads((each / "state.json").read_text()) for each in sorted((tmp_path / CHECKPOINTS).iterdir())]
    notes = [state["notes"]["items"] for state in states]
    assert [each["saved"] for each in notes] == [64, 128, 192]
    assert 0.0 < notes[0]["elapsed"] < notes[1]["elapsed"] < notes[2]["elapsed"] < took


def test_exploration_is_drawn_for_each_action():
    model, env = make_model(small("td3"), seed=0)
    noise = model.action_noise()
    assert noise.shape[-1] == env.action_space.shape[0] == len(np.unique(noise[..., :2]))


@pytest.mark.parametrize(
    ("seed", "message"), [(-1, "must be at least 0"), (900_000, "evaluation alone"), (1_000_000, "evaluation alone")]
)
def test_seeds_of_evaluation_are_rejected(seed, message, tmp_path):
    with pytest.raises(ConfigError, match=message):
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
        (["--resume", "--out", "nothing"], "holds no run of sffr train"),
    ],
)
def test_errors_of_the_user_are_named(arguments, message):
    result = CliRunner().invoke(app, ["train", *arguments])
    assert result.exit_code == 2
    assert message in result.output


@pytest.mark.parametrize(
    ("algo", "defaults", "shipped"),
    [
        ("ppo", "41e36de33bcb05a1", "fd842af2c0db67ec"), ("sac", "bb16ff5f65344e34", "3e818edb4397cf4a"),
        ("td3", "85106cb5df54c11b", "488448451c1832c1"), ("tqc", "c0259f4480587960", "2ff557b28ae02dab"),
        ("crossq", "34e70fdfa9309779", "4e310f5e8f7bd864"),
    ],
)  # fmt: skip
def test_configurations_are_valid_and_what_trainings_were_named_by(algo, defaults, shipped):
    """A changed default would give another training under the same file."""
    assert (CONFIGS[algo](algo=algo).hash(), load_config(algo).hash()) == (defaults, shipped)
    assert load_config(algo).algo == algo


def test_advantages_count_alike_at_any_amplitude():
    """A buffer whose rewards and values are a hundred times larger at ten times the amplitude gives the same."""
    _, env = make_model(load_config("ppo", PPO_SMALL), seed=0)
    results = []
    for size in (1.0, 10.0):
        buffer = energy_scaling.EnergyRolloutBuffer(4, env.observation_space, env.action_space, n_envs=1, gamma=0.9)
        rng = np.random.default_rng(0)
        for _ in range(4):
            obs = rng.uniform(-1.0, 1.0, (1, N_FEATURES))
            obs[:, 4] = 1.0 + np.log10(size)
            value = torch.tensor(rng.normal(size=1) * size**2)
            buffer.add(obs, np.zeros((1, 2)), rng.normal(size=1) * size**2, np.zeros(1), value, torch.zeros(1))
        buffer.compute_returns_and_advantage(torch.tensor([size**2]), np.zeros(1))
        results.append((buffer.advantages, buffer.returns, buffer.values))
    np.testing.assert_allclose(results[0], results[1], rtol=1e-3)


@pytest.mark.parametrize("scaled", [True, False])
@pytest.mark.parametrize("algo", CONFIGS)
def test_energy_scaling_is_what_the_configuration_says(algo, scaled):
    """At an energy of 100 a reward of -50 is learned as -0.5, or as it is; PPO's critic gives values in its unit."""
    model, _ = make_model(small(algo, f"learning.energy_scaling={str(scaled).lower()}"), seed=0)
    assert torch.get_num_threads() == 1  # sums depend on it
    obs, actions = np.zeros((4, N_FEATURES), np.float32), np.zeros((4, 2), np.float32)
    obs[:, 4] = 1.0
    if algo == "ppo":
        for _ in range(8):
            model.rollout_buffer.add(obs, actions, np.full(4, -50.0), np.zeros(4), torch.zeros(4), torch.zeros(4))
        model.rollout_buffer.compute_returns_and_advantage(torch.zeros(4), np.zeros(4))
        learned = model.rollout_buffer.returns[-1]
        seen = torch.as_tensor(obs)
        critic, energy = ActorCriticPolicy.predict_values(model.policy, seen), 100.0 + energy_scaling.FLOOR
        for values in (model.policy.predict_values(seen), model.policy(seen)[1]):
            torch.testing.assert_close(values, critic * energy if scaled else critic)
    else:
        model.replay_buffer.add(obs, obs, actions, np.full(4, -50.0), np.zeros(4), [{}] * 4)
        learned = model.replay_buffer.sample(8).rewards
    np.testing.assert_allclose(learned, -50.0 / (100.0 + energy_scaling.FLOOR) if scaled else -50.0, rtol=1e-5)


def test_replay_counts_alike_at_any_amplitude():
    """Rewards per energy, and discounts that follow the energy: q = r / E + gamma E' / E q'."""
    _, env = make_model(small("sac"), seed=0)
    obs, after = np.zeros((1, N_FEATURES), np.float32), np.zeros((1, N_FEATURES), np.float32)
    obs[:, 4], after[:, 4] = 1.0, 0.5  # log10 of the root of the energy: 100, and then 10
    buffer = energy_scaling.EnergyReplayBuffer(
        1, env.observation_space, env.action_space, device="cpu", n_envs=1, gamma=0.9
    )
    buffer.add(obs, after, np.zeros((1, 2)), np.array([-50.0]), np.zeros(1), [{}])
    samples = buffer.sample(3)
    floor = energy_scaling.FLOOR
    np.testing.assert_allclose(samples.rewards, -50.0 / (100.0 + floor), rtol=1e-5)
    np.testing.assert_allclose(samples.discounts, 0.9 * (10.0 + floor) / (100.0 + floor), rtol=1e-5)


def test_a_new_table_does_not_read_what_was_there(tmp_path):
    (tmp_path / PROGRESS).write_text("damaged")
    log = CsvLog(tmp_path / PROGRESS)
    log.write({"score/cost": 0.5}, {"score/cost": ()}, 10)
    assert [row["score/cost"] for row in read_progress(tmp_path / PROGRESS)] == ["0.5"]


def test_table_goes_on_after_a_kill_in_the_middle_of_a_row(tmp_path):
    file = tmp_path / PROGRESS
    table = CsvLog(file)
    for step in (8, 16, 24):
        table.write({"loss": 0.5 * step}, {}, step)
    file.write_text(file.read_text() + "1")  # the beginning of 128
    table = CsvLog(file, steps=16)
    table.write({"loss": 1.0, "score": 2.0}, {}, 24)
    table.write({"loss": 3.0, "score": 4.0}, {}, 32)
    assert file.read_text().splitlines() == ["steps,loss,score", "8,4.0,", "16,8.0,", "24,1.0,2.0", "32,3.0,4.0"]
    table.write({"loss": 5.0, "rate": 6.0}, {}, 40)  # another column after rows were added
    assert file.read_text().splitlines()[0] == "steps,loss,score,rate"
    assert file.read_text().splitlines()[-2:] == ["32,3.0,4.0,", "40,5.0,,6.0"]


def test_table_of_a_training_that_was_killed_after_its_first_step_goes_on(tmp_path):
    file = tmp_path / PROGRESS
    CsvLog(file).write({"loss": 1.0}, {}, 1)
    table = CsvLog(file, steps=1)
    table.write({"loss": 2.0}, {}, 2)
    assert file.read_text().splitlines() == ["steps,loss", "1,1.0", "2,2.0"]


def test_table_of_tensorboard_is_written_and_forgets_what_came_later(tmp_path):
    pytest.importorskip("tensorboard")
    for steps, values in (0, {8: 1.0, 16: 2.0, 24: 3.0}), (16, {24: 4.0}):
        board = Board(tmp_path, steps)
        for step, value in values.items():
            board.write({"loss": value}, {"loss": ()}, step)
        board.close()
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    accumulator = EventAccumulator(str(tmp_path)).Reload()
    assert [(event.step, event.value) for event in accumulator.Scalars("loss")] == [(8, 1.0), (16, 2.0), (24, 4.0)]


def test_checkpoint_is_whole_or_not_there(tmp_path, monkeypatch):
    """A process that dies while it writes one leaves the one before, even of the same step."""
    model, env = make_model(small("ppo"), seed=0)
    save_checkpoint(tmp_path, model, env, Notes(saved=1), keep=1)
    with monkeypatch.context() as patch, pytest.raises(OSError):
        patch.setattr("sffr_agents.checkpoint.os.fsync", die)
        save_checkpoint(tmp_path, model, env, Notes(saved=2), keep=1)
    assert load_checkpoint(tmp_path, model, env) == Notes(saved=1)
    save_checkpoint(tmp_path, model, env, Notes(saved=3), keep=1)
    assert load_checkpoint(tmp_path, model, env) == Notes(saved=3)
    assert len(list(tmp_path.iterdir())) == 1


def die(*_):
    raise OSError


@pytest.mark.parametrize("arguments", [["train"], ["export", "run"], ["tune", "ppo"]])
def test_what_is_not_installed_is_named(arguments, monkeypatch):
    monkeypatch.setattr("sffr_workbench.common.extras.find_spec", lambda name: None if name == "torch" else name)
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2 and "not installed: torch; pip install 'sffr-gym[agents" in result.output


@pytest.mark.parametrize("algo", CONFIGS)
def test_an_actor_can_be_linear_beside_deep_critics(algo):
    """One matrix and a tanh, exported as such, with critics of two hidden layers."""
    model, _ = make_model(small(algo, "network.actor=[]", "network.hidden=[8, 8]"), seed=0)
    network = network_of(model)
    assert [matrix.shape for matrix in network.matrices] == [(2, N_FEATURES)] and network.squash
    critic = model.policy.mlp_extractor.value_net if algo == "ppo" else model.critic
    assert sum(isinstance(each, torch.nn.Linear) for each in critic.modules()) % 2 == 0
    obs = np.random.default_rng(0).uniform(-1.0, 1.0, (5, N_FEATURES)).astype(np.float32)
    np.testing.assert_allclose(network(obs), model.predict(obs, deterministic=True)[0], atol=1e-5)


@pytest.mark.parametrize("learned", [True, False])
def test_the_spread_of_actions_is_learned_or_stays(learned):
    model, _ = make_model(small("ppo", f"learning.learn_spread={str(learned).lower()}"), seed=0)
    before = model.policy.log_std.detach().clone()
    model.learn(64)
    moved = not torch.equal(model.policy.log_std, before)
    assert moved == learned and before.unique().item() == pytest.approx(load_config("ppo").learning.log_std_init)


def test_the_learning_rate_falls_from_its_first_value_to_its_last():
    model, _ = make_model(small("ppo", "learning.learning_rate=4.0e-3", "learning.final_learning_rate=1.0e-3"), seed=0)
    assert [model.lr_schedule(left) for left in (1.0, 0.5, 0.0)] == pytest.approx([4e-3, 2.5e-3, 1e-3], rel=1e-12)


def test_a_training_is_compared_on_the_suites_robots_not_on_its_own(tmp_path):
    """A scenario to train on may have weaker thrusters; those of the comparisons have their own."""
    config = small("ppo", "environment.scenario=practice/rough")
    train(config, 0, tmp_path / "run")
    schedule = load_schedule(tmp_path / "run" / BEST)
    robot = load_params().with_overrides(*config.environment.overrides)
    assert schedule.trained["suite_hash"] == hash_of_suite(config.validation, robot)
