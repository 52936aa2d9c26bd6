"""Files of trials, and the folder of a search: what is of others stays, damage is told, and kills lose nothing."""

import json
import os
import sqlite3
from contextlib import closing

import numpy as np
import optuna
import pytest
from command_line import sffr
from optuna.trial import TrialState
from small_training import PPO_SMALL

from sffr_agents import tune as module
from sffr_agents.folder import BEST, CONFIG
from sffr_agents.study import NAME, locked, open_trials
from sffr_agents.train import train
from sffr_agents.tune_config import load_tune
from sffr_gym import ConfigError
from sffr_gym.config.run_folder import CARD, LOCK, RunFolder

STORAGES = ["trials.journal", "trials.db"]


class Killed(Exception):
    pass


@pytest.fixture
def plan(tmp_path_factory):
    """A search over two settings, whose trainings are not run."""
    file = tmp_path_factory.mktemp("search") / "search.yaml"
    space = "[{key: learning.gamma, low: 0.9, high: 0.99}, {key: learning.n_epochs, low: 1, high: 9}]"
    file.write_text(f"train: ppo\nset: {PPO_SMALL}\nseeds: 2\ntrials: 12\nspace: {space}\n")
    return load_tune(file)


@pytest.fixture
def trained(monkeypatch):
    """Every training that a search asks for, which costs what its settings say; it may be made to die in the n-th."""
    asked = []

    def fake(config, seed, out, report):
        asked.append((config.learning.gamma, config.learning.n_epochs, seed))
        if len(asked) == trained.last:
            raise Killed
        return np.full((4, 1), config.learning.n_epochs - config.learning.gamma)

    def trained():
        return asked

    trained.last = 0
    monkeypatch.setattr(module, "_train_and_score", fake)
    return trained


def results(folder):
    return [(folder / name).read_text() for name in (module.TRIALS, module.BEST_CONFIG)]


@pytest.mark.parametrize("storage", [None, *STORAGES])
def test_search_that_was_killed_finds_the_same(storage, plan, trained, tmp_path):
    """Also beyond the ten random trials, after which each depends on all before it."""
    where = {name: storage and tmp_path / name / storage for name in ("whole", "killed")}
    module.tune(plan, tmp_path / "out-whole", where["whole"])
    whole = list(trained())
    trained().clear()
    for last in (1, 6, 2, 9):
        trained.last = last
        with pytest.raises(Killed):
            module.tune(plan, tmp_path / "out-killed", where["killed"])
        trained().clear()
    trained.last = 0
    module.tune(plan, tmp_path / "out-killed", where["killed"])
    assert results(tmp_path / "out-whole") == results(tmp_path / "out-killed")
    assert whole[-len(trained()) :] == trained()
    count = len(trained())
    longer = plan.model_copy(update={"trials": 13})
    assert json.loads((tmp_path / "out-killed" / CARD).read_text())["finished"] is not False
    assert module.tune(longer, tmp_path / "out-killed", where["killed"]).values[0] <= 9.0
    assert len(trained()) == count + 2  # one more trial, of two seeds


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("content", [b"thesis", b'{"op_code": 0}\n', b"[1]\n", b"\xff\xfe", b"SQLite format 3\0"])
def test_file_of_others_is_left_as_it_is(storage, content, plan, trained, tmp_path):
    (tmp_path / storage).write_bytes(content)
    with pytest.raises(ConfigError) as error:
        module.tune(plan, tmp_path / "out", tmp_path / storage)
    assert str(tmp_path / storage) in str(error.value) and len(str(error.value).splitlines()) == 1
    assert (tmp_path / storage).read_bytes() == content and not trained()


def test_studies_of_others_are_left_as_they_are(plan, trained, tmp_path):
    """Whoever has a database or journal of Optuna's own gets no study of ours into it."""
    for storage in (f"sqlite:///{tmp_path}/a.db", optuna.storages.JournalStorage(journal(tmp_path / "a.journal"))):
        optuna.create_study(storage=storage, study_name="thesis").enqueue_trial({"x": 1})
    for name in ("a.db", "a.journal"):
        before = (tmp_path / name).read_bytes()
        with pytest.raises(ConfigError, match="is there, and holds no trials of sffr tune"):
            module.tune(plan, tmp_path / f"out-{name}", tmp_path / name)
        assert (tmp_path / name).read_bytes() == before


def journal(file):
    return optuna.storages.journal.JournalFileBackend(str(file))


