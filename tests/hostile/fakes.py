"""A product that does everything wrong, to see that the harness notices."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

from hypothesis import strategies as st
from trial import REFUSED, WORKED, Trial, check_refusal, check_unchanged, fingerprint


def work(folder: Path) -> str:
    """Do what is right."""
    return WORKED


def refuse(folder: Path) -> str:
    """Refuse as one should."""
    check_refusal(f"{folder}/a.yaml:1: base.mass = -1: must be greater than 0", [f"{folder}"])
    return REFUSED


def two_lines(folder: Path) -> str:
    """Refuse by a line more than one that names the place."""
    check_refusal(f"{folder}/a.yaml:1: is wrong\nsee the manual", [f"{folder}"])
    return REFUSED


def steer(folder: Path) -> str:
    """Refuse by what clears the reader's screen."""
    check_refusal(f"{folder}/a.yaml:1: \x1b[2J is no number", [f"{folder}"])
    return REFUSED


def say_nothing(folder: Path) -> str:
    """Refuse without a word."""
    check_refusal("\n", [f"{folder}"])
    return REFUSED


def remove(folder: Path) -> str:
    """Remove a file of somebody else."""
    before = fingerprint(folder)
    (folder / "outside.txt").unlink()
    check_unchanged(before, fingerprint(folder), "files of others")
    return WORKED


def trace(folder: Path) -> str:
    """Let an error through."""
    raise KeyError("mass")


def leave(folder: Path) -> str:
    """End the process."""
    raise SystemExit(0)


def die(folder: Path) -> str:
    """Crash as compiled code does."""
    os.kill(os.getpid(), signal.SIGSEGV)
    return WORKED


def hang(folder: Path) -> str:
    """Wait forever."""
    time.sleep(3600.0)
    return WORKED


def spin(folder: Path) -> str:
    """Work forever."""
    while True:
        pass


def grow(folder: Path) -> str:
    """Take much memory for a moment."""
    return WORKED if b"\1" * 3 * 10**8 else REFUSED


RIGHT: dict[str, Callable[[Path], str]] = {"work": work, "refuse": refuse}
WRONG: dict[str, tuple[Callable[[Path], str], str]] = {
    "two lines": (two_lines, "refused without naming"),
    "steer": (steer, "steers the terminal"),
    "say nothing": (say_nothing, "without a word"),
    "remove": (remove, "removed files of others: outside.txt"),
    "trace": (trace, "KeyError: 'mass'"),
    "leave": (leave, "SystemExit"),
    "die": (die, "SIGSEGV"),
    "hang": (hang, "hangs for more than"),
    "spin": (spin, "hangs for more than"),
    "grow": (grow, "took"),
}


class Fakes:
    """What is right and what is wrong."""

    name = "fakes"
    most_seconds, most_memory = 1.0, 1e8

    def make_exemplars(self, folder: Path) -> None:
        """None are needed."""

    def load(self, folder: Path) -> None:
        """Nothing is to be compiled."""

    def trials(self) -> st.SearchStrategy[Trial]:
        """Draw any."""
        names = [*RIGHT, *WRONG]
        drawn = st.integers(0, 10**9).map(
            lambda number: names[number % len(names)]
        )  # of twelve there would be one each
        return drawn.map(lambda name: Trial(name, name, {"outside.txt": b"mine"}))

    def attempt(self, trial: Trial, folder: Path) -> tuple[str, dict[str, int]]:
        """Do it."""
        act = RIGHT[trial.target] if trial.target in RIGHT else WRONG[trial.target][0]
        return act(folder), {trial.target: 1}
