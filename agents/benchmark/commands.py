"""The commands ``sffr benchmark``, ``sffr compare`` and ``sffr tune-hsc``: arguments, and what the terminal shows."""

from __future__ import annotations

import shlex
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from agents.benchmark.compare import common_episodes
from agents.benchmark.episodes import Plan, default_jobs
from agents.benchmark.page import PAGE, ranked, show, signed
from agents.benchmark.run import SUITE_EPISODES, default_policies, run_benchmark
from agents.benchmark.standings import Standings, standings
from agents.benchmark.tuning import EPISODES, EVALUATIONS, SCENARIO, tune_hsc, write_damping
from agents.display import COMPILING
from agents.evaluate import EVALUATION_SEED, number
from agents.options import FirstSeed, Overrides, ParamsFile, Quiet, ScenarioName
from agents.score import WEIGHTS
from agents.user_errors import user_errors
from sffr_gym import ConfigError
from sffr_gym._jit import is_compiled
from sffr_gym.env import resolve_params
from sffr_gym.scenario import scenario_names

WIDE, MEDIUM = 128, 92  # columns of a terminal that shows everything, or the differences at least


def add_commands(app: typer.Typer) -> None:
    """Add the commands of this module to the command line."""
    app.command("benchmark")(benchmark_command)
    app.command("compare", no_args_is_help=True)(compare_command)
    app.command("tune-hsc")(tune_hsc_command)


def benchmark_command(
    policies: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[POLICY...]",
            help="Policies to run, or .npz files of learned ones.",
            show_default=" ".join(default_policies()),
        ),
    ] = None,
    scenarios: Annotated[
        list[str] | None,
        typer.Option(
            "--scenario", "-s", metavar="S", help="Shipped name or YAML file; repeatable.", show_default="all shipped"
        ),
    ] = None,
    episodes: Annotated[
        int, typer.Option("--episodes", "-n", metavar="N", help="Episodes of each policy in each scenario.")
    ] = SUITE_EPISODES,
    seed: FirstSeed = EVALUATION_SEED,
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs",
            "-j",
            metavar="N",
            min=1,
            help="Worker processes; no result depends on it.",
            show_default="all cores",
        ),
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Run folder.")] = Path("runs/benchmark"),
    docs: Annotated[
        Path | None,
        typer.Option("--docs", metavar="DIR", help="Write results.md, leaderboard.json and images/ there as well."),
    ] = None,
    params: ParamsFile = None,
    overrides: Overrides = None,
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="Draw the figures.")] = True,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Start anew instead of going on.")] = False,
    quiet: Quiet = False,
) -> None:
    """Score policies over all scenarios, in parallel; an interrupted run goes on where it was.

    Prints the standings; writes results.md, leaderboard.json, figures, episodes.csv and manifest.json. Each finished
    episode is kept at once: the same command, or one with more policies, scenarios or episodes, runs what is missing.
    """
    notes, tables = Console(stderr=True, quiet=quiet, highlight=False), Console(quiet=quiet, highlight=False)
    with user_errors():
        if figures and find_spec("matplotlib") is None:
            notes.print("note: no figures without matplotlib; pip install 'sffr-gym[plot]'", markup=False)
            figures = False
        plan = Plan(
            tuple(policies or default_policies()), tuple(scenarios or scenario_names()), episodes, seed,
            resolve_params(params, overrides or []),
        )  # fmt: skip
        try:
            with Bar(notes) as bar:
                table, written = run_benchmark(
                    plan, out, jobs or default_jobs(), ["sffr", *sys.argv[1:]], docs, figures, overwrite, bar.show
                )
        except KeyboardInterrupt:
            notes.print(
                f"interrupted; what was finished is kept in {out}, and the same command goes on", soft_wrap=True
            )
            raise typer.Exit(130) from None
    _print_standings(tables, table)
    tables.print(f"\n{', '.join(str(path) for path in written if path.name == PAGE)}", markup=False, soft_wrap=True)


