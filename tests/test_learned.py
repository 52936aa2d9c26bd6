"""Learned policies as files: what is exported decides as torch does, runs without it, and runs nobody's code."""

import json
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch
from project import ROOT
from small_training import PPO_SMALL, small
from stable_baselines3 import PPO
from torch import nn

from sffr_agents.algorithms import make_model
from sffr_agents.config import CONFIGS, VALIDATION_SEED, load_config
from sffr_agents.export import export_run, export_zip, network_of, network_of_layers
from sffr_agents.folder import BEST, LAST, PROGRESS
from sffr_agents.train import train
from sffr_baselines.damping_env import SFFRFlexDampingEnv
from sffr_baselines.learned import LearnedSchedule, Network, load_schedule, save_schedule, shipped_policies
from sffr_baselines.policies import policy_title
from sffr_baselines.rollout import rollout
from sffr_baselines.schedule import BASE_ERROR, N_FEATURES, PHASES
from sffr_gym import ConfigError, load_params
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.score import costs
from sffr_workbench.benchmark.episodes import Plan, run_episodes
from sffr_workbench.evaluation import evaluate


@pytest.mark.parametrize("algo", CONFIGS)
@pytest.mark.parametrize(
    "change", ["network.per_panel=false", "network.per_panel=true", "learning.energy_scaling=false"]
)
def test_export_decides_as_torch_does(algo, change, tmp_path):
    config = small(algo, change)
    model, env = make_model(config, seed=0)
    model.learn(config.steps)
    file = tmp_path / "policy.npz"
    save_schedule(file, LearnedSchedule.of(network_of(model), env.unwrapped.env, {"seed": 0}))
    schedule = load_schedule(file)
    assert schedule.base_tolerance == config.environment.base_tolerance == 0.003
    rng = np.random.default_rng(0)
    obs = rng.uniform(-1.0, 1.0, (50, 36)).astype(np.float32)
    expected, _ = model.predict(obs.reshape(-1, *model.observation_space.shape), deterministic=True)
    np.testing.assert_allclose(schedule.predict(obs)[0], expected.reshape(50, 4), atol=1e-6)


@pytest.mark.parametrize("stack_size", [1, 4])
@pytest.mark.parametrize("per_panel", [True, False])
def test_compiled_loop_acts_as_the_policy_in_the_environment(stack_size, per_panel, tmp_path):
    changes = [f"environment.stack_size={stack_size}", f"network.per_panel={per_panel}"]
    model, env = make_model(load_config("ppo", [*PPO_SMALL, *changes]), seed=0)
    with torch.no_grad():
        model.policy.action_net[0].weight *= 100.0  # else it hardly acts
    save_schedule(tmp_path / "policy.npz", LearnedSchedule.of(network_of(model), env.unwrapped.env, {}))
    schedule = load_schedule(tmp_path / "policy.npz")
    assert schedule.stack_size == stack_size
    arguments = {name: getattr(schedule, name) for name in ("rho", "base_tolerance", "stack_size")}
    damping = SFFRFlexDampingEnv(duration=1.0, random_phase=False, **arguments)
    bare = SFFRFlexEnv(damping._distribution(damping.scenario))
    policy = schedule.policy(bare.params)
    assert schedule.base_tolerance == policy.law.schedule.tolerance == 0.003  # of the shipped configuration
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


WITHOUT_TORCH = """
import pathlib, sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("torch", "stable_baselines3", "sb3_contrib"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Missing())
from typer.testing import CliRunner
from sffr_workbench.cli.app import app
from sffr_baselines.learned import load_schedule
folder = pathlib.Path(sys.argv[1])
load_schedule(folder / "policy.npz").predict([0.0] * 36)
(folder / "short.yaml").write_text("name: short\\ndescription: short\\nduration: 0.5\\n")
arguments = ["evaluate", str(folder / "policy.npz"), "ahsc", "-s", str(folder / "short.yaml"), "--no-figures"]
result = CliRunner().invoke(app, [*arguments, "-o", str(folder / "run")])
assert result.exit_code == 0, repr(result.exception)
"""


def test_policies_run_without_torch(schedule, tmp_path):
    save_schedule(tmp_path / "policy.npz", schedule)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", WITHOUT_TORCH, str(tmp_path)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    run = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert set(run["policies"]) == {f"{tmp_path.name}/policy", "ahsc"}


