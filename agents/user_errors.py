"""Faults of the user's input, shown as lines instead of tracebacks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import typer
from rich.console import Console

from sffr_gym import ConfigError


@contextmanager
def user_errors() -> Iterator[None]:
    """Turn faults of the user's input into a line on stderr and exit code 2; anything else keeps its traceback."""
    try:
        yield
    except (ConfigError, OSError) as error:
        console = Console(stderr=True, highlight=False)
        for line in str(error).splitlines():
            console.print(f"error: {line}", style="red", markup=False, soft_wrap=True)
        raise typer.Exit(2) from None