@pytest.mark.parametrize("storage", [None, *STORAGES])
def test_another_search_is_refused_with_both_values(storage, plan, trained, tmp_path):
    file = storage and tmp_path / storage
    short = plan.model_copy(update={"trials": 1})
    module.tune(short, tmp_path / "out", file)
    for change, other, message in (
        ({}, {"seed": 1}, "seed = 0, not 1"), ({"seeds": 3}, {}, "plan.seeds = 2, not 3"),
        ({"train": "sac"}, {}, "plan.train = 'ppo', not 'sac'"),
    ):  # fmt: skip
        with pytest.raises(ConfigError, match=f"holds another search: {message}"):
            module.tune(short.model_copy(update=change), tmp_path / "out", file, **other)
        if file:
            with pytest.raises(ConfigError, match=f"holds the trials of another search: {message}"):
                module.tune(short.model_copy(update=change), tmp_path / message.split()[0], file, **other)
    with pytest.raises(ConfigError, match="seed = -1"):
        module.tune(short, tmp_path / "out", file, seed=-1)


def cut_line(file):
    """A process died while it wrote."""
    file.write_bytes(file.read_bytes() + b'{"op_code":4,"study_')


def middle(file):
    """A byte that changed."""
    lines = file.read_text().splitlines(keepends=True)
    file.write_text("".join([*lines[:2], "{\n", *lines[3:]]))


def edit_trial(**changes):
    """A change of the first trial in a journal."""

    def change(file):
        lines = [json.loads(line) for line in file.read_text().splitlines()]
        next(line for line in lines if line["op_code"] == 4).update(changes)
        file.write_text("".join(json.dumps(line) + "\n" for line in lines))

    return change


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (cut_line, None), (middle, r"study\.journal:3: is no valid JSON"),
        (lambda file: file.write_bytes(b"[" * 100_000 + b"\n"), "is nested too deeply"),
        (lambda file: file.write_bytes(b"1\n"), "must hold a mapping"),
        (lambda file: os.truncate(file, 10**8), "is too large"),
        (lambda file: (file.unlink(), file.mkdir()), "cannot be read"),
        (edit_trial(op_code=99), "its trials are damaged"),
        (edit_trial(params={"learning.gamma": 0.5}), "its trials are damaged"),
        (edit_trial(params={"learning.gamma": 7.0, "learning.n_epochs": 2}), "its trials are damaged"),
        (edit_trial(values=[float("nan")]), "NaN is no number"), (edit_trial(values=["x"]), "its trials are damaged"),
        (edit_trial(values=[1.0, 2.0]), "its trials are damaged"), (edit_trial(distributions={}), "its trials are dam"),
    ],
)  # fmt: skip
def test_damaged_journal_is_told_in_a_line(damage, message, plan, trained, tmp_path):
    short = plan.model_copy(update={"trials": 3})
    first = module.tune(short, tmp_path)
    damage(tmp_path / module.STUDY)
    if message is None:  # nothing was lost: a trial counts once its line is whole
        assert module.tune(short, tmp_path) == first
        assert (tmp_path / module.STUDY).read_text().endswith("\n")
        return
    with pytest.raises(ConfigError, match=message) as error:
        module.tune(short, tmp_path)
    assert str(tmp_path / module.STUDY) in str(error.value) and len(str(error.value).splitlines()) == 1


