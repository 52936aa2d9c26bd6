"""Short runs for the tests of the report."""

from sffr_workbench.evaluation import evaluate, write_run

SCENARIO = """
name: {name}
description: A short episode with swinging panels.
duration: 4.05
panel_modes: [{{mode: 1, amplitude: [0.2, 0.25]}}]
"""
SEED = 1_000_003


def run(folder, policies, episodes=2, name="short", seed=SEED, overrides=()):
    """A run folder of a scenario of 4.05 s, the last recorded state at 4 s, and its evaluation."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder.parent / f"{name}.yaml"
    file.write_text(SCENARIO.format(name=name))
    evaluation = evaluate(policies, str(file), episodes, seed, overrides=overrides)
    write_run(folder, evaluation, ["sffr", "evaluate", *policies])
    return evaluation
