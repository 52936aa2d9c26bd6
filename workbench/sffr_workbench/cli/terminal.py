"""What all commands do alike: errors of the user's input, signals, consoles, the command as typed, names of folders."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any, NoReturn

import typer
from gymnasium.error import DependencyNotInstalled
from pydantic import ValidationError
from rich.console import Console
from typer.core import TyperGroup

from sffr_gym import ConfigError
from sffr_workbench.cli.encoding import spell_out
from sffr_workbench.figures import load_matplotlib

USER_ERRORS = (ConfigError, OSError, MemoryError, UnicodeError, ValidationError, DependencyNotInstalled)
LONGEST_NAME = 100  # characters of a scenario's name in that of a folder


class Terminated(KeyboardInterrupt):
    """SIGTERM came; whatever cleans up after an interrupt does so after this."""


class Commands(TyperGroup):
    """The commands, none of which meets a user's input with a traceback."""

    def invoke(self, ctx: Any) -> Any:
        """Run a command."""
        with user_errors():
            return super().invoke(ctx)


@contextmanager
def user_errors() -> Iterator[None]:
    """Turn errors of the user's input into lines on stderr and exit code 2; anything else keeps its traceback."""
    try:
        yield
    except BrokenPipeError:
        raise  # whoever read our output has gone, which typer knows how to end
    except USER_ERRORS as error:
        spell_out()
        console = Console(stderr=True, highlight=False)
        for line in _explain(error).split("\n"):
            text = "".join(each if each.isprintable() else repr(each)[1:-1] for each in line)
            console.print(f"error: {text}", style="red", markup=False, soft_wrap=True)
        raise typer.Exit(2) from None


@contextmanager
def interruptible(notes: Console, advice: str) -> Iterator[None]:
    """Turn an interrupt, or SIGTERM, into a line that says how to go on, and exit code 130, or 143."""
    with _sigterm_raises():
        try:
            yield
        except KeyboardInterrupt as cause:
            notes.print(f"interrupted; {advice}", markup=False, soft_wrap=True)
            raise typer.Exit(143 if isinstance(cause, Terminated) else 130) from None


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
    return Path("runs") / f"{name[:LONGEST_NAME]}-{datetime.now():%Y%m%d-%H%M%S}"


def _explain(error: BaseException) -> str:
    """Return what is wrong, a line for each thing."""
    text = str(error)
    if isinstance(error, ValidationError):
        return "\n".join(f"{'.'.join(map(str, each['loc']))}: {each['msg']}" for each in error.errors())
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, MemoryError):
        return f"not enough memory{f': {text}' if text else ''}"
    return text or type(error).__name__


@contextmanager
def _sigterm_raises() -> Iterator[None]:
    """Let SIGTERM raise :class:`Terminated`, in the main thread, as an interrupt raises KeyboardInterrupt."""

    def terminate(number: int, frame: object) -> NoReturn:
        raise Terminated

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