def test_damaged_database_is_told_in_a_line(plan, trained, tmp_path):
    file, short = tmp_path / "a.db", plan.model_copy(update={"trials": 2})
    module.tune(short, tmp_path / "out", file)
    content = file.read_bytes()
    with closing(sqlite3.connect(file)) as database, database:
        database.execute("DROP TABLE trial_params")
    with pytest.raises(ConfigError, match=r"a\.db: its trials are damaged: ValueError: Inconsistent parameters"):
        module.tune(short, tmp_path / "out", file)
    file.write_bytes(content[: len(content) // 2])
    with pytest.raises(ConfigError, match=r"a\.db: "):
        module.tune(short, tmp_path / "out", file)


@pytest.mark.parametrize("content", [b"{", b"[]", b'{"seed": -1, "plan": {}}', b'{"seed": 0}', b"\xff"])
def test_damaged_plan_is_told_in_a_line(content, plan, trained, tmp_path):
    module.tune(plan.model_copy(update={"trials": 1}), tmp_path)
    (tmp_path / module.PLAN).write_bytes(content)
    with pytest.raises(ConfigError) as error:
        module.tune(plan, tmp_path)
    assert module.PLAN in str(error.value) and len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("name", [module.TRIALS, module.BEST_CONFIG, module.TRAININGS, module.STUDY])
def test_a_file_that_came_later_is_not_replaced(name, plan, trained, tmp_path):
    RunFolder.claim(tmp_path, "search").release()
    (tmp_path / name).write_text("mine")
    with pytest.raises(ConfigError, match="is there, and was not written by this run"):
        module.tune(plan, tmp_path)
    assert (tmp_path / name).read_text() == "mine" and not trained()


@pytest.mark.parametrize("name", [module.TRIALS, module.PLAN, CARD, LOCK])
def test_trials_have_a_file_of_their_own(name, plan, trained, tmp_path):
    with pytest.raises(ConfigError, match="is the name of another file of the search"):
        module.tune(plan, tmp_path, tmp_path / name)


def test_one_of_two_searches_is_told_at_once(plan, trained, tmp_path):
    """Into one folder, or with one file of trials."""
    with RunFolder.claim(tmp_path / "out", "search"), pytest.raises(ConfigError, match="another process is writing"):
        module.tune(plan, tmp_path / "out")
    with locked(tmp_path / "a.db"), pytest.raises(ConfigError, match=r"another process is writing to it.*--storage"):
        module.tune(plan, tmp_path / "other", tmp_path / "a.db")
    assert not trained()


def test_file_of_trials_is_whole_or_not_there(plan, tmp_path, monkeypatch):
    """A process that dies while it makes one leaves nothing that the next one would take for somebody else's."""
    search = module.Search.of(plan, 0)
    for name in STORAGES:
        with monkeypatch.context() as patch, pytest.raises(Killed):
            patch.setattr(optuna.Study, "set_user_attr", lambda *arguments: (_ for _ in ()).throw(Killed))
            with open_trials(tmp_path / name, search, plan.space):
                pass
        assert not (tmp_path / name).exists()
        with open_trials(tmp_path / name, search, plan.space) as trials:
            trials.add({"learning.gamma": 0.9, "learning.n_epochs": 2}, 0.5)
        with open_trials(tmp_path / name, search, plan.space) as trials:
            assert [trial.values for trial in trials.finished()] == [[0.5]]
    assert sorted(path.name for path in tmp_path.iterdir() if "trials" in path.name) == sorted(STORAGES)


def test_trials_are_kept_as_optuna_reads_them(plan, trained, tmp_path):
    module.tune(plan.model_copy(update={"trials": 2}), tmp_path)
    storage = optuna.storages.JournalStorage(journal(tmp_path / module.STUDY))
    trials = optuna.load_study(study_name=NAME, storage=storage).trials
    assert [trial.state for trial in trials] == [TrialState.COMPLETE] * 2
    assert trials[0].params == {"learning.gamma": 0.98, "learning.n_epochs": 2}


def test_training_of_another_trial_is_not_taken(plan, tmp_path):
    """A folder has the name of its training."""
    config = plan.training({})
    folder = tmp_path / module.TRAININGS / f"{config.hash()}-0"
    train(config.model_copy(update={"steps": 16}), 0, folder)
    with pytest.raises(ConfigError, match="holds another training than its name says"):
        module._train_and_score(config, 0, tmp_path, module._Report(None, print))


def test_full_disk_says_what_is_kept(plan, trained, tmp_path, monkeypatch):
    def full(run, trials, plan):
        raise OSError(28, "No space left on device", "trials.csv")

    monkeypatch.setattr(module, "_write_results", full)
    with pytest.raises(ConfigError, match=r"trials\.csv: No space left on device; 1 finished trials are kept"):
        module.tune(plan, tmp_path)


def test_command_resumes_its_trainings(tmp_path):
    """Their folders are runs of their own, with a damaged checkpoint told on the way."""
    search = tmp_path / "search.yaml"
    space = "[{key: learning.gamma, low: 0.9, high: 0.99}]"
    search.write_text(f"train: ppo\nset: {PPO_SMALL}\nseeds: 1\ntrials: 1\nspace: {space}\n")
    arguments = ["tune", search, "--out", tmp_path / "out"]
    done = sffr(*arguments)
    assert done.exit_code == 0, done.output
    (run,) = (tmp_path / "out" / module.TRAININGS).iterdir()
    assert (run / BEST).exists() and (run / CONFIG).exists() and (run / CARD).exists()
    for name in (module.STUDY, "trainings"):
        assert (tmp_path / "out" / name).exists()
    (tmp_path / "out" / module.STUDY).unlink()
    last = sorted((run / "checkpoints").iterdir())[-1]
    os.truncate(last / "state.json", 10)
    again = sffr(*arguments)
    assert again.exit_code == 0 and again.stdout == done.stdout
    assert f"warning: {last}" in again.stderr.replace("\n", "")
