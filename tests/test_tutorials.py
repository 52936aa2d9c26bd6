"""Tutorials and other people's robots: each runs as it stands, is linearised, and leaves its histories."""

import json
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from command_line import sffr

from sffr_gym import Simulator, load_params

ROOT = Path(__file__).parents[1]
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.py"))
ROBOTS = sorted((ROOT / "tests" / "robots").glob("*.yaml"))
FOUND = ["ets7-one-panel", "spacerobotenv-dual-arm", "tohoku-debris-dual-arm"]  # joint angles left out below
UNSTABLE = ["four-panels-slanted-arms"]  # six elements each: modes too fast for the sampled damping


def test_there_are_tutorials_and_robots():
    named = {"first_law", "lqr_gain", "mpc", "own_robot", "shaped_slew", "tight_limits"}
    assert {file.stem for file in TUTORIALS} >= named
    assert len(ROBOTS) >= 6


@pytest.mark.slow
@pytest.mark.parametrize("file", TUTORIALS, ids=lambda file: file.stem)
def test_tutorial_runs_and_holds_what_it_says(file, tmp_path):
    """Each checks its own claim by an assertion at its end."""
    lines = file.read_text(encoding="utf-8").splitlines()
    assert len(lines) < 60
    assert lines[-1].strip().startswith("assert")
    done = subprocess.run([sys.executable, "-W", "error", file], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "nan" not in done.stdout
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("file", TUTORIALS, ids=lambda file: file.stem)
def test_tutorial_is_listed(file):
    assert file.name in (ROOT / "docs" / "control.md").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("file", ROBOTS, ids=lambda file: file.stem)
def test_robot_of_others_runs_is_linearised_and_exported(file, tmp_path):
    more = ["--set", "initial.q=[0, 0, 0]", "--set", "initial.reach=auto", "--set", "initial.qd=null"]
    more = more if file.stem in FOUND else []
    plant = Simulator(load_params(file).with_overrides(*more[1::2]))
    model, state = plant.linearize(), plant.initial_state()
    assert plant.constraint_drift(state) < 1e-12
    assert model.error < 1e-8 and abs(model.drift).max() < 1e-10
    matrices, run = tmp_path / "model.npz", tmp_path / "run"
    (tmp_path / "short.yaml").write_text("{name: short, description: short, duration: 0.5}")
    assert sffr("linearize", "--params", file, *more, "-o", matrices).exit_code == 0
    np.testing.assert_array_equal(np.load(matrices)["A"], model.A)
    options = "--params", file, *more, "-s", tmp_path / "short.yaml", "--no-figures", "-o", run
    told = (
        pytest.warns(UserWarning, match="hsc is unstable on its own robot") if file.stem in UNSTABLE else nullcontext()
    )
    with told:
        result = sffr("evaluate", "none", "hsc", *options)
    assert result.exit_code == 0, result.output
    assert sffr("export-run", run, "--policy", "none", "-o", tmp_path / "out").exit_code == 0
    columns = json.loads((tmp_path / "out" / "schema.json").read_text())["columns"]
    names = {each["name"] for each in columns}
    assert {label.name for label in (*model.states, *model.inputs)} <= names
    (table,) = (tmp_path / "out").glob("none-*.csv")
    assert len(table.read_text().splitlines()) > 2
