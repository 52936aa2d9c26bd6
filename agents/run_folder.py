"""The folder of a run: summary, episodes, manifest and recordings, each file written whole or not at all."""

from __future__ import annotations

import csv
import io
import os
import platform
import shlex
import subprocess
from collections.abc import Sequence
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from math import isfinite
from pathlib import Path
from typing import Any

import sffr_gym
from agents.evaluate import Evaluation
from agents.files import to_json, write_whole
from agents.recording import RECORDINGS, Recording, file_of, recording_files
from agents.score import Result
from sffr_gym import ConfigError
from sffr_gym.metrics import MEASURES

SUMMARY, EPISODES, MANIFEST = "summary.json", "episodes.csv", "manifest.json"
FIGURES = ("path.png", "tracking.png", "panels.png", "damping.png", "forces.png")
KEYS = ("scenario", "policy", "seed")  # of an episode
PACKAGES = ("numpy", "numba", "gymnasium", "scipy", "sffr-gym")


def check_folder(folder: Path, overwrite: bool = False, result: str = SUMMARY) -> None:
    """Make sure, before anything runs, that its result can be written into a folder.

    Args:
        folder: need not exist.
        overwrite: whether a finished run in it may be replaced.
        result: file that a finished run leaves.

    Raises:
        ConfigError: if it holds a finished run that is not to be overwritten, or cannot be a folder of ours.
    """
    if (folder / result).exists() and not overwrite:
        raise ConfigError(f"{folder}: holds a finished run; choose another folder with --out or add --overwrite")
    above = folder.absolute()
    while not above.exists():
        above = above.parent
    if not (above.is_dir() and os.access(above, os.W_OK | os.X_OK)):
        raise ConfigError(
            f"{folder}: cannot be written: {above} is {'read-only' if above.is_dir() else 'not a folder'}"
        )


def write_run(folder: Path, evaluation: Evaluation, command: Sequence[str]) -> list[Path]:
    """Write recordings, episodes, manifest and summary of an evaluation; the summary last, the sign of a finished run.

    Args:
        folder: made if need be.
        evaluation: what to write.
        command: the command line as typed, for the manifest.

    Returns:
        The files, in the order in which they were written.
    """
    (folder / RECORDINGS).mkdir(parents=True, exist_ok=True)
    for stale in (
        *(folder / name for name in (SUMMARY, *FIGURES)),
        *recording_files(folder),
    ):  # of a run that is replaced
        stale.unlink(missing_ok=True)
    texts = {
        EPISODES: episodes_csv([result for results in evaluation.results.values() for result in results]),
        MANIFEST: to_json(manifest(evaluation, command)),
        SUMMARY: to_json(evaluation.summary()),
    }
    recordings = [
        write_whole(file_of(folder, policy), Recording.of(trajectory).to_bytes())
        for policy, trajectory in evaluation.first.items()
    ]
    return recordings + [write_whole(folder / name, text.encode()) for name, text in texts.items()]


def episodes_csv(rows: Sequence[Result]) -> str:
    """One row for each episode: scenario, policy, seed, every measure, failure, and what the scenario drew."""
    drawn = list(dict.fromkeys(name for row in rows for name in row.drawn))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*KEYS, *MEASURES, "failure", *drawn])
    for row in rows:
        values = [value if isfinite(value := row.measures[name]) else "" for name in MEASURES]
        draws = (row.drawn.get(name, "") for name in drawn)
        writer.writerow([row.scenario, row.policy, row.seed, *values, row.failure, *draws])
    return text.getvalue()


def read_episodes(folder: Path) -> list[Result]:
    """The episodes of a finished run.

    Raises:
        ConfigError: if the folder holds none, or its file is not one of ours.
    """
    file = folder / EPISODES
    if not file.is_file():
        raise ConfigError(f"{folder}: holds no finished run ({EPISODES} is missing)")
    with file.open(newline="", encoding="utf-8") as text:
        rows = list(csv.DictReader(text))
    missing = [name for name in (*KEYS, *MEASURES, "failure") if rows and name not in rows[0]]
    if missing or not rows:
        raise ConfigError(f"{file}: {f'has no column {missing[0]!r}' if missing else 'holds no episode'}")
    return [_read_row(row) for row in rows]


def manifest(evaluation: Evaluation, command: Sequence[str]) -> dict[str, Any]:
    """Everything that it takes to repeat a run: versions, code, configuration, seeds, command."""
    return origin(command, evaluation.started, evaluation.elapsed) | {
        "policies": list(evaluation.results),
        "seeds": [evaluation.seed + i for i in range(evaluation.episodes)],
        "scenario": evaluation.scenario.model_dump(mode="json"),
        "scenario_hash": evaluation.scenario.hash(evaluation.params),
        "config_hash": evaluation.params.hash(),
        "config": evaluation.params.to_dict(),
    }


def origin(command: Sequence[str], started: datetime, elapsed: float, packages: Sequence[str] = ()) -> dict[str, Any]:
    """Where a result comes from: command, time, versions (of more packages, if named), machine, code."""
    return {
        "command": shlex.join(command),
        "started": started.isoformat(timespec="seconds"),
        "duration_s": elapsed,
        "versions": {"python": platform.python_version()}
        | {name: package_version(name) for name in (*PACKAGES, *packages)},
        "platform": platform.platform(),
        "machine": platform.machine(),
        "cpus": os.cpu_count(),
        "git": git_state(Path(sffr_gym.__file__).parent),
    }


def package_version(name: str) -> str | None:
    """Version of an installed distribution; None if it is not installed as one."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def git_state(source: Path) -> dict[str, Any] | None:
    """Commit of the checkout that tracks a folder of sources, and whether anything differs from it; else None."""

    def git(*arguments: str) -> str:
        done = subprocess.run(["git", "-C", str(source), *arguments], capture_output=True, text=True, check=True)
        return done.stdout.strip()

    try:
        git("ls-files", "--error-unmatch", "__init__.py")  # an environment inside of some checkout is no part of it
        return {"commit": git("rev-parse", "HEAD"), "dirty": bool(git("status", "--porcelain"))}
    except (OSError, subprocess.CalledProcessError):
        return None


def _read_row(row: dict[str, str]) -> Result:
    """One row of the episodes' file; a measure that was not finite is NaN."""
    known = {*KEYS, *MEASURES, "failure"}
    measures = {name: float(row[name] or "nan") for name in MEASURES}
    drawn = {name: float(value) for name, value in row.items() if name not in known and value}
    return Result(row["scenario"], row["policy"], int(row["seed"]), measures, row["failure"], drawn)
