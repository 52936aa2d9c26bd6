"""Folders of trainings: what is of others stays, options that contradict are refused, damage is told in a line."""

import errno
import json
import os
import shutil

import numpy as np
import pytest
import torch
import yaml
from command_line import sffr
from small_training import PPO_SMALL, small

from sffr_agents.algorithms import make_model
from sffr_agents.checkpoint import Notes, save_checkpoint
from sffr_agents.folder import BEST, CHECKPOINTS, CONFIG, PROGRESS
from sffr_agents.train import resume, train
from sffr_gym import ConfigError
from sffr_gym.config.provenance import MANIFEST
from sffr_gym.config.run_folder import CARD, LOCK, RunFolder

SETS = [part for change in PPO_SMALL for part in ("--set", change)]


def listing(folder):
    """All files of a folder with their content."""
    return {path: path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file() and path.name != LOCK}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A finished training, and its scores."""
    folder = tmp_path_factory.mktemp("trained") / "run"
    return folder, train(small("ppo"), 3, folder)


@pytest.fixture
def run(finished, tmp_path):
    """A copy of it that a test may change."""
    return shutil.copytree(finished[0], tmp_path / "run")


@pytest.mark.parametrize("name", [MANIFEST, BEST, f"{CHECKPOINTS}/000001/thesis.csv", "thesis.csv"])
@pytest.mark.parametrize("command", [["train"], ["train", "--resume"], ["tune", "ppo"]])
def test_a_folder_of_others_is_left_as_it_is(command, name, tmp_path):
    file = tmp_path / "mine" / name
    file.parent.mkdir(parents=True)
    file.write_text("mine")
    result = sffr(*command, "--out", tmp_path / "mine")
    assert result.exit_code == 2 and f"{CARD} is missing" in result.stderr
    assert listing(tmp_path) == {file: b"mine"}


def test_a_run_says_what_it_is_and_which_files_are_its_own(finished):
    folder, _ = finished
    card = json.loads((folder / CARD).read_text())
    assert (card["kind"], card["finished"]) == ("training", True)
    assert {path.name for path in folder.iterdir()} - {LOCK, CARD} == set(card["files"])
    assert (folder / MANIFEST).exists() and json.loads((folder / MANIFEST).read_text())["duration_s"] > 0.0


def test_a_file_that_came_later_is_not_replaced(tmp_path):
    """Neither that of a training that was killed before it began."""
    RunFolder.claim(tmp_path, "training").release()
    (tmp_path / BEST).write_text("mine")
    with pytest.raises(ConfigError, match=r"best\.npz: is there, and was not written by this run"):
        train(small("ppo"), 3, tmp_path)
    assert (tmp_path / BEST).read_text() == "mine"
    (tmp_path / BEST).unlink()
    with pytest.raises(ConfigError, match="has a training that has not begun"):
        resume(tmp_path)
    train(small("ppo", "steps=16"), 3, tmp_path)


def test_one_of_two_trainings_is_told_at_once(tmp_path, finished):
    with RunFolder.claim(tmp_path, "training"), pytest.raises(ConfigError, match="another process is writing to it"):
        train(small("ppo"), 3, tmp_path)
    held = RunFolder.claim(finished[0], "training", resume=True)
    with held, pytest.raises(ConfigError, match="another process is writing to it"):
        resume(finished[0])


def test_a_finished_training_is_not_touched_again(finished):
    folder, scores = finished
    before = listing(folder)
    assert resume(folder) == scores
    with pytest.raises(ConfigError, match="holds a finished run"):
        train(small("ppo"), 3, folder)
    assert listing(folder) == before


@pytest.mark.parametrize(
    ("options", "found"),
    [
        ([], None), (["--algo", "ppo"], None), (["--seed", "3"], None), (["--n-envs", "2"], None),
        (["--algo", "ppo", "--set", "learning.n_steps=8"], None), (["--algo", "FILE", *SETS], None),
        (["--algo", "sac"], 'algo = "ppo", not "sac"'), (["--seed", "7"], "seed = 3, not 7"),
        (["--n-envs", "3"], "n_envs = 2, not 3"), (["--set", "learning.gamma=0.5"], "learning.gamma = 0.98, not 0.5"),
        (["--algo", "FILE"], "steps = 200, not 4000000"), (["--set", "learning.gama=1"], "did you mean 'gamma'"),
        (["--algo", "nowhere.yaml"], "no such file"),
    ],
)  # fmt: skip
def test_options_beside_resume_must_be_those_of_the_run(options, found, finished, tmp_path, monkeypatch):
    """The same value is harmless; another one is refused with both."""
    monkeypatch.setattr("sffr_agents.train.resume", lambda *arguments: {"cost": 1.0})
    shipped = small("ppo").model_dump(mode="json")
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(shipped | {"steps": 4_000_000}))
    options = [str(tmp_path / "mine.yaml") if option == "FILE" else option for option in options]
    result = sffr("train", "--resume", *options, "--out", finished[0])
    assert result.exit_code == (2 if found else 0), result.output
    assert found is None or found in result.stderr


@pytest.mark.parametrize("option", [["--algo", "sac"], ["--trust"]])
def test_export_of_a_run_takes_no_options_of_zips(option, finished, tmp_path):
    result = sffr("export", finished[0], *option, "--out", tmp_path / "a.npz")
    assert result.exit_code == 2 and ('algo = "ppo", not "sac"' in result.stderr or "is for zips" in result.stderr)


@pytest.mark.parametrize(
    ("command", "name"),
    [
        (["export", "RUN"], "a.npz"),
        (["curves", "RUN"], "a.png"),
        (["phase", "sac"], "a.png"),
        (["tune-law", "lqr"], "a.yaml"),
    ],
)  # fmt: skip
def test_a_file_is_not_replaced_unless_asked(command, name, finished, tmp_path, monkeypatch):
    """Which is told before anything is imported."""
    monkeypatch.setattr("sffr_workbench.common.extras.find_spec", lambda name: None)
    (tmp_path / name).write_text("mine")
    command = [finished[0] if part == "RUN" else part for part in command]
    for place, message in ((name, "is there already; choose another name with --out or add --overwrite"), ("", "")):
        result = sffr(*command, "--out", tmp_path / place)
        assert result.exit_code == 2 and message in result.stderr and "not installed" not in result.stderr
    assert (tmp_path / name).read_text() == "mine"


def test_a_file_is_replaced_if_asked(finished, tmp_path):
    (tmp_path / "a.npz").write_text("mine")
    assert sffr("export", finished[0], "--out", tmp_path / "a.npz", "--overwrite").exit_code == 0
    assert (tmp_path / "a.npz").read_bytes()[:2] == b"PK"
    (tmp_path / "a.png").write_text("mine")
    assert sffr("curves", finished[0], "--out", tmp_path / "a.png", "--overwrite").exit_code == 0
    assert (tmp_path / "a.png").read_bytes()[1:4] == b"PNG"


def text(name, content):
    """A damage that replaces a file."""
    return lambda folder: (folder / name).write_bytes(content)


def values(name, **changes):
    """A damage that changes keys of a JSON file."""

    def change(folder):
        (folder / name).write_text(json.dumps(json.loads((folder / name).read_text()) | changes))

    return change


def cell(column, value):
    """A damage of the log's last row that was compared."""

    def change(folder):
        lines = [line.split(",") for line in (folder / PROGRESS).read_text().splitlines()]
        lines[-1][lines[0].index(column)] = value
        (folder / PROGRESS).write_text("".join(",".join(line) + "\n" for line in lines))

    return change


