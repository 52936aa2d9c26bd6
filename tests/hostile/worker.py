"""A process that tries hostile inputs of one kind, one after the other, and tells what came of each.

    python worker.py KIND EXEMPLARS SCRATCH

It says when it is ready, then reads lines with a seed and a number of trials. Every trial lies as a whole in SCRATCH
before it is tried, so that whoever watches can keep it if this process dies.
"""

from __future__ import annotations

import contextlib
import ctypes
import faulthandler
import gc
import json
import os
import pickle
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TextIO

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]

from hypothesis import HealthCheck, Phase, Verbosity, given, seed, settings  # noqa: E402
from kinds import make_kind  # noqa: E402
from trial import REFUSED, WORKED, Kind, Trial, Violation, lay_out  # noqa: E402

SPARE = 3 * 10**9  # bytes of addresses beyond what a ready worker has; more would hurt the machine
PR_SET_PDEATHSIG = 1  # of Linux: the signal that comes when the parent is gone
TRIAL, INPUT = "trial", "input.pickle"

settings.register_profile(
    "hostile", derandomize=True, database=None, deadline=None, phases=[Phase.generate], print_blob=False,
    suppress_health_check=list(HealthCheck), verbosity=Verbosity.quiet,
)  # fmt: skip


def outcome_of(kind: Kind, trial: Trial, folder: Path) -> dict[str, Any]:
    """Try an input.

    Returns:
        What came of it, seconds, bytes of memory added at the most, counts, and the violation if there was one.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    lay_out(trial.tree, folder)
    gc.collect()
    before = forget_peak()
    outcome, counts, error = "violation", {}, ""
    begun = time.perf_counter()
    try:
        outcome, counts = kind.attempt(trial, folder)
    except Violation as violation:
        error = str(violation)
    except BaseException as unexpected:  # whatever it is, the product should not have let it through
        error = f"{short_trace(unexpected)}{type(unexpected).__name__}: {unexpected}"
    seconds = time.perf_counter() - begun
    memory = max(0, peak() - before)
    if not error and memory > kind.most_memory:
        outcome, error = "violation", f"took {memory / 1e6:,.0f} MB"
    return {"outcome": outcome, "seconds": seconds, "memory": memory, "counts": counts, "error": error}


def short_trace(error: BaseException) -> str:
    """Return where an error was raised: the innermost frames of the project, the last one first."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "site-packages" not in frame.filename]
    frames = [frame for frame in frames if "/tests/hostile/" not in frame.filename] or frames
    return "".join(f"{frame.filename.split('/', 4)[-1]}:{frame.lineno} {frame.name}: " for frame in frames[:-4:-1])


def forget_peak() -> int:
    """Forget the highest memory so far and return the present one [bytes]."""
    Path("/proc/self/clear_refs").write_text("5")
    return status("VmRSS")


def peak() -> int:
    """Return the highest memory since :func:`forget_peak` [bytes]."""
    return status("VmHWM")


def status(name: str) -> int:
    """Return a number that the system keeps of this process [bytes]."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(f"{name}:"):
            return int(line.split()[1]) * 1024
    raise LookupError(name)


def try_all(kind: Kind, first: int, trials: int, attempt: Callable[[Trial], None]) -> None:
    """Draw so many trials from a seed, always the same ones, and try each."""
    chosen = settings(settings.get_profile("hostile"), max_examples=trials)
    seed(first)(chosen(given(kind.trials())(attempt)))()


def serve(kind: Kind, scratch: Path, told: TextIO) -> None:
    """Try what is asked for on the standard input, until it ends."""

    def tell(**message: Any) -> None:
        told.write(json.dumps(message) + "\n")
        told.flush()

    def attempt(trial: Trial) -> None:
        (scratch / INPUT).write_bytes(pickle.dumps(trial))
        tell(begin=trial.story)
        end = outcome_of(kind, trial, scratch / TRIAL)
        if end["outcome"] not in (WORKED, REFUSED):  # out of the way of the next one
            end["kept"] = tempfile.mkdtemp(prefix="kept-", dir=scratch)
            for name in (INPUT, TRIAL):
                shutil.move(scratch / name, Path(end["kept"]) / name)
        tell(end=end)

    tell(ready=True)
    for line in sys.stdin:
        asked = json.loads(line)
        if "input" in asked:
            attempt(pickle.loads(Path(asked["input"]).read_bytes()))  # one of our own, kept by the campaign
        else:
            try_all(kind, asked["seed"], asked["trials"], attempt)
        tell(done=True)


def main() -> None:
    """Serve one kind of trials."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)  # nobody would hear of what comes after
    name, exemplars, scratch = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    told = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what the product prints is no message
    faulthandler.enable()
    warnings.simplefilter("ignore")
    os.chdir(scratch)
    kind = make_kind(name)
    kind.load(exemplars)
    with contextlib.suppress(ValueError, OSError):
        most = status("VmSize") + SPARE
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    serve(kind, scratch, told)


if __name__ == "__main__":
    main()
