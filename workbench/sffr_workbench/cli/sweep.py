"""The command ``sffr sweep``: arguments, and what is printed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table
from rich.text import Text

from sffr_gym.compile.threads import available_cores
from sffr_gym.config.provenance import origin
from sffr_gym.envs.arguments import resolve_params
from sffr_gym.task.scenario import EVALUATION_SEED
from sffr_workbench.benchmark.sweep import SWEEP_FILE, Row, SweepPlan, read_axis, run_sweep
from sffr_workbench.cli.options import (
    Address,
    BackendName,
    FirstSeed,
    Jobs,
    Overrides,
    ParamsFile,
    Quiet,
    ScenarioName,
    argument,
    option,
    whole,
)
from sffr_workbench.cli.progress import ProgressBar, time_left
from sffr_workbench.cli.terminal import consoles, interruptible, typed_command
from sffr_workbench.common import Backend, format_number, terminal_table

SHOWN = {"vibration": "vibration\n[J]", "track_rmse": "track rmse\n[m]", "piezo_effort": "piezo effort\n[V2 s]"}


def add_commands(app: typer.Typer) -> None:
    """Add the command of this module to the command line."""
    app.command("sweep", no_args_is_help=True)(sweep_command)


def sweep_command(
    policies: Annotated[list[str], argument("POLICY...", "Policies to run, or .npz files of learned ones.", False)],
    over: Annotated[
        list[str], option("--over", "A parameter and its values, such as panel.EI=15,20,25; repeatable.", "KEY=V,V")
    ],
    scenario: ScenarioName = "excited",
    episodes: Annotated[int, option("--episodes -n", "Episodes of each combination.", "N", parser=whole(1))] = 5,
    seed: FirstSeed = EVALUATION_SEED,
    jobs: Jobs = None,
    backend: BackendName = "loky",
    address: Address = None,
    out: Annotated[Path, option("--out -o", "Run folder.", "DIR")] = Path("runs/sweep"),
    params: ParamsFile = None,
    overrides: Overrides = None,
    overwrite: Annotated[bool, option("--overwrite", "Start again instead of going on.")] = False,
    quiet: Quiet = False,
) -> None:
    """Run policies for every combination of some parameters' values, in parallel; an interrupted run goes on.

    Prints means over the episodes, which are the same for all combinations; writes sweep.csv, a row for each episode.
    """
    notes, results = consoles(quiet)
    runner = Backend(backend, address)
    plan = SweepPlan(
        tuple(map(read_axis, over)), tuple(policies), scenario, episodes, seed, resolve_params(params, overrides or [])
    )
    facts = origin(typed_command(), datetime.now(UTC), 0.0) | {"backend": backend}
    begun, advice = time.perf_counter(), f"what was finished is kept in {out}, and the same command goes on"
    with interruptible(notes, advice), ProgressBar(notes, *time_left()) as progress:
        rows = run_sweep(plan, out, jobs or available_cores(), facts, overwrite, progress, runner)
    results.print(_table(plan, rows))
    notes.print(f"{len(rows)} episodes, {time.perf_counter() - begun:.0f} s", style="dim")
    results.print(f"\n{out / SWEEP_FILE}", markup=False, soft_wrap=True)


def _table(plan: SweepPlan, rows: Sequence[Row]) -> Table:
    """Return means for each combination and policy."""
    out = terminal_table()
    for axis in plan.axes:
        out.add_column(axis.key, justify="right")
    out.add_column("policy", style="bold", no_wrap=True)
    for heading in (*SHOWN.values(), "failed"):
        out.add_column(heading, justify="right", no_wrap=True)
    groups: dict[tuple[tuple[str, ...], str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.values, row.result.policy), []).append(row)
    for (values, policy), own in groups.items():
        means = (float(np.mean([row.result.measures[name] for row in own])) for name in SHOWN)
        failed = sum(bool(row.result.failure) for row in own)
        out.add_row(*map(Text, values), Text(policy), *map(format_number, means), f"{failed}/{len(own)}")
    return out
