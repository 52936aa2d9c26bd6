"""Workers that try hostile inputs side by side; one that dies, hangs or grows too large is a violation and replaced."""

from __future__ import annotations

import contextlib
import json
import os
import re
import select
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from kinds import make_kind
from trial import REFUSED, WORKED, Kind
from worker import INPUT, TRIAL

HERE = Path(__file__).parent
CHUNK = 50  # trials that a worker draws from one seed
SLOW_START = 3600.0  # s for a worker to be ready; the first one compiles
GRACE = 6.0  # times the limit, for a trial that a busy machine slows down


@dataclass(frozen=True)
class Found:
    """A violation."""

    kind: str
    error: str
    story: str
    folder: Path  #: where its input is kept


@dataclass
class Figures:
    """What came of a kind's trials."""

    kind: str
    trials: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    slowest: float = 0.0  #: s
    memory: int = 0  #: bytes
    elapsed: float = 0.0  #: s
    counts: Counter[str] = field(default_factory=Counter)
    found: list[Found] = field(default_factory=list)

    @property
    def refused(self) -> int:
        """Return how many trials were refused in a line."""
        return self.outcomes[REFUSED]

    @property
    def worked(self) -> int:
        """Return how many trials worked."""
        return self.outcomes[WORKED]


class Died(Exception):
    """A worker is gone."""


class Worker:
    """One process, from this side.

    Args:
        kind: of its trials.
        exemplars: folder of the valid inputs.
        scratch: folder of its own.
    """

    def __init__(self, kind: Kind, exemplars: Path, scratch: Path) -> None:
        self.kind, self.scratch, self._exemplars = kind, scratch, exemplars
        self._process: subprocess.Popen[bytes] | None = None

    def messages(self, request: dict[str, Any]) -> Iterator[dict[str, Any]]:
        """Ask for trials and yield what the worker tells, ``end`` of a lost trial included; starts it if need be."""
        if self._process is None:
            self.start()
        process = self._process
        assert process is not None and process.stdin is not None
        process.stdin.write(json.dumps(request).encode() + b"\n")
        process.stdin.flush()
        begun, story, cpu = 0.0, None, 0.0
        while True:
            try:
                message = self._next(None if story is None else self._watch(begun, cpu))
            except Died as death:
                self.stop()
                if story is None:
                    raise RuntimeError(f"a worker of {self.kind.name} died between trials: {death}") from None
                lost = {"outcome": "violation", "seconds": time.perf_counter() - begun, "memory": 0, "counts": {}}
                yield {"end": lost | {"error": str(death)}, "story": story}
                return
            if "begin" in message:
                story, begun, cpu = message["begin"], time.perf_counter(), self._cpu()
            elif "end" in message:
                yield message | {"story": story}
                story = None
            elif "done" in message:
                return

    def stop(self) -> None:
        """End the process and whatever it has started."""
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
            for pipe in (self._process.stdin, self._process.stdout):
                assert pipe is not None
                with contextlib.suppress(BrokenPipeError):
                    pipe.close()
            self._process = None

    def start(self) -> None:
        """Start the process and wait until it is ready; raises RuntimeError if it never is."""
        shutil.rmtree(self.scratch, ignore_errors=True)
        self.scratch.mkdir(parents=True)
        environment = os.environ | {
            "OMP_NUM_THREADS": "1", "MPLBACKEND": "agg", "SDL_VIDEODRIVER": "dummy", "PYTHONDONTWRITEBYTECODE": "1",
            "COLUMNS": "200", "TERM": "dumb", "PYTHONWARNINGS": "ignore",
        }  # fmt: skip
        self._told, self._errors = b"", self.scratch.with_suffix(".log")
        with self._errors.open("wb") as errors:
            self._process = subprocess.Popen(
                [sys.executable, str(HERE / "worker.py"), self.kind.name, str(self._exemplars), str(self.scratch)],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, env=environment, start_new_session=True,
            )  # fmt: skip
        begun = time.perf_counter()

        def too_late() -> str:
            return "was not ready in time" if time.perf_counter() - begun > SLOW_START else ""

        try:
            self._next(too_late)
        except Died as death:
            self.stop()
            raise RuntimeError(f"no worker of {self.kind.name}: {death}") from None

    def _next(self, too_late: Callable[[], str] | None) -> dict[str, Any]:
        """Return the next message; raises Died if the process ends, or is too late and was killed."""
        process = self._process
        assert process is not None and process.stdout is not None
        while b"\n" not in self._told:
            ready, _, _ = select.select([process.stdout], [], [], 0.25)
            if ready:
                more = os.read(process.stdout.fileno(), 65536)
                if not more:
                    raise Died(self._obituary(process.wait()))
                self._told += more
            elif too_late and (reason := too_late()):
                os.kill(process.pid, signal.SIGABRT)  # faulthandler writes where it was
                time.sleep(0.2)
                raise Died(f"{reason}: {self._last_frame()}")
        line, _, self._told = self._told.partition(b"\n")
        message: dict[str, Any] = json.loads(line)
        return message

    def _watch(self, begun: float, cpu: float) -> Callable[[], str]:
        """Return what says that a trial takes too long: working or waiting, other processes left aside."""

        def too_late() -> str:
            elapsed, worked = time.perf_counter() - begun, self._cpu() - cpu
            limit = self.kind.most_seconds
            waits = elapsed > limit and worked < 0.2 * elapsed
            return f"hangs for more than {limit:g} s" if worked > limit or waits or elapsed > GRACE * limit else ""

        return too_late

    def _cpu(self) -> float:
        """Return the processor's time that the worker has taken [s]."""
        assert self._process is not None
        try:
            fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            return 0.0
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def _obituary(self, code: int) -> str:
        lines = self._errors.read_text(errors="replace").splitlines()
        told = [line for line in lines if re.match(r"[\w.]*(Error|Exception|Unsatisfiable|HealthCheck)\b", line)][-1:]
        cause = signal.Signals(-code).name if code < 0 else f"exit code {code}, {' '.join(told)}"
        return f"the process died of {cause}: {self._last_frame()}"

    def _last_frame(self) -> str:
        """Return where the worker was when it died, of what faulthandler wrote."""
        lines = self._errors.read_text(errors="replace").rpartition("Current thread")[2].splitlines()
        frames = [line.strip() for line in lines if line.strip().startswith("File ")]
        own = [frame for frame in frames if "site-packages" not in frame and "/tests/hostile/" not in frame]
        return "; ".join((own or frames or lines[-3:])[:2]) or "nothing is known"


