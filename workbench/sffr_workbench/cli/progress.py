"""What the terminal shows while a command runs: that it compiles, how far it is, what it does."""

from __future__ import annotations

import threading
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

from sffr_gym.compile.cache import is_compiled

COMPILING = "compiling the simulator for this machine, one to two minutes, once"


def time_left() -> tuple[ProgressColumn, ...]:
    """Return columns of the time that remains, beside the one that has elapsed."""
    return TextColumn("elapsed,"), TimeRemainingColumn(), TextColumn("remaining")


class ProgressBar:
    """A bar on a terminal, elsewhere nothing, after a line on the compilation if there is one to come.

    A context manager and a :data:`sffr_workbench.common.Progress`.

    Args:
        console: of the command.
        columns: behind those of what is done, the bar, how much of it is done, and the time since the start.
        counted: how much is done and how much there is in numbers; False for per cent.
    """

    def __init__(self, console: Console, *columns: ProgressColumn, counted: bool = True) -> None:
        done = MofNCompleteColumn() if counted else TextColumn("{task.percentage:.0f} %")
        self._console = console
        self._bar = Progress(
            TextColumn("{task.description}"), BarColumn(20), done, TimeElapsedColumn(), *columns, console=console,
            transient=True, disable=not console.is_terminal,
        )  # fmt: skip
        self._task = self._bar.add_task("", start=False)

    def __enter__(self) -> Self:
        """Start the clock; say so if the simulator has to be compiled first."""
        if not is_compiled():
            self._console.print(COMPILING)
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
    """The progress of policies, each of which may have to be compiled; a bar where it takes longer than two seconds."""

    PATIENCE = 2.0  # s before a bar is worth showing
    SILENCE = 5.0  # s without a sign of life that nothing but compiling takes

    def __init__(self, console: Console) -> None:
        super().__init__(console, *time_left(), counted=False)
        self._started: dict[str, float] = {}  # policy: when it was first heard of
        self._timer: threading.Timer | None = None
        self._announced = False
        self._first_move: float | None = None

    def __enter__(self) -> Self:
        """Show nothing yet."""
        return self

    def __exit__(self, *error: object) -> None:
        """Clear the terminal of the bar."""
        self._stop_waiting(completed=error[0] is None)
        if self._bar.live.is_started:  # else it would leave an empty line
            super().__exit__(*error)

    def __call__(self, what: str, done: int, total: int) -> None:
        """Show how far the policy ``what`` is; the first call for each says that it begins."""
        if what not in self._started:
            self._wait(what)
            return
        if total == 0 or done == 0:
            return
        self._stop_waiting()
        now = time.perf_counter()
        if self._first_move is None:
            self._first_move = now  # the clock starts here: time of compiling tells nothing of what remains
        if now - self._first_move > self.PATIENCE and done < total:
            self._bar.start()
        super().__call__(what, done, total)

    def _wait(self, policy: str) -> None:
        """Announce a compilation: at once on a first run, else if a new policy gives no sign of life for a while.

        That some kernels are in the cache does not mean that those of this policy are.
        """
        self._stop_waiting()
        first = not self._started
        self._started[policy] = time.perf_counter()
        if first and not is_compiled():
            self._announce()
            return
        self._timer = threading.Timer(self.SILENCE, self._announce)
        self._timer.daemon = True
        self._timer.start()

    def _announce(self) -> None:
        """Say that the simulator is compiled."""
        self._announced = True
        self._console.print(COMPILING)

    def _stop_waiting(self, completed: bool = True) -> None:
        """Say how long the announced compilation took, if it is completed."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._announced and completed:
            self._console.print(f"compiled in {time.perf_counter() - list(self._started.values())[-1]:.0f} s")
        self._announced = False
