"""The command line ``sffr``: arguments, and what the terminal shows meanwhile. The commands' work is done elsewhere."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Annotated, Self

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from agents.evaluate import EPISODES, EVALUATION_SEED, Evaluation, evaluate, remarks, table
from agents.figures import save_figures
from agents.run_folder import check_folder, package_version, write_run
from baselines import POLICIES
from sffr_gym import ConfigError
from sffr_gym._jit import is_compiled, remove_stale_caches

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_show_locals=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"sffr-gym {package_version('sffr-gym') or '(not installed)'}")
        raise typer.Exit


@app.callback()
def sffr(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """A free-flying space robot with flexible panels: run, measure and compare its controllers."""
    remove_stale_caches()


@contextmanager
def user_errors() -> Iterator[None]:
    """Turn faults of the user's input into a line on stderr and exit code 2; anything else keeps its traceback."""
    try:
        yield
    except (ConfigError, OSError) as error:
        console = Console(stderr=True, highlight=False)
        for line in str(error).splitlines():
            console.print(f"error: {line}", style="red", markup=False, soft_wrap=True)
        raise typer.Exit(2) from None


class Display:
    """What the terminal shows of a run: that it compiles, and a progress bar where it takes longer than two seconds.

    A context manager, and the ``progress`` of :func:`agents.evaluate.evaluate`.
    """

    PATIENCE = 2.0  # s before a bar is worth showing
    SILENCE = 5.0  # s without a sign of life that nothing but compiling takes
    COMPILING = "compiling the simulator for this machine, about a minute, once"

    def __init__(self, console: Console) -> None:
        self._console = console
        self._started: dict[str, float] = {}  # policy: when it was first heard of
        self._timer: threading.Timer | None = None
        self._announced = False
        self._first_move: float | None = None
        self._bar = Progress(
            TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:.0f} %"), TimeElapsedColumn(),
            TextColumn("elapsed,"), TimeRemainingColumn(), TextColumn("remaining"), console=console, transient=True,
        )  # fmt: skip
        self._task = self._bar.add_task("")

    def __enter__(self) -> Self:
        """Nothing to show yet."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Clear the terminal of the bar."""
        self._stop_waiting(completed=error is None)
        if self._bar.live.is_started:  # else it would leave an empty line
            self._bar.stop()

    def __call__(self, policy: str, done: int, total: int) -> None:
        """Report; see ``evaluate.Report``."""
        if policy not in self._started:
            self._wait(policy)
            return
        if total == 0 or done == 0:
            return
        self._stop_waiting()
        now = time.perf_counter()
        if self._first_move is None:
            self._first_move = now
            self._bar.reset(self._task)  # time that went into compiling tells nothing of what remains
        if now - self._first_move > self.PATIENCE and done < total:
            self._bar.start()
        self._bar.update(self._task, description=policy, completed=done, total=total)

    def _wait(self, policy: str) -> None:
        """Announce a compilation: at once on a first run, else if a new policy gives no sign of life for a while.

        That some kernels are in the cache does not mean that those of this policy are.
        """
        self._stop_waiting()
        first = not self._started
        self._started[policy] = time.perf_counter()
        if first and not is_compiled():
            self._announce()
            return
        self._timer = threading.Timer(self.SILENCE, self._announce)
        self._timer.daemon = True
        self._timer.start()

    def _announce(self) -> None:
        self._announced = True
        self._console.print(self.COMPILING)

    def _stop_waiting(self, completed: bool = True) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._announced and completed:
            self._console.print(f"compiled in {time.perf_counter() - list(self._started.values())[-1]:.0f} s")
        self._announced = False


_POLICY_HELP = "Policies to compare.\n\n" + "\n\n".join(f"[bold]{name}[/]: {text}" for name, text in POLICIES.items())