def run_kind(
    name: str, exemplars: Path, scratch: Path, failures: Path, *, trials: int | None, until: float | None,
    first_seed: int, workers: int, progress: Callable[[Figures], None] = lambda figures: None,
) -> Figures:  # fmt: skip
    """Try inputs of a kind.

    Args:
        name: of the kind.
        exemplars: folder of its valid inputs, made if need be.
        scratch: folder for the workers.
        failures: folder in which the inputs of violations are kept.
        trials: how many; None for as many as there is time for.
        until: when to stop, on the clock of ``time.monotonic``; None for no such time.
        first_seed: of the first chunk of trials; the others count up.
        workers: number of processes.
        progress: called after every trial.
    """
    kind, figures, lock, starting = make_kind(name), Figures(name), threading.Lock(), threading.Lock()
    own = exemplars / name
    if not own.exists():
        own.mkdir(parents=True)
        kind.make_exemplars(own)
    begun, seeds, asked, troubles = time.perf_counter(), iter(range(first_seed, 2**62)), 0, []

    def next_chunk() -> tuple[int, int]:
        nonlocal asked
        with lock:
            late = until is not None and time.monotonic() > until
            size = 0 if late else CHUNK if trials is None else min(CHUNK, trials - asked, max(1, trials // workers))
            asked += max(size, 0)
            return next(seeds), max(size, 0)

    def work(worker: Worker) -> None:
        nonlocal asked
        try:
            with starting:  # one after the other: the first one may have to compile
                worker.start()
            while (chunk := next_chunk())[1]:
                tried = 0
                for message in worker.messages({"seed": chunk[0], "trials": chunk[1]}):
                    tried += 1
                    with lock:
                        note(worker, message["end"], message["story"])
                        progress(figures)
                    if until is not None and time.monotonic() > until:
                        worker.stop()
                        break
                with lock:
                    asked -= chunk[1] - tried  # of those that went with a worker, or that the strategy had not
        except BaseException as error:
            troubles.append(error)
        finally:
            worker.stop()

    def note(worker: Worker, end: dict[str, Any], story: str) -> None:
        figures.trials += 1
        figures.outcomes[end["outcome"]] += 1
        figures.slowest = max(figures.slowest, end["seconds"])
        figures.memory = max(figures.memory, end["memory"])
        figures.counts.update(end["counts"])
        if end["outcome"] not in (WORKED, REFUSED):
            kept = failures / f"{name}-{len(figures.found):04d}"
            keep(Path(end.get("kept", worker.scratch)), kept, f"{story}\n\n{end['error']}\n")
            figures.found.append(Found(name, end["error"], story, kept))

    threads = [
        threading.Thread(target=work, args=(Worker(kind, own, scratch / f"{name}-{k}"),)) for k in range(workers)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if troubles:
        raise troubles[0]
    figures.elapsed = time.perf_counter() - begun
    return figures


def keep(source: Path, folder: Path, text: str) -> None:
    """Keep a trial's input and files for whoever wants to see it again."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name in (INPUT, TRIAL):
        if (source / name).exists():
            shutil.move(source / name, folder / name)
    (folder / "story.txt").write_text(text, encoding="utf-8", errors="replace")