DAMAGES = [
    (text(CONFIG, b"{"), CONFIG, "is no valid JSON"),
    (text(CONFIG, b"[]"), CONFIG, "must hold a mapping"),
    (text(CONFIG, b"\xff"), CONFIG, "is not text in UTF-8"),
    (text(CONFIG, b"[" * 100_000), CONFIG, "is nested too deeply"),
    (lambda folder: os.truncate(folder / CONFIG, 10**9), CONFIG, "is too large"),
    (lambda folder: (folder / CONFIG).unlink(), CONFIG, "has a training that has not begun"),
    (values(CONFIG, seed=-1), CONFIG, "seed = -1"),
    (values(CONFIG, seed=10**30), CONFIG, "training takes 0 to"),
    (values(CONFIG, seed="x"), CONFIG, "seed = 'x'"),
    (values(CONFIG, config={}), CONFIG, "algo = None: must be one of"),
    (values(CONFIG, config={"algo": ["ppo"]}), CONFIG, "algo = ['ppo']: must be one of"),
    (values(CONFIG, config={"algo": "ppo", "stps": 1}), CONFIG, "did you mean 'steps'"),
    (values(CONFIG, code=1), CONFIG, "unknown key"),
    (values(CARD, finished=1), CARD, "finished = 1"),
    (values(CARD, kind="benchmark"), "run", "holds a run of sffr benchmark"),
]
OF_RESUME = [(text(MANIFEST, b"x"), MANIFEST, "is no valid JSON"), (text(MANIFEST, b"[]"), MANIFEST, "must hold")]
OF_CURVES = [
    (text(PROGRESS, b""), PROGRESS, "has no column 'steps'"),
    (text(PROGRESS, b"steps,steps\n1,2\n"), PROGRESS, "two columns of the same name"),
    (text(PROGRESS, b"\x89PNG\n"), PROGRESS, "is not text in UTF-8"),
    (text(PROGRESS, b"steps,score/nominal/vibration\n1,0.5\n"), PROGRESS, "has no column 'time/seconds'"),
    (cell("score/nominal/vibration", "x"), PROGRESS, "score/nominal/vibration = 'x': must be a number"),
    (cell("steps", "inf"), PROGRESS, "steps = 'inf': must be finite"),
    (cell("steps", "1,2"), PROGRESS, "entries, has"),
    (lambda folder: (folder / PROGRESS).unlink(), "run", "has not been compared with ahsc yet"),
]


