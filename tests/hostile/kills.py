"""Commands that are killed at any moment: nothing finished is lost, nothing differs, no process stays."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import signal
import subprocess
import sys
import time
import uuid
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from command import write_scenario
from hypothesis import strategies as st
from small_training import PPO_SMALL, REPLAY_SMALL
from trial import WORKED, Trial, Violation

SFFR = Path(sys.executable).with_name("sffr")
MARK = "SFFR_HOSTILE_MARK"  # in the environment of all that a trial starts
SIGNALS = {"KILL": signal.SIGKILL, "TERM": signal.SIGTERM, "INT": signal.SIGINT}
PATIENCE = 10.0  # s for those to go that a killed command has started
LONGEST = 300.0  # s of a command
VOLATILE = {"elapsed", "duration_s", "started", "command", "seconds", "time/seconds", "git", "jobs"}
SKIPPED = ("manifest.json", "study.journal", ".lock", "sffr-run.json", "weights.pt")
PLAN = {
    "train": "ppo", "set": PPO_SMALL, "seeds": 1, "trials": 2,
    "space": [{"key": "learning.gamma", "low": 0.95, "high": 0.99}],
}  # fmt: skip


class Kills:
    """Kills at any moment."""

    name = "kills"
    most_seconds, most_memory = 1800.0, 1e9

    def make_exemplars(self, folder: Path) -> None:
        """Run every command without a kill, and note how long it took."""
        write_scenario(folder, duration=1.0)
        write_scenario(folder, "swinging", duration=1.0, panel_modes=[{"mode": 1, "amplitude": [0.05, 0.25]}])
        (folder / "search.yaml").write_text(yaml.safe_dump(PLAN))
        taken = {}
        for name, arguments in self._commands(folder).items():
            begun = time.perf_counter()
            done, error = self._finish(arguments, folder / name)
            if done:
                raise RuntimeError(f"{name}: {error}")
            taken[name] = time.perf_counter() - begun
        (folder / "taken.json").write_text(json.dumps(taken))

    def load(self, folder: Path) -> None:
        """Read what the commands leave when nobody kills them."""
        self._arguments = self._commands(folder)
        self._whole = {name: essence(folder / name) for name in self._arguments}
        self._taken = json.loads((folder / "taken.json").read_text())

    def _commands(self, folder: Path) -> dict[str, list[Any]]:
        """Return the arguments of each command, without its run folder."""
        short, swinging = folder / "short.yaml", folder / "swinging.yaml"

        def changes(settings: list[str]) -> list[str]:
            return [part for setting in settings for part in ("--set", setting)]

        return {
            "train": ["train", *changes(PPO_SMALL)],
            "train-sac": ["train", "--algo", "sac", *changes(REPLAY_SMALL)],
            "benchmark": [
                "benchmark", "ahsc", "hsc", "none", "-s", short, "-s", swinging, "-n", 4, "-j", 2, "--no-figures"
            ],
            "evaluate": ["evaluate", "ahsc", "none", "ppo", "-s", swinging, "-n", 3, "--no-figures"],
            "tune": ["tune", folder / "search.yaml"],
        }  # fmt: skip

    def trials(self) -> st.SearchStrategy[Trial]:
        """Draw a command, and when it is killed by what."""
        kill = st.tuples(st.sampled_from(sorted(SIGNALS)), st.floats(0.0, 1.05))
        kills = st.lists(kill, min_size=1, max_size=2)
        return st.tuples(st.sampled_from(sorted(self._arguments)), kills).map(
            lambda drawn: Trial(
                f"{drawn[0]}: {', '.join(f'SIG{name} at {moment:.2f}' for name, moment in drawn[1])}", drawn[0],
                {"kills.json": json.dumps(drawn[1]).encode()},
            )
        )  # fmt: skip

    def attempt(self, trial: Trial, folder: Path) -> tuple[str, dict[str, int]]:
        """Kill it, then let it finish."""
        name, out = trial.target, folder / "run"
        arguments, counts = self._arguments[name], {}
        for sign, moment in json.loads((folder / "kills.json").read_text()):
            how = self._kill(self._again(arguments, out), out, sign, moment * self._taken[name])
            counts[f"{name} {how}"] = counts.get(f"{name} {how}", 0) + 1
        kept = finished_parts(out)
        code, error = self._finish(self._again(arguments, out), out)
        if code and not (code == 2 and "holds a finished run" in error):
            raise Violation(f"did not go on: exit code {code}: {error[-500:]}")
        for file, (content, when) in kept.items():
            if not file.exists() or file.read_bytes() != content:
                raise Violation(f"lost or changed {file.relative_to(folder)}, which was finished")
            if file.stat().st_mtime_ns != when:
                raise Violation(f"made {file.relative_to(folder)} again, which was finished")
        whole, found = self._whole[name], essence(out)
        if whole != found:
            names = sorted(each for each in {*whole, *found} if whole.get(each) != found.get(each))
            raise Violation(f"not what it is without a kill: {', '.join(names[:5])}")
        return WORKED, counts

    def _again(self, arguments: list[Any], out: Path) -> list[Any]:
        """Return what goes on with a run."""
        if arguments[0] == "train" and (out / "train.json").exists():
            return ["train", "--resume"]
        return arguments

    def _start(self, arguments: list[Any], out: Path) -> tuple[subprocess.Popen[str], str]:
        mark = uuid.uuid4().hex
        command = [str(SFFR), *map(str, arguments), "--quiet", "-o", str(out)]
        environment = os.environ | {MARK: mark, "PYTHONWARNINGS": "default"}
        process = subprocess.Popen(
            command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
            start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # jobs in the background ignore it
        )  # fmt: skip
        return process, mark

    def _finish(self, arguments: list[Any], out: Path) -> tuple[int, str]:
        """Run a command to its end, and return its exit code and errors."""
        process, _ = self._start(arguments, out)
        _, error = process.communicate(timeout=LONGEST)
        return process.returncode, error

    def _kill(self, arguments: list[Any], out: Path, sign: str, moment: float) -> str:
        """Kill a command and see that nothing of it stays; returns how it ended."""
        process, mark = self._start(arguments, out)
        try:
            process.wait(moment)
        except subprocess.TimeoutExpired:
            # An interrupt from the keyboard reaches all processes of a terminal, the others one.
            (os.killpg if sign == "INT" else os.kill)(process.pid, SIGNALS[sign])
        begun = time.perf_counter()
        while process.poll() is None or marked(mark):
            if time.perf_counter() - begun > PATIENCE:
                left = marked(mark)
                for pid in left:
                    os.kill(pid, signal.SIGKILL)
                what = "itself" if process.poll() is None else f"{len(left)} processes"
                process.kill()
                raise Violation(f"{arguments[0]} left {what} behind {PATIENCE:g} s after SIG{sign}")
            time.sleep(0.05)
        error = process.communicate()[1]
        if "Traceback" in error:
            raise Violation(f"{arguments[0]} answered SIG{sign} by a traceback: {error.strip().splitlines()[-1][:300]}")
        return "had finished" if process.returncode == 0 else f"killed by SIG{sign}"


def marked(mark: str) -> list[int]:
    """Return the processes that a trial has started, whatever they are called and wherever they hang."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            alive = " Z " not in (process / "stat").read_text()[-400:].rpartition(")")[2][:3]
            if alive and f"{MARK}={mark}".encode() in (process / "environ").read_bytes():
                found.append(int(process.name))
        except OSError:
            continue
    return found


