"""A whole benchmark: episodes, scores, and the files that show them."""

from __future__ import annotations

import shlex
import time
from collections.abc import Sequence
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sffr_baselines import POLICIES
from sffr_baselines.laws import ORACLES, SHAPERS
from sffr_gym import ConfigError
from sffr_gym.config.files import to_json
from sffr_gym.config.provenance import MANIFEST, origin
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.envs.backends import find_gpu
from sffr_gym.task.scenario import load_scenario
from sffr_gym.task.score import REFERENCE
from sffr_workbench.benchmark.episodes import Plan, run_episodes
from sffr_workbench.benchmark.page import make_pages, page_names
from sffr_workbench.benchmark.rows import ROWS
from sffr_workbench.benchmark.scores import SuiteScores, score_suite
from sffr_workbench.common import Backend, Progress, ignore
from sffr_workbench.evaluation import EPISODES_FILE, PLAN_FILE, episodes_csv

SUITE_EPISODES = 20


def default_policies() -> tuple[str, ...]:
    """Return all policies by name but the random one, oracles and shapers.

    Oracles run beside their laws where they differ; a shaper leaves the path, which is what the score takes for error.
    """
    return tuple(name for name in POLICIES if name not in ("random", *ORACLES.values(), *SHAPERS))


def run_benchmark(
    plan: Plan,
    folder: Path,
    jobs: int,
    command: Sequence[str],
    docs: Path | None = None,
    draw: bool = True,
    overwrite: bool = False,
    progress: Progress = ignore,
    backend: Backend | None = None,
    device: str = "cpu",
) -> tuple[SuiteScores, list[Path]]:
    """Run what is missing of a benchmark and write its run folder, the files that show it together at the end.

    Args:
        plan: what to run; AHSC must be among the policies.
        folder: run folder, made if need be.
        jobs: number of worker processes.
        command: the command line as typed.
        docs: another folder for page, leaderboard and figures.
        draw: also draw the figures.
        overwrite: start again instead of going on.
        progress: see :func:`episodes.run_episodes`.
        backend: likewise.
        device: likewise.

    Returns:
        The scores and the files that were written.

    Raises:
        ConfigError: without AHSC, if a folder holds anything of others; see :func:`episodes.run_episodes`.
    """
    if REFERENCE not in plan.policies:
        raise ConfigError(f"scores are relative to {REFERENCE!r}: add it to the policies")
    if device == "cuda":
        find_gpu()  # or refuse, before anything runs
    started, clock = datetime.now(UTC), time.perf_counter()
    with ExitStack() as claimed:
        run = claimed.enter_context(RunFolder.claim(folder, "benchmark", overwrite=overwrite, resume=True))
        run.check_names([EPISODES_FILE, MANIFEST, *page_names(draw)])
        public = [claimed.enter_context(RunFolder.claim(docs, "pages", resume=True, shared=True))] if docs else []
        for each in public:
            each.check_names(page_names(draw))
        results = run_episodes(plan, run, jobs, overwrite, progress, backend, device)
        scores = score_suite([result for result in results if result.policy in plan.titles])
        facts = manifest(
            plan, jobs, backend or Backend(), device, origin(command, started, time.perf_counter() - clock)
        )
        pages = make_pages(plan, results, scores, shlex.join(command), draw)
        own = {EPISODES_FILE: episodes_csv(results).encode(), MANIFEST: to_json(facts).encode()}
        written = run.replace(own | pages, remove=set(run.files) - {ROWS, PLAN_FILE})
        for each in public:
            written += each.replace(pages, remove=page_names())
    return scores, written


def manifest(plan: Plan, jobs: int, backend: Backend, device: str, facts: dict[str, Any]) -> dict[str, Any]:
    """Return what it takes to repeat a benchmark, facts on its origin first."""
    return facts | {
        "jobs": jobs,
        "backend": backend.name,
        "device": device,
        "policies": list(plan.titles),
        "policy_names": list(plan.policies),
        "episodes": plan.episodes,
        "seed": plan.seed,
        "suite": plan.suite,
        "scenarios": [load_scenario(name).model_dump(mode="json") for name in plan.scenarios],
        "config": plan.params.to_dict(),
    }
