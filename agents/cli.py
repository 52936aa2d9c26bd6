"""The command line ``sffr``: arguments, and what is printed in the end. The commands' work is done elsewhere."""

from __future__ import annotations

import sys
from datetime import datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

import verification
from agents import verify
from agents.animate import Cut, animate
from agents.bench.commands import add_commands as add_speed_commands
from agents.benchmark.commands import add_commands as add_benchmark_commands
from agents.display import CheckDisplay, EvaluationDisplay
from agents.evaluate import EPISODES, EVALUATION_SEED, Evaluation, evaluate, number, remarks, table
from agents.figures import save_figures
from agents.learned import shipped_policies
from agents.learning.commands import add_commands as add_learning_commands
from agents.options import FirstSeed, Overrides, ParamsFile, Quiet, ScenarioName
from agents.report.commands import add_commands as add_report_commands
from agents.reproduce import CLAIMS, claims_table, reproduce, verdicts
from agents.run_folder import check_folder, package_version, write_run
from agents.user_errors import user_errors
from baselines import POLICIES
from sffr_gym import ConfigError
from sffr_gym._jit import remove_stale_caches
from sffr_gym.task import VIBRATION
from verification import SECTIONS

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


_LEARNED = {name: "learned: AHSC with a schedule of its damping, see docs/agents.md" for name in shipped_policies()}
_POLICY_HELP = "Policies to compare; one of your own by its [bold].npz[/] file.\n\n" + "\n\n".join(
    f"[bold]{name}[/]: {text}" for name, text in (POLICIES | _LEARNED).items()
)


@app.command("evaluate", no_args_is_help=True)
def evaluate_command(
    policies: Annotated[list[str], typer.Argument(metavar="POLICY", help=_POLICY_HELP, show_default=False)],
    scenario: ScenarioName = "nominal",
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
    seed: FirstSeed = EVALUATION_SEED,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="DIR", help="Run folder.", show_default="runs/<scenario>-<date-time>"),
    ] = None,
    params: ParamsFile = None,
    overrides: Overrides = None,
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="Draw each policy's first episode.")] = True,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a finished run in DIR.")] = False,
    quiet: Quiet = False,
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
        with EvaluationDisplay(notes) as display:
            evaluation = evaluate(policies, scenario, episodes, seed, params, overrides or (), progress=display)
        written = write_run(out, evaluation, ["sffr", *sys.argv[1:]])
    tables.print(table(evaluation, tables.width))
    for line in remarks(evaluation):
        tables.print(line, style="dim", markup=False)
    if figures:
        written += _draw(out, evaluation, notes)
    names = (path.relative_to(out).as_posix() for path in written)
    tables.print(f"\n{out}: {', '.join(names)}", markup=False, soft_wrap=True)


def _draw(out: Path, evaluation: Evaluation, notes: Console) -> list[Path]:
    """Draw the figures if matplotlib is there."""
    try:
        return save_figures(out, evaluation)
    except ModuleNotFoundError as error:
        if error.name != "matplotlib":
            raise
        notes.print("note: no figures without matplotlib; pip install 'sffr-gym[plot]'", markup=False)
        return []


_SECTIONS_HELP = "Run these checks alone; repeatable.\n\n" + "\n\n".join(
    f"[bold]{name}[/]: {escape(title)}" for title, name in SECTIONS
)


@app.command("verify")
def verify_command(
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer random states, shorter runs, and without what only explains.")
    ] = False,
    sections: Annotated[
        list[str] | None,
        typer.Option("--section", metavar="NAME", help=_SECTIONS_HELP, show_default="all"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="DIR", help="Folder of the page.", show_default="runs/verify-<date-time>"),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the page in DIR.")] = False,
    quiet: Quiet = False,
) -> None:
    r"""Check the simulator against derivations and engines that others wrote: SymPy, Pinocchio, MuJoCo, Exudyn.

    Prints a table and writes a page with pictures. Exit code 1 if a check fails, 2 if nothing could run. Needs the
    extra [bold]verify[/]: pip install "sffr-gym\[verify]".
    """
    notes, tables = Console(stderr=True, quiet=quiet, highlight=False), Console(quiet=quiet, highlight=False)
    with user_errors():
        out = out or Path("runs") / f"verify-{datetime.now():%Y%m%d-%H%M%S}"
        check_folder(out, overwrite, verification.FILE)
        chosen = verify.choose(sections or ())
        with CheckDisplay(notes) as display:
            checks = verify.run(chosen, quick, display)
        page = verification.write_page(checks, out)
    tables.print(verify.table(checks))
    for line in verify.remarks(checks):
        tables.print(line, markup=False)
    tables.print(page, markup=False, soft_wrap=True)
    if any(not check.passed for check in checks):
        raise typer.Exit(1)