def test_run_folder_and_zip_export_the_same_policy(tmp_path):
    config = small("ppo")
    train(config, 0, tmp_path / "run")
    export_run(tmp_path / "run", tmp_path / "run.npz")
    assert {BEST, LAST, PROGRESS} <= {path.name for path in (tmp_path / "run").iterdir()}
    model, _ = make_model(config, seed=1)
    model.save(tmp_path / "model.zip")
    for trust in (False, True):
        export_zip(tmp_path / "model.zip", config, tmp_path / "zip.npz", trust)
        obs = np.linspace(-1.0, 1.0, 2 * N_FEATURES)
        np.testing.assert_allclose(
            load_schedule(tmp_path / "zip.npz").predict(obs)[0],
            np.clip(network_of(model)(obs.reshape(2, N_FEATURES)).ravel(), -1.0, 1.0),
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


@pytest.fixture
def schedule():
    """A schedule that damps all the more, the more a panel moves."""
    matrix = np.zeros((2, N_FEATURES))
    matrix[:, 4] = 1.0
    network = Network((matrix,), (np.zeros(2),), relu=False, squash=False)
    return LearnedSchedule.of(network, SFFRFlexDampingEnv(), {"algo": "none"})


@pytest.fixture
def short(tmp_path):
    """A scenario of half a second."""
    file = tmp_path / "short.yaml"
    file.write_text("name: short\ndescription: short\nduration: 0.5\n")
    return str(file)


def test_files_stand_beside_baselines_in_evaluation_and_benchmark(schedule, short, tmp_path):
    file = tmp_path / "mine" / "best.npz"
    file.parent.mkdir()
    save_schedule(file, schedule)
    evaluation = evaluate(["ahsc", str(file)], short, 1)
    assert list(evaluation.results) == ["ahsc", "mine/best"]
    plan = Plan(("ahsc", str(file)), (short,), 1, 1_000_000, load_params())
    with RunFolder.claim(tmp_path / "run", "benchmark") as run:
        results = run_episodes(plan, run, jobs=1)
    assert results == [own[0] for own in evaluation.results.values()]
    assert results[0].measures != results[1].measures
    network = Network((2.0 * schedule.network.matrices[0],), schedule.network.biases, False, False)
    save_schedule(file, replace(schedule, network=network))
    with (
        RunFolder.claim(tmp_path / "run", "benchmark") as run,
        pytest.raises(ConfigError, match="another policy 'mine/best'"),
    ):
        run_episodes(plan, run, jobs=1)


def test_policies_of_one_title_are_rejected(schedule, short, tmp_path):
    files = [tmp_path / folder / "run" / "best.npz" for folder in ("a", "b")]
    for file in files:
        file.parent.mkdir(parents=True)
        save_schedule(file, schedule)
    with pytest.raises(ConfigError, match="'run/best': rename"):
        evaluate([str(file) for file in files], short, 1)


def test_titles_are_short_and_told_apart_by_folder():
    assert [policy_title(name) for name in ("ahsc", "policy.npz", "runs/seed0/best.npz")] == [
        "ahsc", "policy", "seed0/best",
    ]  # fmt: skip


def test_schedules_are_read_by_name_and_by_path():
    file = shipped_policies()["sac"]
    for name in ("sac", str(file), file):
        assert load_schedule(name).trained["algo"] == "sac"
    with pytest.raises(ConfigError, match=r"nowhere/best\.npz: cannot be read"):
        load_schedule("nowhere/best.npz")


@pytest.mark.parametrize(("name", "hint"), [("sca", "; did you mean 'sac'?"), ("ahsc", ""), ("runs/best", "")])
def test_unknown_schedule_is_named_with_the_nearest(name, hint):
    with pytest.raises(ConfigError) as error:
        load_schedule(name)
    assert f"nor an .npz file{hint} (shipped: mpc-scheduled, ppo, sac)" in str(error.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"matrix0": np.zeros((3, N_FEATURES))}, "a matrix of shape"),
        ({"matrix0": np.zeros((2, 6))}, "6 inputs and 2 outputs does not fit 36 observations"),
        ({"matrix0": np.full((2, N_FEATURES), np.inf)}, "not finite"),
        ({"bias0": np.array([None, 1], dtype=object)}, "must hold numbers or texts"),
        ({"matrix1": np.zeros((1, 5)), "bias1": np.zeros(1)}, "followed by one of 5 inputs"),
        ({"about": np.array("{}")}, "about: format: missing"),
        ({"about": np.array('{"format": "sffr-policy-9"}')}, "format = 'sffr-policy-9': must be 'sffr-policy-1'"),
    ],
)
def test_file_that_is_no_policy_is_rejected(schedule, changes, message, tmp_path):
    """Compiled code would read beyond the weights if the sizes were wrong, and pickled ones could run anything."""
    file = tmp_path / "policy.npz"
    save_schedule(file, schedule)
    with np.load(file) as data:
        arrays = dict(data)
    np.savez(file, **(arrays | changes))
    with pytest.raises(ConfigError, match=message):
        load_schedule(file)


