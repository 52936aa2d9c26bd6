"""How long work tells how far it is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Progress = Callable[[str, int, int], Any]  # what is being done, how much of it is done, and how much there is


def ignore(what: str, done: int, total: int) -> None:
    """Show no progress."""
