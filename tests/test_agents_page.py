"""The examples of docs/agents.md run, and its commands are there."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from agents.cli import app
from agents.learned import LearnedSchedule, Network, save_schedule
from agents.residual_env import SFFRFlexDampingEnv

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "agents.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
COMMANDS = sorted({command for command in re.findall(r"^sffr (\S+)", PAGE, re.MULTILINE)})


def test_page_has_examples():
    assert len(EXAMPLES) >= 2 and {"train", "tune", "evaluate"} <= set(COMMANDS)


@pytest.mark.parametrize("code", EXAMPLES)
def test_example_runs(code, tmp_path):
    network = Network((np.zeros((2, 7)),), (np.zeros(2),), relu=False, squash=False)
    save_schedule(tmp_path / "policy.npz", LearnedSchedule.of(network, SFFRFlexDampingEnv(), {}))
    run = [sys.executable, "-W", "error", "-c", code.replace('"POLICY"', '"policy.npz"')]
    done = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, env={"PYTHONPATH": str(ROOT)})
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("command", COMMANDS)
def test_command_is_there(command):
    assert CliRunner().invoke(app, [command, "--help"]).exit_code == 0