def test_text_is_no_policy(tmp_path):
    file = tmp_path / "policy.npz"
    file.write_text("weights")
    with pytest.raises(ConfigError, match=r"is no \.npz file of plain arrays"):
        load_schedule(file)


def test_policy_of_another_robot_is_rejected(schedule):
    with pytest.raises(ConfigError, match="was made for a robot"):
        schedule.policy(
            load_params().with_overrides("panel.mounts=[{name: single, root: [-0.3, 0.5], angle: 1.5707963}]")
        )


@pytest.mark.parametrize("name", ["ppo", "sac"])
def test_shipped_policy_damps_better_than_ahsc_and_says_where_it_is_from(name):
    """It comes from the shipped configuration of its name; on Table IV's start it keeps what the results say."""
    trained = load_schedule(name).trained
    assert {"algo", "seed", "steps", "config_hash", "suite_hash"} <= trained.keys()
    assert (trained["algo"], trained["config_hash"]) == (name, load_config(name).hash())
    evaluation = evaluate([name, "ahsc"], "nominal")
    (own,), (ahsc,) = evaluation.results.values()
    assert not own.failure
    assert own.measures["vibration"] < 0.45 * ahsc.measures["vibration"]
    assert own.measures["track_rmse"] < 1.10 * ahsc.measures["track_rmse"]
    assert costs(evaluation.results)[name] < 0.70


def test_the_schedule_set_by_hand_is_its_pages_program(tmp_path, monkeypatch):
    """It lets go of a panel that rests beside its shape, and holds one that swings as the law itself does."""
    text = (ROOT / "docs" / "agents.md").read_text(encoding="utf-8")
    (program,) = [block for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "mpc-scheduled" in block]
    monkeypatch.chdir(tmp_path)
    exec(program, {})
    page, shipped = load_schedule("./mpc-scheduled.npz"), load_schedule("mpc-scheduled")
    for own, other in zip(
        (*page.network.matrices, *page.network.biases),
        (*shipped.network.matrices, *shipped.network.biases),
        strict=True,
    ):
        np.testing.assert_array_equal(own, other)
    assert replace(page, network=shipped.network) == shipped
    seen = np.zeros((3, 2, 50, N_FEATURES))
    seen[..., BASE_ERROR] = -3.0
    seen[1, :, :, PHASES] = 1.0  # at rest for 5 s
    seen[2, :, 0, BASE_ERROR] = 0.0  # the base is off its path by 3 mm
    decided = np.tanh([[0.0, 0.0], [-1.5 * 0.9, 0.0], [0.0, -2.0]])
    np.testing.assert_allclose(shipped.predict(seen.reshape(3, -1))[0].reshape(3, 2, 2)[:, 0], decided, atol=1e-6)


def test_the_schedule_set_by_hand_is_worth_it_where_the_model_is_wrong():
    """A panel whose stiffness and mass are others rests beside the shape that mpc believes in and holds it to."""
    evaluation = evaluate(["mpc", "mpc-scheduled", "ahsc"], "mismatch", episodes=3, seed=VALIDATION_SEED)
    cost = costs({name: results for name, results in evaluation.results.items() if name != "ahsc-oracle"})
    assert cost["mpc-scheduled"] < 0.8 * cost["mpc"]
    right = costs(evaluate(["mpc", "mpc-scheduled", "ahsc"], "nominal").results)
    assert right["mpc-scheduled"] == pytest.approx(right["mpc"], rel=0.01)


@pytest.mark.parametrize(
    "units", [(nn.Tanh, nn.ReLU, nn.Tanh), (nn.Tanh, nn.Tanh, nn.ReLU), (nn.Identity, nn.Tanh, nn.Tanh)]
)
def test_layers_of_other_kinds_cannot_be_exported(units):
    """Hidden ones are all tanh or all rectified, and the output goes through tanh or nothing."""
    layers = [layer for unit in units for layer in (nn.Linear(2, 2), unit())]
    with pytest.raises(ValueError, match="cannot be exported"):
        network_of_layers(layers)
    assert network_of_layers([nn.Linear(2, 2), nn.ReLU(), nn.Linear(2, 2), nn.ReLU(), nn.Linear(2, 1)]).relu
