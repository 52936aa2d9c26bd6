"""Evaluation of policies on the episodes of a scenario: its table, and the run folder with recordings."""

from sffr_workbench.evaluation.recording import Recording, actuator_limits, recorded_signals, recording_files
from sffr_workbench.evaluation.run import Evaluation, episode_progress, evaluate, make_policies, with_oracles
from sffr_workbench.evaluation.run_folder import (
    EPISODES_FILE,
    FIGURE_FILES,
    SUMMARY_FILE,
    check_file,
    check_folder,
    episodes_csv,
    read_episodes,
    write_run,
)
from sffr_workbench.evaluation.summary import COLUMNS, summary_remarks, summary_table

__all__ = [
    "COLUMNS", "EPISODES_FILE", "FIGURE_FILES", "SUMMARY_FILE", "Evaluation", "Recording", "actuator_limits",
    "check_file", "check_folder", "episode_progress", "episodes_csv", "evaluate", "make_policies", "read_episodes",
    "recorded_signals", "recording_files", "summary_remarks", "summary_table", "with_oracles", "write_run",
]  # fmt: skip
