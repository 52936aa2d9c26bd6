"""The command line within a worker: what it is given, and what may come of it."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Collection
from pathlib import Path
from unittest import mock

import yaml
from click.testing import Result
from trial import REFUSED, WORKED, Violation, check_refusal
from typer.testing import CliRunner

from sffr_workbench.cli.app import app

WRONG = 2  # exit code of a user's error


def invoke(*arguments: object) -> Result:
    """Run the command in this process."""
    typed = list(map(str, arguments))
    with mock.patch.object(sys, "argv", ["sffr", *typed]):
        return CliRunner().invoke(app, typed, prog_name="sffr")


def failure(command: str, result: Result) -> str:
    """Return what went wrong that no user should see; empty if nothing did."""
    error = result.exception
    if error is None or isinstance(error, SystemExit):
        return ""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "site-packages" not in frame.filename and "hostile/" not in frame.filename]
    trace = "".join(f"{Path(frame.filename).name}:{frame.lineno} {frame.name}: " for frame in (own or frames)[:-4:-1])
    return f"{command}: {trace}{type(error).__name__}: {error}"


def sffr(*arguments: object, places: Collection[str] = ()) -> str:
    """Run the command in this process and judge its end.

    Args:
        arguments: of the command.
        places: what an error may name, one of them in each line.

    Returns:
        WORKED or REFUSED.

    Raises:
        Violation: for any other end than success or an error in lines.
    """
    result = invoke(*arguments)
    if found := failure(str(arguments[0]), result):
        raise Violation(found)
    if result.exit_code == 0:
        return WORKED
    if result.exit_code != WRONG:
        raise Violation(f"{arguments[0]}: exit code {result.exit_code}: {result.stderr[-300:]}")
    check_refusal(result.stderr, places, prefix="error: ")
    return REFUSED


def write_scenario(folder: Path, name: str = "short", **keys: object) -> Path:
    """Write a scenario of half a second, or of other keys, and return its file."""
    file = folder / f"{name}.yaml"
    file.write_text(yaml.safe_dump({"name": name, "description": "a test's", "duration": 0.5} | keys))
    return file
