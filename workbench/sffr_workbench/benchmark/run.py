"""A whole benchmark: episodes, scores, and the files that show them."""

from __future__ import annotations

import shlex
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from sffr_baselines import POLICIES
from sffr_baselines.laws import ORACLES
from sffr_gym import ConfigError
from sffr_gym.config.files import to_json, write_whole
from sffr_gym.config.provenance import MANIFEST, origin
from sffr_gym.task.scenario import load_scenario
from sffr_gym.task.score import REFERENCE
from sffr_workbench.benchmark.episodes import Plan, run_episodes
from sffr_workbench.benchmark.page import write_pages
from sffr_workbench.benchmark.scores import SuiteScores, score_suite
from sffr_workbench.common import Progress, ignore
from sffr_workbench.evaluation import EPISODES_FILE, episodes_csv

SUITE_EPISODES = 20


def default_policies() -> tuple[str, ...]:
    """Return all policies by name but the random one and the oracles, which run beside their laws where they differ."""
    return tuple(name for name in POLICIES if name not in ("random", *ORACLES.values()))


def run_benchmark(
    plan: Plan,
    folder: Path,
    jobs: int,
    command: Sequence[str],
    docs: Path | None = None,
    draw: bool = True,
    overwrite: bool = False,
    progress: Progress = ignore,
) -> tuple[SuiteScores, list[Path]]:
    """Run what is missing of a benchmark and write its run folder.

    Args:
        plan: what to run; AHSC must be among the policies.
        folder: run folder.
        jobs: number of worker processes.
        command: the command line as typed.
        docs: another folder for page, leaderboard and figures.
        draw: also draw the figures.
        overwrite: start again instead of going on.
        progress: see :func:`episodes.run_episodes`.

    Returns:
        The scores and the files that were written.

    Raises:
        ConfigError: see :func:`episodes.run_episodes`, and without AHSC.
    """
    if REFERENCE not in plan.policies:
        raise ConfigError(f"scores are relative to {REFERENCE!r}: add it to the policies")
    started, clock = datetime.now(UTC), time.perf_counter()
    results = run_episodes(plan, folder, jobs, overwrite, progress)
    scores = score_suite([result for result in results if result.policy in plan.titles])
    facts = origin(command, started, time.perf_counter() - clock) | {
        "jobs": jobs,
        "policies": list(plan.titles),
        "episodes": plan.episodes,
        "seed": plan.seed,
        "suite": plan.suite,
        "scenarios": [load_scenario(name).model_dump(mode="json") for name in plan.scenarios],
        "config": plan.params.to_dict(),
    }
    written = [
        write_whole(folder / EPISODES_FILE, episodes_csv(results).encode()),
        write_whole(folder / MANIFEST, to_json(facts).encode()),
    ]
    for where in filter(None, (folder, docs)):
        written += write_pages(where, plan, results, scores, shlex.join(command), draw)
    return scores, written
