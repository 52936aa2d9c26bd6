"""The folder of an evaluation: summary, episodes, manifest, recordings and figures, put into place together."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from math import isfinite, nan
from pathlib import Path
from typing import Any

from sffr_gym.config.files import to_json
from sffr_gym.config.provenance import MANIFEST, origin
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.task.metrics import measured
from sffr_gym.task.score import Result
from sffr_workbench.evaluation.recording import recording_name
from sffr_workbench.evaluation.records import EPISODES_FILE, FILE, KEYS, SUMMARY_FILE
from sffr_workbench.evaluation.run import Evaluation, EvaluationPlan

FIGURE_FILES = ("path.png", "tracking.png", "panels.png", "damping.png", "forces.png")


def run_names(plan: EvaluationPlan, figures: bool) -> list[str]:
    """Return the names of all files that an evaluation may write."""
    seeds = [None, *(plan.seed + episode for episode in plan.recorded or ())]
    names = [recording_name(policy.name, seed) for policy in plan.policies for seed in seeds]
    names += [EPISODES_FILE, MANIFEST, SUMMARY_FILE]
    return names + list(FIGURE_FILES) * figures


def write_run(
    run: RunFolder, evaluation: Evaluation, command: Sequence[str], figures: Mapping[str, bytes] | None = None
) -> list[Path]:
    """Put an evaluation in the place of whatever run the folder held, all of it or nothing.

    Args:
        run: its folder.
        evaluation: what to write.
        command: the command line as typed, for the manifest.
        figures: by their names, see ``FIGURE_FILES``.

    Returns:
        The files: recordings, episodes, manifest, summary, figures.
    """
    texts = {
        EPISODES_FILE: episodes_csv([result for results in evaluation.results.values() for result in results]),
        MANIFEST: to_json(manifest(evaluation, command)),
        SUMMARY_FILE: to_json(evaluation.summary()),
    }
    contents = evaluation.recordings | {name: text.encode() for name, text in texts.items()}
    return run.replace(contents | dict(figures or {}), remove=run.files)


def episodes_csv(rows: Sequence[Result]) -> str:
    """Return a row for each episode: scenario, policy, seed, every measure, failure, and what the scenario drew."""
    drawn = list(dict.fromkeys(name for row in rows for name in row.drawn))
    names, text = measured(row.measures for row in rows), io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    file = [FILE] if any(row.file for row in rows) else []
    writer.writerow([*KEYS, *names, "failure", *file, *drawn])
    for row in rows:
        values = [value if isfinite(value := row.measures.get(name, nan)) else "" for name in names]
        draws = (row.drawn.get(name, "") for name in drawn)
        writer.writerow(
            [row.scenario, row.policy, row.seed, *values, row.failure, *([row.file] if file else []), *draws]
        )
    return text.getvalue()


def manifest(evaluation: Evaluation, command: Sequence[str]) -> dict[str, Any]:
    """Return what it takes to repeat a run: versions, code, configuration, seeds, command."""
    return origin(command, evaluation.started, evaluation.elapsed) | {
        "policies": list(evaluation.results),
        "policy_names": list(evaluation.names.values()),
        "policy_files": evaluation.files,
        "skipped": evaluation.skipped,
        "seeds": [evaluation.seed + i for i in range(evaluation.episodes)],
        "scenario": evaluation.scenario.model_dump(mode="json"),
        "scenario_hash": evaluation.scenario.hash(evaluation.params),
        "config_hash": evaluation.params.hash(),
        "config": evaluation.params.to_dict(),
    }
