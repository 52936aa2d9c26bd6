"""Short runs for the tests of the report."""

from datetime import UTC, datetime
from pathlib import Path

from sffr_gym.config.provenance import origin
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.task.metrics import MEASURES
from sffr_gym.task.score import Result
from sffr_workbench.evaluation import Evaluation, Manifest, evaluate, write_run
from sffr_workbench.report.runs import Run

SCENARIO = """
name: {name}
description: A short episode with swinging panels.
duration: 4.05
panel_modes: [{{mode: 1, amplitude: [0.2, 0.25]}}]
"""
SEED = 1_000_003


def run(folder, policies, episodes=2, name="short", seed=SEED, overrides=()):
    """A run folder of a scenario of 4.05 s, the last recorded state at 4 s, and its evaluation."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    file = folder.parent / f"{name}.yaml"
    file.write_text(SCENARIO.format(name=name))
    evaluation = evaluate(policies, str(file), episodes, seed, overrides=overrides)
    leave_run(folder, evaluation, ["sffr", "evaluate", *policies])
    return evaluation


def leave_run(folder: Path, evaluation: Evaluation, command: list[str]) -> list[Path]:
    """Write an evaluation into a folder, over the one that is there, and return the files."""
    with RunFolder.claim(folder, "evaluation", overwrite=True) as run:
        return write_run(run, evaluation, command)


def made_up(policy, vibration, failure=""):
    """An episode with a vibration energy."""
    measures = dict.fromkeys(MEASURES, 1.0) | {"vibration": vibration, "track_rmse": 2e-6, "piezo_effort": 0.0}
    return Result("made-up", policy, 0, measures, failure, {})


def made_up_run(name, results):
    """A run of some episodes, without figures and recordings."""
    facts = origin(["sffr"], datetime.now(UTC), 1.0) | {"policies": []}
    return Run(name, results, Manifest(**facts), "", [], [])