def compare_command(
    runs: Annotated[
        list[Path],
        typer.Argument(metavar="RUN...", help="Folders of sffr evaluate or sffr benchmark.", show_default=False),
    ],
) -> None:
    """Compare policies of several runs on the episodes that all of them have, relative to AHSC."""
    tables = Console(highlight=False)
    with user_errors():
        results = common_episodes(runs)
        table = standings(results)
    _print_standings(tables, table)
    count = len({(result.scenario, result.seed) for result in results})
    tables.print(f"\n{count} common episodes of {', '.join(table.scenarios)}", style="dim", soft_wrap=True)


def tune_hsc_command(
    scenario: ScenarioName = SCENARIO,
    episodes: Annotated[int, typer.Option("--episodes", "-n", metavar="N", help="Training episodes.")] = EPISODES,
    seed: Annotated[
        int, typer.Option("--seed", metavar="K", help=f"Seed of the first one, below {EVALUATION_SEED}.")
    ] = 0,
    evaluations: Annotated[
        int, typer.Option("--evaluations", metavar="N", min=3, help="About as many pairs at most.")
    ] = EVALUATIONS,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Settings to write.", show_default="print only"),
    ] = None,
    params: ParamsFile = None,
    overrides: Overrides = None,
    quiet: Quiet = False,
) -> None:
    """Find the constant virtual damping of HSC that costs least: the policy hsc-tuned.

    Minimises the cost relative to AHSC on training episodes by the method of Nelder and Mead, from B(0) on. The shipped
    numbers are in configs/policies/hsc-tuned.yaml.
    """
    notes, tables = Console(stderr=True, quiet=quiet, highlight=False), Console(quiet=quiet, highlight=False)
    with user_errors():
        if out is not None and not out.absolute().parent.is_dir():
            raise ConfigError(f"{out}: its folder does not exist")
        found = tune_hsc(
            resolve_params(params, overrides or []), scenario, episodes, seed, evaluations,
            lambda q5, q6, cost: notes.print(f"q5 {number(q5)} N s/m, q6 {number(q6)} N m s/rad: cost {cost:.5f}"),
        )  # fmt: skip
        if out is not None:
            write_damping(out, found, shlex.join(["sffr", *sys.argv[1:]]))
    tables.print(
        f"q5 {found.q5} N s/m, q6 {found.q6} N m s/rad: cost {found.cost:.4f}; with B(0) {found.hsc_cost:.4f}; "
        f"{found.evaluations} pairs tried",
        soft_wrap=True,
    )


class Bar:
    """A progress bar of episodes, on a terminal; elsewhere nothing."""

    def __init__(self, console: Console) -> None:
        self._bar = Progress(
            TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
            TextColumn("elapsed,"), TimeRemainingColumn(), TextColumn("remaining"),
            console=console, transient=True, disable=not console.is_terminal,
        )  # fmt: skip
        self._task = self._bar.add_task("", start=False)

    def __enter__(self) -> Bar:
        """Start the clock; say so if the simulator has to be compiled first."""
        if not is_compiled():
            self._bar.console.print(COMPILING)
        self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        """Clear the terminal of the bar."""
        self._bar.stop()

    def show(self, what: str, done: int, total: int) -> None:
        """Show how far it is."""
        self._bar.start_task(self._task)
        self._bar.update(self._task, description=what, completed=done, total=total)


def _print_standings(console: Console, table: Standings) -> None:
    """The overall scores, the lowest cost first."""
    wide, medium = console.width >= WIDE, console.width >= MEDIUM
    out = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
    out.add_column("policy", style="bold", no_wrap=True)
    heads = ["less AHSC"] * medium + ["typical", *(f"{name.split('_')[0]}\nratio" for name in WEIGHTS)] * wide
    for head in ("cost", *heads, "better", "failed"):
        out.add_column(head, justify="right", no_wrap=True)
    for policy in ranked(table):
        score = table.overall[policy]
        cells = [show(score.cost)] + [signed(score.difference)] * medium
        cells += [show(score.typical), *map(number, score.ratios.values())] * wide
        cells += [f"{100.0 * score.improvement:.0f} %", f"{score.failed}/{score.episodes}"]
        out.add_row(Text(policy), *cells)
    console.print(out)
    console.print(
        f"relative to AHSC over {len(table.scenarios)} scenarios, lower is better; [95 % intervals]", style="dim",
        markup=False,
    )  # fmt: skip
