"""`sffr dataset`: what Minari reads is what the environment gave, and can be replayed bit for bit."""

import json
import os
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from command_line import sffr

from sffr_baselines import make_policy
from sffr_gym import ConfigError, load_params
from sffr_gym.task.scenario import load_scenario
from sffr_workbench.dataset import IDS, ROOT, DatasetPlan, write_datasets

minari = pytest.importorskip("minari")


def loaded(folder, identifier, monkeypatch):
    monkeypatch.setenv(ROOT, str(folder))
    return minari.load_dataset(identifier)


@pytest.mark.parametrize(("env_id", "policy"), [(IDS[0], "lqr"), (IDS[0], "hsc-oracle"), (IDS[1], "sac")])
def test_a_dataset_replays_in_its_own_environment(env_id, policy, short_swing, tmp_path, monkeypatch):
    """The recovered environment, which needs no file, gives the same observations and rewards under the actions."""
    own = tmp_path / "short.yaml"
    own.write_text(Path(short_swing).read_text())
    file = str(own) if env_id == IDS[0] else "excited"
    plan = DatasetPlan((policy,), file, 2, 7, env_id, infos=True)
    write_datasets(plan, tmp_path / "data")
    dataset = loaded(tmp_path / "data", plan.identifier(policy), monkeypatch)
    own.unlink()
    env = dataset.recover_environment()
    for k, episode in enumerate(dataset.iterate_episodes()):
        obs, _ = env.reset(seed=7 + k)
        np.testing.assert_array_equal(obs, episode.observations[0])
        for action, seen, paid in zip(episode.actions, episode.observations[1:], episode.rewards, strict=True):
            assert action in env.action_space
            obs, reward, _, truncated, info = env.step(action)
            np.testing.assert_array_equal(obs, seen)
            assert reward == paid
        assert truncated and episode.truncations[-1] and not episode.truncations[:-1].any()
        np.testing.assert_allclose(episode.infos["vibration"][-1], info["vibration"], rtol=1e-12)
        assert all(value.dtype.kind in "fib" for value in episode.infos.values())


COLLECTS = """
import sys
import gymnasium as gym, minari, numpy as np
import sffr_gym
collector = minari.DataCollector(gym.make(sys.argv[1], scenario=sys.argv[2]), record_infos=True)
rewards = []
for seed in range(2):
    collector.reset(seed=seed)
    done = False
    while not done:
        _, reward, terminated, truncated, _ = collector.step(np.zeros(collector.action_space.shape, np.float32))
        rewards.append(reward)
        done = terminated or truncated
data = collector.create_dataset(
    "own/collected-v0", algorithm_name="none", author="me", author_email="me@example.org", code_permalink="none",
    description="a test's",
)
episodes = list(data.iterate_episodes())
assert len(episodes) == 2 and "object_error" in episodes[0].infos
np.testing.assert_allclose(np.concatenate([each.rewards for each in episodes]), rewards, rtol=1e-12)
"""


@pytest.mark.parametrize("env_id", IDS)
def test_minaris_own_collector_records_the_environments_with_their_infos(env_id, short_swing, tmp_path):
    """Which takes more than the reading of datasets does; the extra brings it. Apart: JAX hooks into Python."""
    command = [sys.executable, "-c", COLLECTS, env_id, str(short_swing)]
    done = subprocess.run(command, env=os.environ | {ROOT: str(tmp_path)}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_metadata_say_where_it_comes_from(short_swing, tmp_path, monkeypatch):
    """Environment, policy, hashes, version, licence, and the seed of each episode."""
    plan = DatasetPlan(("sac",), short_swing, 2, 5, IDS[0])
    write_datasets(plan, tmp_path / "data")
    dataset = loaded(tmp_path / "data", plan.identifier("sac"), monkeypatch)
    facts = dataset.storage.metadata
    assert facts["policy"] == "sac" and len(facts["policy_hash"]) == 16 and facts["license"] == "MIT"
    params = load_params()
    assert facts["scenario_hash"] == load_scenario(short_swing).hash(params) and facts["config_hash"] == params.hash()
    assert json.loads(facts["env_spec"])["kwargs"]["scenario"]["duration"] == 0.4
    told = list(dataset.storage.get_episode_metadata(range(2)))
    assert [each["seed"] for each in told] == [5, 6] and {each["failure"] for each in told} == {""}


def test_actions_are_those_of_the_policy(short_swing, tmp_path, monkeypatch):
    """As it would act in the same episode."""
    plan = DatasetPlan(("ahsc",), short_swing, 1, 3, IDS[0])
    write_datasets(plan, tmp_path / "data")
    (episode,) = loaded(tmp_path / "data", plan.identifier("ahsc"), monkeypatch).iterate_episodes()
    env = gym.make(IDS[0], scenario=short_swing, dtype="float32")
    policy = make_policy("ahsc", env)
    obs, _ = env.reset(seed=3)
    for action in episode.actions[:50]:
        np.testing.assert_array_equal(np.clip(policy(obs), -1.0, 1.0).astype(np.float32), action)
        obs = env.step(action)[0]


def test_the_command_writes_a_dataset_of_each_policy(short_swing, tmp_path):
    """And replaces none unless asked; another robot is in the spec."""
    options = ["--scenario", short_swing, "-n", "1", "--out", tmp_path / "data", "--set", "panel.EI=25"]
    result = sffr("dataset", "none", "hsc", *options)
    assert result.exit_code == 0, result.stderr
    names = sorted(file.parts[-3] for file in (tmp_path / "data").rglob("metadata.json"))
    assert names == ["short-hsc-v0", "short-none-v0"] and "MINARI_DATASETS_PATH=" in result.stdout
    facts = json.loads((tmp_path / "data/sffr/sffrflex/short-hsc-v0/data/metadata.json").read_text())
    assert json.loads(facts["env_spec"])["kwargs"]["params"]["panel"]["EI"] == 25.0
    assert not list((tmp_path / "data").glob(".part-*"))
    refused = sffr("dataset", "hsc", *options)
    assert refused.exit_code == 2 and "is there already; add --overwrite" in refused.stderr
    assert sffr("dataset", "hsc", *options, "--overwrite").exit_code == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"policies": ()}, "no policy given"),
        ({"policies": ("hcs",)}, "did you mean 'hsc'"),
        ({"policies": ("lqr",), "env_id": IDS[1]}, "lqr commands the actuators"),
        ({"env_id": "SFFR-v0"}, "environment 'SFFR-v0': must be one of SFFRFlex-v0, SFFRFlexDamping-v0"),
        ({"episodes": 0}, "episodes"),
        ({"scenario": "exited"}, "did you mean 'excited'"),
    ],
)
def test_what_cannot_be_recorded_is_told_before_anything_runs(arguments, message):
    with pytest.raises(ConfigError, match=message):
        DatasetPlan(**{"policies": ("hsc",), "scenario": "excited", "episodes": 1, "seed": 0} | arguments)
