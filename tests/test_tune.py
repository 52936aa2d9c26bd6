"""The search for settings: several seeds for a trial, all their episodes for a score, and kills that lose nothing."""

import csv
import json
import re

import numpy as np
import pytest
from small_training import PPO_SMALL

from sffr_agents import tune as module
from sffr_agents.config import load_config
from sffr_agents.folder import BEST
from sffr_agents.tune_config import TuneConfig, load_tune
from sffr_agents.validation import Validator
from sffr_baselines.learned import load_schedule
from sffr_gym import ConfigError, load_params
from sffr_gym.config.run_folder import CARD
from sffr_gym.config.strict_yaml import build
from sffr_gym.task.statistics import interquartile_mean

tune = pytest.importorskip("optuna") and module.tune

SPACE = """
space:
  - {key: learning.gamma, low: 0.9, high: 0.99}
  - {key: learning.n_epochs, low: 1, high: 3}
  - {key: network.hidden, choices: ["[4]", "[8, 8]"]}
"""


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    file = tmp_path_factory.mktemp("plan") / "search.yaml"
    file.write_text(f"train: ppo\nset: {PPO_SMALL}\nseeds: 2\ntrials: 2\n{SPACE}")
    return load_tune(file)


def rows(folder):
    with (folder / module.TRIALS).open(newline="") as text:
        return list(csv.DictReader(text))


@pytest.fixture(scope="module")
def whole(plan, tmp_path_factory):
    """The rows of a search that nothing interrupted."""
    folder = tmp_path_factory.mktemp("whole")
    tune(plan, folder)
    return rows(folder)


@pytest.mark.parametrize("storage", [None, "study.db"])
def test_killed_search_resumes_with_the_same_costs(plan, whole, tmp_path, storage):
    storage = storage and tmp_path / storage

    def kill(what, done, total):
        if re.match(r"trial 2 .* seed 1", what):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tune(plan, tmp_path / "killed", storage, progress=kill)
    assert len(rows(tmp_path / "killed")) == 1
    best = tune(plan, tmp_path / "killed", storage)
    found = rows(tmp_path / "killed")
    assert len(found) == 2 and float(found[0]["cost"]) == best.values[0] <= float(found[1]["cost"])
    assert whole[0].keys() == found[0].keys()
    assert {row["cost"] for row in whole} == {row["cost"] for row in found}


def test_trial_counts_by_the_episodes_of_all_seeds(plan, tmp_path):
    best = tune(plan.model_copy(update={"trials": 1}), tmp_path / "run")
    config = load_config(tmp_path / "run" / module.BEST_CONFIG)
    assert config == plan.training(best.params)
    validator = Validator(config.validation, load_params())
    folders = sorted((tmp_path / "run" / "trainings").iterdir())
    assert len(folders) == 2
    costs = [validator.episode_costs(load_schedule(folder / BEST)) for folder in folders]
    assert best.values[0] == pytest.approx(float(interquartile_mean(np.concatenate(costs))), rel=1e-12)


def test_first_trial_has_the_settings_as_they_are(plan, tmp_path):
    best = tune(plan.model_copy(update={"trials": 1}), tmp_path / "run")
    assert best.params == {"learning.gamma": 0.98, "learning.n_epochs": 2, "network.hidden": "[8, 8]"}


def test_settings_as_they_are_are_tried_where_the_search_may_take_them(plan):
    """Lists by their text, and everything else by its value; not what lies outside."""
    space = [
        {"key": "learning.gamma", "low": 0.985, "high": 0.99}, {"key": "learning.n_epochs", "choices": [1, 2]},
        {"key": "network.hidden", "choices": ["[4]"]}, {"key": "network.per_panel", "choices": [True, False]},
    ]  # fmt: skip
    other = build(TuneConfig, plan.model_dump() | {"space": space}, lambda key: "file")
    assert module._untuned_values(other) == {"learning.n_epochs": 2, "network.per_panel": True}


def test_a_finished_search_goes_on_for_more_trials(plan, tmp_path):
    """And is not finished while it does."""
    tune(plan.model_copy(update={"trials": 1}), tmp_path)
    assert json.loads((tmp_path / CARD).read_text())["finished"]
    states = []

    def look(what, done, total):
        states.append(json.loads((tmp_path / CARD).read_text())["finished"])

    tune(plan, tmp_path, progress=look)
    assert states and not any(states) and json.loads((tmp_path / CARD).read_text())["finished"]
    assert len(rows(tmp_path)) == 2


def test_folder_of_another_search_is_rejected(plan, tmp_path):
    tune(plan.model_copy(update={"trials": 1}), tmp_path / "run")
    with pytest.raises(ConfigError, match="another search"):
        tune(plan.model_copy(update={"seeds": 3}), tmp_path / "run")
