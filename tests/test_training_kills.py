"""Trainings and searches that are killed at random moments end as if nothing had happened."""

import csv
import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from small_training import PPO_SMALL

from sffr_agents.folder import BEST, CHECKPOINTS, LAST, PROGRESS, SECONDS, TENSORBOARD
from sffr_agents.progress import read_progress
from sffr_agents.tune import BEST_CONFIG, TRAININGS, TRIALS
from sffr_gym.config.run_folder import CARD

ROOT = Path(__file__).parents[1]
KILLS = 5
OFTEN = ["checkpoints.every=16", "validation.every=48"]
pytestmark = pytest.mark.slow


def start(arguments, folder):
    """A command in a group of processes of its own."""
    command = [sys.executable, "-m", "sffr_workbench.cli.main", *map(str, arguments), "--out", str(folder)]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True)


def finish(process):
    output = process.communicate(timeout=300)[0].decode()
    assert process.returncode == 0, output


def files(folder):
    """The names of all files but TensorBoard's, of which each process writes one."""
    return {
        str(path.relative_to(folder)): path.stat().st_mtime_ns
        for path in folder.rglob("*")
        if path.is_file() and TENSORBOARD not in path.parts
    }


def kill(process, folder, rng, number):
    """Kill a command at a random moment after it began to write, and all that it has started."""
    before = files(folder)
    while process.poll() is None and files(folder) == before:
        time.sleep(0.005)
    time.sleep(rng.uniform(0.0, 0.7))
    if process.poll() is None:
        process.send_signal((signal.SIGKILL, signal.SIGTERM)[number % 2])
    process.communicate(timeout=60)
    with pytest.raises(ProcessLookupError):
        for _ in range(100):  # git, which says of what commit the code is, ends by itself
            os.killpg(process.pid, 0)
            time.sleep(0.05)


def assert_same_training(whole, killed):
    for name in (BEST, LAST):
        assert (whole / name).read_bytes() == (killed / name).read_bytes(), name
    first, second = (
        [row | {SECONDS: ""} for row in read_progress(folder / PROGRESS)] for folder in (whole, killed)
    )  # fmt: skip
    assert first == second


def test_killed_training_ends_as_if_nothing_had_happened(tmp_path):
    changes = [*PPO_SMALL, *OFTEN, "steps=6000"]
    begin = ["train", "--seed", "3", *(part for change in changes for part in ("--set", change))]
    finish(start(begin, tmp_path / "whole"))
    rng, progress = random.Random(0), []
    for number in range(KILLS):
        arguments = ["train", "--resume"] if (tmp_path / "killed" / "train.json").exists() else begin
        kill(start(arguments, tmp_path / "killed"), tmp_path / "killed", rng, number)
        progress.append(max((path.name for path in (tmp_path / "killed" / CHECKPOINTS).glob("0*")), default=""))
    assert not json.loads((tmp_path / "killed" / CARD).read_text())["finished"]
    assert len(set(progress)) > 2, progress  # some got further than others
    finish(start(["train", "--resume"], tmp_path / "killed"))
    assert_same_training(tmp_path / "whole", tmp_path / "killed")
    assert files(tmp_path / "whole").keys() == files(tmp_path / "killed").keys()


def test_killed_search_ends_as_if_nothing_had_happened(tmp_path):
    changes = [*PPO_SMALL, *OFTEN, "steps=1000"]
    space = "[{key: learning.gamma, low: 0.9, high: 0.99}, {key: learning.n_epochs, low: 1, high: 3}]"
    search = tmp_path / "search.yaml"
    search.write_text(f"train: ppo\nset: {changes}\nseeds: 2\ntrials: 3\nspace: {space}\n")
    rng = random.Random(1)
    for name in ("whole", "killed"):
        folder = tmp_path / name / "run"
        for number in range(KILLS if name == "killed" else 0):
            kill(start(["tune", search], folder), folder, rng, number)
        finish(start(["tune", search], folder))
    whole, killed = tmp_path / "whole" / "run", tmp_path / "killed" / "run"
    for name in (TRIALS, BEST_CONFIG):
        assert (whole / name).read_text() == (killed / name).read_text()
    with (whole / TRIALS).open(newline="") as text:
        assert len(list(csv.DictReader(text))) == 3
    for training in (whole / TRAININGS).iterdir():
        assert_same_training(training, killed / TRAININGS / training.name)
    assert files(whole).keys() == files(killed).keys()
