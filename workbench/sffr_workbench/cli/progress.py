"""What the terminal shows while a command runs: how far it is, and what it does."""

from __future__ import annotations

import time
from typing import Self

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)


def time_left() -> tuple[ProgressColumn, ...]:
    """Return columns of the time that remains, beside the one that has elapsed."""
    return TextColumn("elapsed,"), TimeRemainingColumn(), TextColumn("remaining")


class ProgressBar:
    """A bar on a terminal, elsewhere nothing.

    A context manager and a :data:`sffr_workbench.common.Progress`.

    Args:
        console: of the command.
        columns: behind those of what is done, the bar, how much of it is done, and the time since the start.
        counted: how much is done and how much there is in numbers; False for per cent.
    """

    def __init__(self, console: Console, *columns: ProgressColumn, counted: bool = True) -> None:
        done = MofNCompleteColumn() if counted else TextColumn("{task.percentage:.0f} %")
        self._bar = Progress(
            TextColumn("{task.description}"), BarColumn(20), done, TimeElapsedColumn(), *columns, console=console,
            transient=True, disable=not console.is_terminal,
        )  # fmt: skip
        self._task = self._bar.add_task("", start=False)

    def __enter__(self) -> Self:
        """Start the clock."""
        self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        """Clear the terminal of the bar."""
        self._bar.stop()

    def __call__(self, what: str, done: int, total: int) -> None:
        """Show what is being done and how far it is."""
        self._bar.start_task(self._task)
        self._bar.update(self._task, description=escape(what), completed=done, total=total)

    @property
    def speed(self) -> float | None:
        """How much is done in a second; None before that is known."""
        return self._bar.tasks[0].speed


class EvaluationProgress(ProgressBar):
    """The progress of policies; a bar where it takes longer than two seconds."""

    PATIENCE = 2.0  # s before a bar is worth showing

    def __init__(self, console: Console) -> None:
        super().__init__(console, *time_left(), counted=False)
        self._first_move: float | None = None

    def __enter__(self) -> Self:
        """Show nothing yet."""
        return self

    def __exit__(self, *error: object) -> None:
        """Clear the terminal of the bar."""
        if self._bar.live.is_started:  # else it would leave an empty line
            super().__exit__(*error)

    def __call__(self, what: str, done: int, total: int) -> None:
        """Show how far the policy ``what`` is."""
        if total == 0 or done == 0:
            return
        now = time.perf_counter()
        if self._first_move is None:
            self._first_move = now
        if now - self._first_move > self.PATIENCE and done < total:
            self._bar.start()
        super().__call__(what, done, total)
