"""The command ``sffr new``: files to start from."""

from __future__ import annotations

from enum import StrEnum
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import typer

from sffr_gym import ConfigError
from sffr_gym.config.files import check_target, write_whole
from sffr_workbench.cli.options import Overwrite, argument
from sffr_workbench.cli.terminal import consoles

TEMPLATE, NAME = "law_template.py", "mine.py"  # file of this package, and what it calls itself


class Kind(StrEnum):
    """What there is a start for."""

    LAW = "law"


def add_commands(app: typer.Typer) -> None:
    """Add the command of this module to the command line."""
    app.command("new", no_args_is_help=True)(new_command)


def new_command(
    kind: Annotated[Kind, argument("law", "What to begin: a control law of your own.", False)],
    file: Annotated[Path, argument("FILE", "Where to write it, such as mine.py.", False)],
    overwrite: Overwrite = False,
) -> None:
    """Write a commented start that runs: sffr new law mine.py, then sffr evaluate mine.py:MyLaw ahsc."""
    _, results = consoles()
    if file.suffix != ".py":
        raise ConfigError(f"{file}: a {kind} is a Python file; name one that ends in .py")
    check_target(file, overwrite)
    text = files(__package__).joinpath(TEMPLATE).read_text(encoding="utf-8")
    write_whole(file, text.replace(NAME, str(file)).encode())
    results.print(f"{file}: run it with sffr evaluate {file}:MyLaw ahsc", markup=False, soft_wrap=True)
