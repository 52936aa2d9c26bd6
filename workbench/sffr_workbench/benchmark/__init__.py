"""The benchmark: policies on all scenarios in parallel, their scores, the pages that show them, tuning of laws."""

from sffr_workbench.benchmark.compare import common_episodes
from sffr_workbench.benchmark.episodes import Plan, run_episodes
from sffr_workbench.benchmark.figures import FIGURE_FILES
from sffr_workbench.benchmark.page import IMAGES, RESULTS_FILE, ranked, read_leaderboard
from sffr_workbench.benchmark.run import SUITE_EPISODES, default_policies, run_benchmark
from sffr_workbench.benchmark.scores import SuiteScores, by_scenario, score_suite
from sffr_workbench.benchmark.seeds import score_seeds
from sffr_workbench.benchmark.tuning import tune_law, write_settings

__all__ = [
    "FIGURE_FILES", "IMAGES", "RESULTS_FILE", "SUITE_EPISODES", "Plan", "SuiteScores", "by_scenario",
    "common_episodes", "default_policies", "ranked", "read_leaderboard", "run_benchmark", "run_episodes",
    "score_seeds", "score_suite", "tune_law", "write_settings",
]  # fmt: skip