def finished_parts(out: Path) -> dict[Path, tuple[bytes, int]]:
    """Return what a killed run must keep: finished episodes, and policies of finished trainings, with their time."""
    files = list(out.glob("rows/**/*.json"))
    for card in out.glob("trainings/*/sffr-run.json"):
        if json.loads(card.read_text())["finished"]:
            files.append(card.with_name("best.npz"))
    return {file: (file.read_bytes(), file.stat().st_mtime_ns) for file in files if not file.name.startswith(".")}


def essence(folder: Path) -> dict[str, Any]:
    """Return all of a run that does not depend on when and how fast it ran."""
    return {
        file.relative_to(folder).as_posix(): _essence(file)
        for file in sorted(folder.rglob("*"))
        if file.is_file() and not file.name.endswith(SKIPPED) and "tfevents" not in file.name
    }


def _essence(file: Path) -> Any:
    content = file.read_bytes()
    if file.suffix == ".json":
        return _steady(json.loads(content))
    if file.suffix == ".csv":
        rows = csv.DictReader(io.StringIO(content.decode()))
        return [_steady(row) for row in rows]
    if file.suffix == ".npz":
        with np.load(file, allow_pickle=False) as arrays:
            return {name: (arrays[name].dtype.str, arrays[name].shape, arrays[name].tobytes()) for name in arrays.files}
    if file.suffix == ".md":
        return re.sub(rb"`sffr .*`", b"", content)  # the command as typed, whose folder is another one
    return content


def _steady(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _steady(entry) for key, entry in value.items() if key not in VOLATILE}
    return [_steady(entry) for entry in value] if isinstance(value, list) else value
