"""A search at a database: several processes take trials of one study, each once; errors do not tell passwords."""

import subprocess
import sys

import numpy as np
import optuna
import pytest
from postgres import PASSWORD, running_server
from small_training import PPO_SMALL

from sffr_agents import shared_study
from sffr_agents import tune as module
from sffr_agents.folder import BEST
from sffr_agents.shared_study import is_database, open_shared
from sffr_agents.tune_config import load_tune
from sffr_gym import ConfigError

SEARCHER = """
import sys, time
from pathlib import Path
import numpy as np
from sffr_agents import shared_study
from sffr_agents import tune as module
from sffr_agents.tune_config import load_tune

def fake(config, seed, out, report):
    time.sleep(0.2)
    return np.full((4, 1), config.learning.n_epochs - config.learning.gamma)

module._train_and_score = fake
module.tune(load_tune(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
"""


@pytest.fixture
def search(tmp_path):
    file = tmp_path / "search.yaml"
    space = "[{key: learning.gamma, low: 0.9, high: 0.99}, {key: learning.n_epochs, low: 1, high: 9}]"
    file.write_text(f"train: ppo\nset: {PPO_SMALL}\nseeds: 1\ntrials: 8\nspace: {space}\n")
    return file


def test_processes_search_together(search, tmp_path):
    """No trial runs twice, both see all, and the untuned settings come once."""
    url = f"sqlite:///{tmp_path}/trials.db?timeout=60"
    plan = load_tune(search)
    running = [
        subprocess.Popen([sys.executable, "-c", SEARCHER, str(search), str(tmp_path / name), url])
        for name in ("one", "two")
    ]
    for each in running:
        assert each.wait(240) == 0
    with open_shared(url, module.Search.of(plan, 0), plan.space) as trials:
        found = trials.finished()
    assert 8 <= len(found) <= 9  # one more where both took the last
    assert len({trial.number for trial in found}) == len(found)
    untuned = module._untuned_values(plan)
    assert sum(trial.params == untuned for trial in found) == 1
    best = [(tmp_path / name / module.BEST_CONFIG).exists() for name in ("one", "two")]
    assert best == [True, True]


def test_whoever_finds_a_search_waits_for_the_one_that_made_it(search, tmp_path, monkeypatch):
    """And begins itself if that one was killed before its first trial."""
    plan, url = load_tune(search), f"sqlite:///{tmp_path}/trials.db?timeout=60"
    untuned, about = module._untuned_values(plan), module.Search.of(plan, 0)
    with open_shared(url, about, plan.space) as maker, open_shared(url, about, plan.space) as finder:
        monkeypatch.setattr(shared_study.time, "sleep", lambda seconds: maker.propose(untuned, 0))
        assert finder.propose(untuned, 0) != untuned == maker._running.params
    monkeypatch.setattr(shared_study.time, "sleep", lambda seconds: None)
    other = f"sqlite:///{tmp_path}/other.db?timeout=60"
    with open_shared(other, about, plan.space), open_shared(other, about, plan.space) as finder:
        assert finder.propose(untuned, 0) == untuned


@pytest.mark.slow
def test_commands_search_together_in_postgresql(search, tmp_path):
    """Started at once in an empty database: each trains, no trial is lost or stands for two, both see all of them."""
    psycopg = pytest.importorskip("psycopg")
    with running_server() as url:
        command = [sys.executable, "-m", "sffr_gym", "tune", str(search), "--storage", url, "--out"]
        running = [
            subprocess.Popen(
                [*command, str(tmp_path / name)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
            )
            for name in ("one", "two")
        ]
        told = [each.communicate(timeout=500) for each in running]
        assert [each.returncode for each in running] == [0, 0], told
        plan = load_tune(search)
        with open_shared(url, module.Search.of(plan, 0), plan.space) as trials:
            found = trials.finished()
        with psycopg.connect(url.replace("+psycopg", "")) as connection:
            states = connection.execute("select number, state from trials order by number").fetchall()
    assert 8 <= len(found) <= 9 and states == [(k, "COMPLETE") for k in range(len(found))]
    trained = [sorted((tmp_path / name / module.TRAININGS).iterdir()) for name in ("one", "two")]
    assert all(trained) and sum(map(len, trained)) == len(found)
    assert all((folder / BEST).is_file() for own in trained for folder in own)
    assert all(PASSWORD not in text for texts in told for text in texts)
    assert all(PASSWORD not in file.read_text() for file in tmp_path.rglob("*.json"))


def test_studies_of_others_stay_as_they_are(search, tmp_path, monkeypatch):
    """Each search has a study of its own in the database; a second one does not see the first."""
    url = f"sqlite:///{tmp_path}/trials.db"
    optuna.create_study(storage=url, study_name="thesis").enqueue_trial({"x": 1})
    monkeypatch.setattr(module, "_train_and_score", lambda config, *_: np.full((4, 1), config.learning.gamma))
    plan = load_tune(search, ["trials=2"])
    module.tune(plan, tmp_path / "out", url)
    module.tune(plan.model_copy(update={"seeds": 2}), tmp_path / "other", url)
    names = optuna.get_all_study_names(url)
    assert len(names) == 3 and "thesis" in names
    assert [trial.params for trial in optuna.load_study(storage=url, study_name="thesis").trials] == [{}]


def test_a_database_that_cannot_be_used_is_told_without_its_password(search):
    plan = load_tune(search)
    for url in ("nonsense://me:hidden@host/trials", "sqlite:////no/such/folder/trials.db"):
        with pytest.raises(ConfigError) as error, open_shared(url, module.Search.of(plan, 0), plan.space):
            pass
        assert "hidden" not in str(error.value) and len(str(error.value).splitlines()) == 1


def test_files_are_no_databases(tmp_path):
    assert is_database("postgresql://user@host/trials") and not is_database("trials.db")
    assert not is_database(tmp_path / "trials.db") and not is_database(None)
