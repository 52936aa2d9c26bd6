"""Evaluation of policies on the episodes of a scenario: its table, and the run folder with recordings."""

from sffr_workbench.evaluation.recording import Recording, actuator_limits, recorded_signals, recording_files
from sffr_workbench.evaluation.records import (
    EPISODES_FILE,
    PLAN_FILE,
    SUMMARY_FILE,
    Episode,
    Identity,
    Manifest,
    check_record,
    open_run,
    read_episodes,
    read_manifest,
    read_record,
    scenario_hashes,
)
from sffr_workbench.evaluation.run import (
    Evaluation,
    EvaluationPlan,
    episode_progress,
    evaluate,
    file_hashes,
    given_files,
    make_policies,
    plan_evaluation,
    run_evaluation,
    with_oracles,
)
from sffr_workbench.evaluation.run_folder import FIGURE_FILES, episodes_csv, run_names, write_run
from sffr_workbench.evaluation.summary import COLUMNS, summary_remarks, summary_table

__all__ = [
    "COLUMNS", "EPISODES_FILE", "FIGURE_FILES", "PLAN_FILE", "SUMMARY_FILE", "Episode", "Evaluation", "EvaluationPlan",
    "Identity", "Manifest", "Recording", "actuator_limits", "check_record", "episode_progress", "episodes_csv",
    "evaluate", "file_hashes", "given_files", "make_policies", "open_run", "plan_evaluation", "read_episodes",
    "read_manifest", "read_record", "recorded_signals",
    "recording_files", "run_evaluation", "run_names", "scenario_hashes", "summary_remarks",
    "summary_table", "with_oracles", "write_run",
]  # fmt: skip
