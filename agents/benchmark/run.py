"""A whole benchmark: episodes, standings, and the files that show them."""

from __future__ import annotations

import shlex
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from agents.benchmark.episodes import Plan, Report, run_episodes
from agents.benchmark.page import write_pages
from agents.benchmark.standings import Standings, standings
from agents.files import to_json, write_whole
from agents.learned import shipped_policies
from agents.run_folder import EPISODES, MANIFEST, episodes_csv, origin
from agents.score import REFERENCE
from sffr_gym import ConfigError
from sffr_gym.scenario import load_scenario

SUITE_EPISODES = 20
BASELINES = ("none", "hsc", "ahsc", "ahsc-filtered", "hsc-tuned", "lqr")


def default_policies() -> tuple[str, ...]:
    """The baselines, and the learned policies that come with the package."""
    return (*BASELINES, *shipped_policies())


def run_benchmark(
    plan: Plan,
    folder: Path,
    jobs: int,
    command: Sequence[str],
    docs: Path | None = None,
    draw: bool = True,
    overwrite: bool = False,
    progress: Report | None = None,
) -> tuple[Standings, list[Path]]:
    """Run what is missing of a benchmark and write its run folder.

    Args:
        plan: what to run; AHSC must be among the policies.
        folder: run folder.
        jobs: number of worker processes.
        command: the command line as typed.
        docs: another folder for page, leaderboard and figures.
        draw: also draw the figures.
        overwrite: start anew instead of going on.
        progress: see :func:`episodes.run_episodes`.

    Returns:
        The standings and the files that were written.

    Raises:
        ConfigError: see :func:`episodes.run_episodes`, and without AHSC.
    """
    if REFERENCE not in plan.policies:
        raise ConfigError(f"scores are relative to {REFERENCE!r}: add it to the policies")
    started, clock = datetime.now(UTC), time.perf_counter()
    results = run_episodes(plan, folder, jobs, overwrite, progress)
    table = standings([result for result in results if result.policy in plan.titles])
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
        write_whole(folder / EPISODES, episodes_csv(results).encode()),
        write_whole(folder / MANIFEST, to_json(facts).encode()),
    ]
    for where in (folder, docs) if docs else (folder,):
        written += write_pages(where, plan, results, table, shlex.join(command), draw)
    return table, written
