"""The command ``sffr sweep-train``: arguments, and what is printed."""

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

from sffr_agents.config import CONFIGS
from sffr_gym.compile.threads import available_cores
from sffr_gym.config.provenance import origin
from sffr_gym.config.ranges import LARGEST_SEED
from sffr_workbench.benchmark.sweep import read_axis
from sffr_workbench.benchmark.trainings import TABLE, Trained, TrainingsPlan, run_trainings
from sffr_workbench.cli.options import Address, BackendName, Jobs, Quiet, argument, option, whole
from sffr_workbench.cli.progress import ProgressBar, time_left
from sffr_workbench.cli.terminal import consoles, interruptible, typed_command
from sffr_workbench.common import Backend, format_number, require, terminal_table


def add_commands(app: typer.Typer) -> None:
    """Add the command of this module to the command line."""
    app.command("sweep-train", no_args_is_help=True)(sweep_train_command)


def sweep_train_command(
    algo: Annotated[str, argument("ALGO", f"{', '.join(CONFIGS)}; or a YAML file of configs/train's kind.")],
    seeds: Annotated[int, option("--seeds -n", "Seeds of each combination.", "N", parser=whole(1))] = 5,
    seed: Annotated[
        int, option("--seed", "The first seed; the next ones count up.", "K", parser=whole(0, LARGEST_SEED))
    ] = 0,
    over: Annotated[
        list[str] | None,
        option("--over", "A setting and its values, such as learning.gamma=0.97,0.99; repeatable.", "KEY=V,V"),
    ] = None,
    overrides: Annotated[
        list[str] | None,
        option("--set", "Change the configuration of all, such as steps=400000; repeatable.", "KEY=VALUE"),
    ] = None,
    jobs: Jobs = None,
    backend: BackendName = "loky",
    address: Address = None,
    out: Annotated[Path | None, option("--out -o", "Run folder.", "DIR", "runs/sweep-train-<algo>")] = None,
    quiet: Quiet = False,
) -> None:
    r"""Train with several seeds, and for every combination of some settings' values, in parallel, a core for each.

    An interrupted run goes on with the same command. Leaves a run folder of sffr train for each in DIR/trainings, and
    trainings.csv. Needs the extra [bold]agents[/]: pip install "sffr-gym\[agents]".
    """
    notes, results = consoles(quiet)
    runner = Backend(backend, address)
    axes = tuple(map(read_axis, over or ()))
    plan = TrainingsPlan(algo, axes, range(seed, seed + seeds), tuple(overrides or ()))
    require("agents", "torch", "stable_baselines3")
    folder = out or Path("runs") / f"sweep-train-{Path(algo).stem}"
    facts = origin(typed_command(), datetime.now(UTC), 0.0) | {"backend": backend}
    begun, advice = time.perf_counter(), f"what was finished is kept in {folder}, and the same command goes on"
    with interruptible(notes, advice), ProgressBar(notes, *time_left()) as progress:
        found = run_trainings(plan, folder, jobs or available_cores(), facts, progress, runner)
    results.print(_table(plan, found))
    for each in found:
        if each.failure:
            results.print(f"{each.training.name} failed: {each.failure}", markup=False, soft_wrap=True)
    notes.print(f"{len(found)} trainings, {time.perf_counter() - begun:.0f} s", style="dim")
    results.print(f"\n{folder / TABLE}", markup=False, soft_wrap=True)
    if any(each.failure for each in found):
        raise typer.Exit(1)


def _table(plan: TrainingsPlan, found: Sequence[Trained]) -> Table:
    """Return the costs over the seeds of each combination."""
    out = terminal_table()
    for axis in plan.axes:
        out.add_column(axis.key, justify="right")
    out.add_column("algo", style="bold", no_wrap=True)
    for heading in ("seeds", "cost,\nmedian", "lowest", "highest", "failed"):
        out.add_column(heading, justify="right", no_wrap=True)
    groups: dict[tuple[str, ...], list[Trained]] = {}
    for each in found:
        groups.setdefault(each.training.values, []).append(each)
    for values, own in groups.items():
        costs = [each.cost for each in own if not np.isnan(each.cost)]
        shown = [format_number(float(of(costs))) if costs else "-" for of in (np.median, np.min, np.max)]
        failed = sum(bool(each.failure) for each in own)
        out.add_row(*map(Text, values), Text(own[0].training.config.algo), str(len(own)), *shown, str(failed))
    return out
