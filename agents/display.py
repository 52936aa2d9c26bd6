"""What the terminal shows while a command runs: that it compiles, how far it is, what it does."""

from __future__ import annotations

import threading
import time
from types import TracebackType
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

from sffr_gym._jit import is_compiled
from verification import Check

COMPILING = "compiling the simulator for this machine, about a minute, once"


class EvaluationDisplay:
    """Shows of an evaluation that it compiles, and a progress bar where it takes longer than two seconds.

    A context manager, and the ``progress`` of :func:`agents.evaluate.evaluate`.
    """

    PATIENCE = 2.0  # s before a bar is worth showing
    SILENCE = 5.0  # s without a sign of life that nothing but compiling takes

    def __init__(self, console: Console) -> None:
        self._console = console
        self._started: dict[str, float] = {}  # policy: when it was first heard of
        self._timer: threading.Timer | None = None
        self._announced = False
        self._first_move: float | None = None
        self._bar = Progress(
            TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:.0f} %"), TimeElapsedColumn(),
            TextColumn("elapsed,"), TimeRemainingColumn(), TextColumn("remaining"), console=console, transient=True,
        )  # fmt: skip
        self._task = self._bar.add_task("")

    def __enter__(self) -> Self:
        """Nothing to show yet."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Clear the terminal of the bar."""
        self._stop_waiting(completed=error is None)
        if self._bar.live.is_started:  # else it would leave an empty line
            self._bar.stop()

    def __call__(self, policy: str, done: int, total: int) -> None:
        """Report; see ``evaluate.Report``."""
        if policy not in self._started:
            self._wait(policy)
            return
        if total == 0 or done == 0:
            return
        self._stop_waiting()
        now = time.perf_counter()
        if self._first_move is None:
            self._first_move = now
            self._bar.reset(self._task)  # time that went into compiling tells nothing of what remains
        if now - self._first_move > self.PATIENCE and done < total:
            self._bar.start()
        self._bar.update(self._task, description=policy, completed=done, total=total)

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
        self._announced = True
        self._console.print(COMPILING)

    def _stop_waiting(self, completed: bool = True) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._announced and completed:
            self._console.print(f"compiled in {time.perf_counter() - list(self._started.values())[-1]:.0f} s")
        self._announced = False


class CompilingBar:
    """A progress bar below a word on the compilation, if there is one to come; a context manager.

    Args:
        console: of the command; without a terminal there is no bar.
        columns: of the bar.
    """

    def __init__(self, console: Console, *columns: ProgressColumn) -> None:
        self._console = console
        self._bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)

    def __enter__(self) -> Self:
        """Start the clock; say so if the simulator has to be compiled first."""
        if not is_compiled():
            self._console.print(COMPILING)
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Clear the terminal of the bar."""
        self._bar.stop()


class CheckDisplay(CompilingBar):
    """Shows of a verification which check runs and for how long; on a terminal a bar, elsewhere a line for each.

    A context manager; ``begin`` is the ``progress`` of :func:`verification.run_checks`.
    """

    def __init__(self, console: Console) -> None:
        super().__init__(
            console, TextColumn("{task.description}"), BarColumn(20), MofNCompleteColumn(), TimeElapsedColumn()
        )
        self._task = self._bar.add_task("")

    def begin(self, what: str, done: int, total: int) -> None:
        """Show what runs now."""
        self._bar.update(self._task, description=escape(what), completed=done, total=total)

    def end(self, check: Check) -> None:
        """Note the outcome of a check: a failure at once, all else where there is no bar."""
        if self._console.is_terminal and check.passed:
            return
        mark = "pass" if check.passed else "FAIL"
        style = None if check.passed else "red"
        against = f", against {check.against}" if check.against else ""
        self._console.print(
            f"{mark} {check.seconds:5.1f} s  {check.name}{against}", style=style, markup=False, soft_wrap=True
        )