@app.command("reproduce")
def reproduce_command(
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder of pictures, claims and page.")
    ] = Path("runs/reproduce"),
    duration: Annotated[
        float | None,
        typer.Option(
            "--duration", metavar="S", min=1.0, help="Cut each run to this [s], for a quick look.", show_default="110.9"
        ),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a finished run in DIR.")] = False,
    quiet: Quiet = False,
) -> None:
    r"""Draw the paper's figures of section 5.3 with our numbers, and say which of its claims hold.

    Prints the claims; writes index.html, one picture for each figure, claims.md and claims.json. Takes about a minute.
    Needs the extra [bold]plot[/]; with [bold]verify[/] it also compares with the engines of sffr verify.
    """
    notes, tables = Console(stderr=True, quiet=quiet, highlight=False), Console(quiet=quiet, highlight=False)
    with user_errors():
        check_folder(out, overwrite, CLAIMS)
        if find_spec("matplotlib") is None:
            raise ConfigError("not installed: matplotlib; pip install 'sffr-gym[plot]'")
        with CheckDisplay(notes) as display:
            claims, written = reproduce(out, ["sffr", *sys.argv[1:]], duration, display.begin)
    tables.print(claims_table(claims, tables.width))
    tables.print(verdicts(claims), markup=False)
    tables.print(f"\n{out}: {', '.join(path.name for path in written)}", markup=False, soft_wrap=True)


@app.command("animate", no_args_is_help=True)
def animate_command(
    policies: Annotated[
        list[str],
        typer.Argument(metavar="POLICY [POLICY]", help="One policy, or two side by side.", show_default=False),
    ],
    scenario: ScenarioName = "nominal",
    seed: Annotated[int, typer.Option("--seed", metavar="K", help="Seed of the episode.")] = EVALUATION_SEED,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="FILE", help="A .gif or .mp4.", show_default="runs/<policies>-<scenario>.gif"
        ),
    ] = None,
    params: ParamsFile = None,
    overrides: Overrides = None,
    speed: Annotated[float, typer.Option("--speed", metavar="N", help="Times real time.")] = Cut.speed,
    fps: Annotated[int, typer.Option("--fps", metavar="N", help="Pictures a second.")] = Cut.fps,
    duration: Annotated[
        float | None,
        typer.Option("--duration", metavar="S", help="Show so much of the episode [s].", show_default="all"),
    ] = None,
    size: Annotated[int, typer.Option("--size", metavar="N", help="Sides of a policy's picture [pixels].")] = Cut.size,
    exaggeration: Annotated[
        float, typer.Option("--exaggeration", metavar="N", help="Draw deflections so many times as large.")
    ] = Cut.exaggeration,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace FILE.")] = False,
    quiet: Quiet = False,
) -> None:
    r"""Make a moving picture of a policy at work, or of two side by side in the same episode: GIF or MP4.

    A GIF needs the extra [bold]render[/], an MP4 [bold]video[/]: pip install "sffr-gym\[video]".
    """
    notes, tables = Console(stderr=True, quiet=quiet, highlight=False), Console(quiet=quiet, highlight=False)
    with user_errors():
        out = out or Path("runs") / f"{'-'.join(Path(policy).name for policy in policies)}-{Path(scenario).stem}.gif"
        cut = Cut(speed, fps, duration, size, exaggeration)
        with EvaluationDisplay(notes) as display:
            trajectories = animate(policies, out, scenario, seed, params, overrides or (), cut, overwrite, display)
    for trajectory in trajectories:
        energy = 1000.0 * trajectory.signals[:, VIBRATION].mean()
        end = f", failed: {trajectory.failure}" if trajectory.failure else ""
        tables.print(f"{trajectory.policy}: vibration energy {number(energy)} mJ on average{end}", markup=False)
    tables.print(f"{out}: {out.stat().st_size / 1e6:.2f} MB", markup=False, soft_wrap=True)


add_speed_commands(app)
add_benchmark_commands(app)
add_learning_commands(app)
add_report_commands(app)


if __name__ == "__main__":
    app()
