"""The folder of a run: summary, episodes, manifest and recordings, each file written whole or not at all."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import Any

from sffr_gym import ConfigError
from sffr_gym.config.files import to_json, write_whole
from sffr_gym.config.provenance import MANIFEST, origin
from sffr_gym.task.metrics import MEASURES
from sffr_gym.task.score import Result
from sffr_workbench.evaluation.recording import RECORDINGS, Recording, recording_file, recording_files
from sffr_workbench.evaluation.run import Evaluation

SUMMARY_FILE, EPISODES_FILE = "summary.json", "episodes.csv"
FIGURE_FILES = ("path.png", "tracking.png", "panels.png", "damping.png", "forces.png")
KEYS = ("scenario", "policy", "seed")  # of an episode


def check_folder(folder: Path, overwrite: bool = False, result: str = SUMMARY_FILE) -> None:
    """Make sure, before anything runs, that its result can be written into a folder.

    Args:
        folder: need not exist.
        overwrite: whether a finished run in it may be replaced.
        result: file that a finished run leaves.

    Raises:
        ConfigError: if it holds a finished run that is not to be overwritten, or cannot be written.
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


def check_file(file: Path, overwrite: bool = False) -> None:
    """Make sure, before anything runs, that a file may be written.

    Raises:
        ConfigError: if it is there and is not to be overwritten.
    """
    if file.exists() and not overwrite:
        raise ConfigError(f"{file}: is there already; choose another name with --out or add --overwrite")


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
    replaced = [*(folder / name for name in (SUMMARY_FILE, *FIGURE_FILES)), *recording_files(folder)]
    for file in replaced:
        file.unlink(missing_ok=True)
    texts = {
        EPISODES_FILE: episodes_csv([result for results in evaluation.results.values() for result in results]),
        MANIFEST: to_json(manifest(evaluation, command)),
        SUMMARY_FILE: to_json(evaluation.summary()),
    }
    recordings = [
        write_whole(recording_file(folder, policy), Recording.of(trajectory).to_bytes())
        for policy, trajectory in evaluation.first.items()
    ]
    return recordings + [write_whole(folder / name, text.encode()) for name, text in texts.items()]


def episodes_csv(rows: Sequence[Result]) -> str:
    """Return a row for each episode: scenario, policy, seed, every measure, failure, and what the scenario drew."""
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
    """Read the episodes of a finished run.

    Raises:
        ConfigError: if the folder holds none, or its file has other columns.
    """
    file = folder / EPISODES_FILE
    if not file.is_file():
        raise ConfigError(f"{folder}: holds no finished run ({EPISODES_FILE} is missing)")
    with file.open(newline="", encoding="utf-8") as text:
        rows = list(csv.DictReader(text))
    missing = [name for name in (*KEYS, *MEASURES, "failure") if rows and name not in rows[0]]
    if missing or not rows:
        raise ConfigError(f"{file}: {f'has no column {missing[0]!r}' if missing else 'holds no episode'}")
    return [_read_row(row) for row in rows]


def manifest(evaluation: Evaluation, command: Sequence[str]) -> dict[str, Any]:
    """Return what it takes to repeat a run: versions, code, configuration, seeds, command."""
    return origin(command, evaluation.started, evaluation.elapsed) | {
        "policies": list(evaluation.results),
        "seeds": [evaluation.seed + i for i in range(evaluation.episodes)],
        "scenario": evaluation.scenario.model_dump(mode="json"),
        "scenario_hash": evaluation.scenario.hash(evaluation.params),
        "config_hash": evaluation.params.hash(),
        "config": evaluation.params.to_dict(),
    }


def _read_row(row: dict[str, str]) -> Result:
    """Return the result of a row of the episodes' file; a measure that was not finite is NaN."""
    known = {*KEYS, *MEASURES, "failure"}
    measures = {name: float(row[name] or "nan") for name in MEASURES}
    drawn = {name: float(value) for name, value in row.items() if name not in known and value}
    return Result(row["scenario"], row["policy"], int(row["seed"]), measures, row["failure"], drawn)