@app.command("evaluate", no_args_is_help=True)
def evaluate_command(
    policies: Annotated[list[str], typer.Argument(metavar="POLICY", help=_POLICY_HELP, show_default=False)],
    scenario: Annotated[
        str, typer.Option("--scenario", "-s", metavar="S", help="Shipped scenario's name, or a YAML file.")
    ] = "nominal",
    episodes: Annotated[
        int | None,
        typer.Option(
            "--episodes",
            "-n",
            metavar="N",
            help="Episodes of each policy, the same ones for all.",
            show_default=f"{EPISODES}, or 1 if the scenario draws nothing",
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option("--seed", metavar="K", help="Seed of the first episode; the next ones count up.")
    ] = EVALUATION_SEED,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="DIR", help="Run folder.", show_default="runs/<scenario>-<date-time>"),
    ] = None,
    params: Annotated[
        str | None,
        typer.Option("--params", metavar="FILE", help="YAML file over the case study.", show_default="the case study"),
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Change a parameter, SI units, such as panel.EI=25; repeatable."
        ),
    ] = None,
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="Draw each policy's first episode.")] = True,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a finished run in DIR.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")] = False,
) -> None:
    """Run policies on the same episodes of a scenario, measure them, and leave a run folder.

    Prints a table; writes summary.json, episodes.csv, manifest.json and figures. The first run ever compiles the
    simulator for this machine, which takes about a minute.
    """
    notes, tables = Console(stderr=True, quiet=quiet, highlight=False), Console(quiet=quiet, highlight=False)
    with user_errors():
        out = out or Path("runs") / f"{Path(scenario).stem}-{datetime.now():%Y%m%d-%H%M%S}"
        check_folder(out, overwrite)
        if seed < EVALUATION_SEED:
            notes.print(f"note: seeds below {EVALUATION_SEED} are for training; compare agents on seeds from there up")
        with Display(notes) as display:
            evaluation = evaluate(policies, scenario, episodes, seed, params, overrides or (), progress=display)
        written = write_run(out, evaluation, ["sffr", *sys.argv[1:]])
    tables.print(table(evaluation, tables.width))
    for line in remarks(evaluation):
        tables.print(line, style="dim", markup=False)
    if figures:
        written += _draw(out, evaluation, notes)
    tables.print(f"\n{out}: {', '.join(path.name for path in written)}", markup=False, soft_wrap=True)


def _draw(out: Path, evaluation: Evaluation, notes: Console) -> list[Path]:
    """Draw the figures if matplotlib is there."""
    try:
        return save_figures(out, evaluation)
    except ModuleNotFoundError as error:
        if error.name != "matplotlib":
            raise
        notes.print("note: no figures without matplotlib; pip install 'sffr-gym[plot]'", markup=False)
        return []


@app.command("bench")
def bench_command(
    quick: Annotated[
        bool, typer.Option("--quick", help="Tiny runs that show that everything works, not how fast.")
    ] = False,
    only: Annotated[
        str | None,
        typer.Option(
            "--only",
            metavar="A,B",
            show_default="all",
            help="Some of physics, loop, gym, vector, growth, memory, starts, precision, profile.",
        ),
    ] = None,
    repeats: Annotated[
        int | None,
        typer.Option(
            "--repeats", metavar="N", min=1, help="Rounds of each comparison.", show_default="7, or 2 if quick"
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder of bench.json and the picture.")
    ] = Path("runs/bench"),
    doc: Annotated[
        Path | None, typer.Option("--doc", metavar="FILE", help="Markdown file to write the tables into.")
    ] = None,
) -> None:
    """Measure the speed of the simulator and its environments, side by side with MuJoCo, SciPy and Gymnasium.

    Prints tables and whether the targets are met; writes bench.json and work_precision.png. All of it takes about half
    an hour and wants the machine to itself. Needs the extra bench.
    """
    with user_errors():
        try:
            from agents.bench import report, suite
            from agents.bench.precision import save_picture
            from agents.bench.targets import judge
        except ModuleNotFoundError as error:
            if error.name not in {"mujoco", "psutil", "matplotlib"}:
                raise
            raise ConfigError(f"{error}; pip install 'sffr-gym[bench]'") from None
        names = suite.choose(only)
        if doc is not None:
            report.check_doc(doc)
        repeats = repeats or (suite.QUICK_REPEATS if quick else suite.REPEATS)
        console, notes = Console(highlight=False), Console(stderr=True, highlight=False)
        command, sections = ["sffr", *sys.argv[1:]], []
        for name in names:
            notes.print(f"measuring {name} ...", style="dim")
            section = suite.MEASUREMENTS[name](repeats, quick)
            sections.append(section)
            console.print(report.section_table(section))
            for line in section.remarks:
                console.print(line, style="dim", markup=False)
            console.print()
        targets = [] if quick else judge(sections)
        if targets:
            console.print(report.target_table(targets))
        written = [report.write_result(out, sections, targets, repeats, quick, command)]
        written += [save_picture(section, out) for section in sections if section.name == "precision"]
        if doc is not None:
            report.write_doc(doc, sections, targets, command)
            written.append(doc)
    console.print(f"\n{', '.join(map(str, written))}", markup=False, soft_wrap=True)


if __name__ == "__main__":
    app()
