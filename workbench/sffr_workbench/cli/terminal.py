"""What all commands do alike: errors of the user's input, consoles, the command as typed, names of run folders."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

import typer
from rich.console import Console

from sffr_gym import ConfigError
from sffr_workbench.cli.encoding import spell_out
from sffr_workbench.figures import load_matplotlib


@contextmanager
def user_errors() -> Iterator[None]:
    """Turn errors of the user's input into lines on stderr and exit code 2; anything else keeps its traceback."""
    try:
        yield
    except (ConfigError, OSError) as error:
        spell_out()
        console = Console(stderr=True, highlight=False)
        for line in str(error).splitlines():
            console.print(f"error: {line}", style="red", markup=False, soft_wrap=True)
        raise typer.Exit(2) from None


@contextmanager
def interruptible(notes: Console, advice: str) -> Iterator[None]:
    """Turn an interrupt into a line that says how to go on, and exit code 130."""
    try:
        yield
    except KeyboardInterrupt:
        notes.print(f"interrupted; {advice}", markup=False, soft_wrap=True)
        raise typer.Exit(130) from None


def consoles(quiet: bool = False) -> tuple[Console, Console]:
    """Return the consoles of notes, on stderr, and of results, on stdout."""
    spell_out()
    return Console(stderr=True, quiet=quiet, highlight=False), Console(quiet=quiet, highlight=False)


def can_draw(notes: Console) -> bool:
    """Return whether matplotlib can be used; if not, note that there are no figures, and why."""
    try:
        load_matplotlib()
    except ConfigError as error:
        notes.print(f"note: no figures; {error}", markup=False, soft_wrap=True)
        return False
    return True


def typed_command() -> list[str]:
    """Return the command line as typed."""
    return ["sffr", *sys.argv[1:]]


def dated_folder(name: str) -> Path:
    """Return the run folder ``runs/<name>-<date-time>``."""
    return Path("runs") / f"{name}-{datetime.now():%Y%m%d-%H%M%S}"