@pytest.mark.parametrize(
    ("command", "damage", "name", "message"),
    [
        pytest.param(command, *damage, id=f"{command[0]}-{damage[1]}-{damage[2]}")
        for command, damages in (
            (["train", "--resume", "--out", "RUN"], DAMAGES + OF_RESUME),
            (["export", "RUN", "--out", "a.npz"], DAMAGES),
            (["curves", "RUN", "--out", "a.png"], DAMAGES + OF_CURVES),
        )
        for damage in damages
    ],
)  # fmt: skip
def test_a_damaged_run_is_told_in_a_line(command, damage, name, message, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    damage(run)
    result = sffr(*[run if part == "RUN" else part for part in command])
    assert result.exit_code == 2
    assert message in result.stderr and name in result.stderr and len(result.stderr.splitlines()) == 1
    assert not (tmp_path / "a.npz").exists() and not (tmp_path / "a.png").exists()


def leave_unfinished(folder, monkeypatch, failure):
    """Train until the second checkpoint is written, where something fails."""
    count = 0

    def fsync(number):
        nonlocal count
        count += 1
        if count == 3:  # the first checkpoint has two files
            raise failure

    with monkeypatch.context() as patch:
        patch.setattr("sffr_agents.checkpoint.os.fsync", fsync)
        train(small("ppo"), 3, folder)


def test_a_full_disk_says_what_is_kept(finished, tmp_path, monkeypatch):
    full = OSError(errno.ENOSPC, "No space left on device", "arrays.npz")
    with pytest.raises(ConfigError, match="No space left on device; the checkpoint after 64 steps is kept"):
        leave_unfinished(tmp_path / "run", monkeypatch, full)
    assert [path.name for path in (tmp_path / "run" / CHECKPOINTS).iterdir()] == ["000001"]
    assert resume(tmp_path / "run") == finished[1]
    with monkeypatch.context() as patch, pytest.raises(ConfigError, match=r"No space left.*no checkpoint has been"):
        patch.setattr("sffr_agents.train.save_checkpoint", lambda *arguments: (_ for _ in ()).throw(full))
        train(small("ppo"), 3, tmp_path / "other")


def test_what_is_trained_again_is_not_finished_until_it_is(run, finished):
    """Its last checkpoint is damaged: one that is killed on the way is no finished training."""

    def stop(done, total, scores):
        raise KeyboardInterrupt

    os.truncate(max((run / CHECKPOINTS).iterdir()) / "state.json", 10)
    with pytest.warns(UserWarning, match="is taken"), pytest.raises(KeyboardInterrupt):
        resume(run, stop)
    assert json.loads((run / CARD).read_text())["finished"] is False
    with pytest.warns(UserWarning, match="is taken"):
        assert resume(run) == finished[1]
    assert json.loads((run / CARD).read_text())["finished"] is True


def test_what_is_finished_is_not_trained_or_compared_again(run, finished, monkeypatch):
    monkeypatch.delattr("sffr_agents.train.Validator")
    before = {path: path.stat().st_mtime_ns for path in run.rglob("*") if path.is_file() and path.name != LOCK}
    assert resume(run) == finished[1]
    assert {path: path.stat().st_mtime_ns for path in before} == before


def test_a_disk_that_fails_is_told_whatever_else_is_gone(tmp_path, monkeypatch):
    """The error that ended the checkpoint, not the one of clearing up after it."""
    trained = make_model(small("ppo"), seed=0)

    def fail(*arguments, **named):
        shutil.rmtree(tmp_path / CHECKPOINTS)
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr("sffr_agents.checkpoint.np.savez", fail)
    with pytest.raises(OSError, match="Input/output error"):
        save_checkpoint(tmp_path / CHECKPOINTS, *trained, Notes(), keep=1)


def test_a_training_that_diverges_says_so(tmp_path):
    """And not that some distribution of torch has a parameter of the wrong kind."""
    models = []

    def spoil(done, total, scores):
        if done > 100:
            with torch.no_grad():
                for weights in models[0].policy.parameters():
                    weights.fill_(np.nan)

    def make(*arguments):
        models.append(original(*arguments)[0])
        return models[0], models[0].env

    from sffr_agents import train as module

    original = module.make_model
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "make_model", make)
        with pytest.raises(ConfigError, match=r"has diverged after .* lower .*; the checkpoint after"):
            train(small("ppo"), 3, tmp_path, spoil)


def test_the_log_of_a_damaged_row_stops_the_resumption(tmp_path, monkeypatch):
    """Its rows would be lost; one that was cut off at the end would not."""
    with pytest.raises(ConfigError, match="kept"):
        leave_unfinished(tmp_path, monkeypatch, OSError(errno.EIO, "Input/output error"))
    lines = (tmp_path / PROGRESS).read_text()
    (tmp_path / PROGRESS).write_text(lines.replace("\n", "\nx", 1))
    with pytest.raises(ConfigError, match=r"progress\.csv: steps = 'x"):
        resume(tmp_path)
    (tmp_path / PROGRESS).write_text(lines + "12")
    resume(tmp_path)
