"""Short runs for the tests of the report."""

from pathlib import Path

from sffr_gym.config.run_folder import RunFolder
from sffr_workbench.evaluation import Evaluation, evaluate, write_run

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
