"""Commands of the command line as processes that are stopped at random moments: nothing of them may stay behind."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

from sffr_gym.config.run_folder import CARD, LOCK

PATIENCE = 900.0  # s, for a command that needs seconds, on a machine that does much else
LINGERING = 30.0  # s in which processes have to be gone; they look every 0.25 s


@dataclass
class Command:
    """A command in a folder of its own, in a process group of its own."""

    process: subprocess.Popen[str]
    folder: Path

    def wait_until(self, alive: Callable[[Path], bool]) -> bool:
        """Wait for a sign of life in the folder; return whether the command still runs then."""
        end = time.monotonic() + PATIENCE
        while self.process.poll() is None and not alive(self.folder):
            assert time.monotonic() < end, "no sign of life"
            time.sleep(0.002)
        return self.process.poll() is None

    def stop(self, number: int) -> tuple[int, str]:
        """Send a signal to the command alone, not to its workers; return exit code and stderr when all are gone."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.end()

    def end(self) -> tuple[int, str]:
        """Return exit code and stderr of the command when no process of its group is left."""
        _, errors = self.process.communicate(timeout=PATIENCE)
        end = time.monotonic() + LINGERING
        while left := members(self.process.pid):
            assert time.monotonic() < end, f"left behind: {[' '.join(each.cmdline())[:200] for each in left]}"
            time.sleep(0.05)
        return self.process.returncode, errors


@contextmanager
def started(folder: Path, *arguments: object, **options: Any) -> Iterator[Command]:
    """Start ``sffr`` in a folder, which is made if need be; whatever is left of it in the end is killed."""
    folder.mkdir(parents=True, exist_ok=True)
    process = subprocess.Popen(
        [sys.executable, "-m", "sffr_workbench.cli.main", *map(str, arguments)], cwd=folder, text=True,
        stderr=subprocess.PIPE, start_new_session=True,
        **{
            "stdout": subprocess.DEVNULL,
            "preexec_fn": lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # jobs in the background ignore it
        } | options,
    )  # fmt: skip
    try:
        yield Command(process, folder)
    finally:
        for each in members(process.pid):
            each.kill()
        process.wait()
        for stream in process.stdout, process.stderr:
            if stream is not None:
                stream.close()


def run_whole(folder: Path, *arguments: object) -> tuple[int, str]:
    """Run a command to its end; return exit code and stderr."""
    with started(folder, *arguments) as command:
        return command.end()


def members(group: int) -> list[psutil.Process]:
    """Return the living processes of a group."""
    found = []
    for process in psutil.process_iter():
        try:
            if os.getpgid(process.pid) == group and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
        except (ProcessLookupError, psutil.NoSuchProcess):
            continue
    return found


def has_card(folder: Path) -> bool:
    """Say whether a command has taken its folder ``run``: what it does from then on may be interrupted."""
    return (folder / "run" / CARD).exists()


def kill_at_random(
    folder: Path,
    arguments: Sequence[object],
    outcome: Callable[[Path], Any],
    kills: int,
    seed: int,
    alive: Callable[[Path], bool] = has_card,
    prepare: Callable[[Path], Any] = lambda folder: None,
    check: Callable[[Path], Any] = lambda folder: None,
) -> None:
    """Kill a command at random moments of its life, run it again, and compare what it leaves with an undisturbed run.

    Args:
        folder: for a folder of each try, in which the command runs.
        arguments: of the command; files are named relative to a try's folder, so that all tries say the same.
        outcome: what is compared, of a try's folder.
        kills: how many tries.
        seed: of the random moments.
        alive: tells a command's first sign of life.
        prepare: makes a try's folder ready.
        check: looks at a try's folder between kill and second run.
    """
    rng, whole = random.Random(seed), folder / "whole"
    whole.mkdir(parents=True)
    prepare(whole)
    with started(whole, *arguments) as command:
        command.wait_until(alive)
        begun = time.monotonic()
        code, errors = command.end()
        seconds = time.monotonic() - begun
    assert code == 0, errors
    expected, running = outcome(whole), 0
    for k in range(kills):
        own = folder / str(k)
        own.mkdir()
        prepare(own)
        with started(own, *arguments) as command:
            command.wait_until(alive)
            begun, moment = time.monotonic(), rng.uniform(0.0, seconds)
            try:
                command.process.wait(moment)
                seconds = time.monotonic() - begun  # the first run may have compiled something
            except subprocess.TimeoutExpired:
                running += 1
                command.stop(signal.SIGKILL)
        check(own)
        code, errors = run_whole(own, *arguments)
        assert "Traceback" not in errors
        assert code == 0 or (code == 2 and "is there already" in errors) or "holds a finished run" in errors, errors
        assert outcome(own) == expected
    assert running, "every kill came too late"


def contents(folder: Path, without: Sequence[str] = ()) -> dict[str, bytes]:
    """Return the files below a folder but locks and those of some names."""
    return {
        file.relative_to(folder).as_posix(): file.read_bytes()
        for file in sorted(folder.rglob("*"))
        if file.is_file() and file.name not in (LOCK, *without)
    }
