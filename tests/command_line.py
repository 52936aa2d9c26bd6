"""The command line as a user sees it: a wide terminal, and never a traceback."""

import functools
import sys

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from sffr_workbench.cli import app as cli

made_once = functools.cache(get_command)  # all commands with all their options, which takes longer than most commands


def sffr(*arguments):
    """Run the command and check that no traceback reaches the user."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "200")
        patch.setenv("TERM", "dumb")
        patch.setattr("typer.testing._get_command", made_once)
        patch.setattr(sys, "argv", ["/somewhere/bin/sffr", *map(str, arguments)])
        result = CliRunner().invoke(cli.app, list(map(str, arguments)), prog_name="sffr")
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert "Traceback" not in result.output
    return result
