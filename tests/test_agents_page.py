"""The examples of docs/agents.md run, and its commands are there."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from sffr_workbench.cli.app import app

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "agents.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
COMMANDS = sorted({command for command in re.findall(r"^sffr (\S+)", PAGE, re.MULTILINE)})


def test_page_has_examples():
    assert len(EXAMPLES) >= 2 and {"train", "tune", "evaluate"} <= set(COMMANDS)


@pytest.mark.parametrize("code", EXAMPLES)
def test_example_runs(code, tmp_path):
    run = [sys.executable, "-W", "error", "-c", code]
    done = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("command", COMMANDS)
def test_command_is_there(command):
    assert CliRunner().invoke(app, [command, "--help"]).exit_code == 0
