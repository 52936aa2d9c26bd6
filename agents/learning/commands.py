"""``sffr train``, ``sffr export`` and ``sffr tune``: arguments, and what the terminal shows. Torch is imported late."""

from __future__ import annotations

import shlex
import sys
from datetime import datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from agents.benchmark.commands import Bar
from agents.benchmark.page import markdown_table, show
from agents.display import CompilingBar
from agents.evaluate import number
from agents.learning.config import CONFIGS, VALIDATION_SEED, load_config
from agents.learning.seeds import score_seeds
from agents.learning.tune_config import load_tune
from agents.options import Quiet
from agents.run_folder import read_episodes
from agents.score import REFERENCE, WEIGHTS
from agents.user_errors import user_errors
from sffr_gym import ConfigError, load_params


def add_commands(app: typer.Typer) -> None:
    """Add the commands of this module to the command line."""
    app.command("train")(train_command)
    app.command("export", no_args_is_help=True)(export_command)
    app.command("tune", no_args_is_help=True)(tune_command)
    app.command("curves", no_args_is_help=True)(curves_command)
    app.command("phase", no_args_is_help=True)(phase_command)
    app.command("seeds", no_args_is_help=True)(seeds_command)


class TrainingDisplay(CompilingBar):
    """The last comparison with AHSC and a bar with the time left; a context manager and ``train.Report``.

    Where there is no terminal, a line for each comparison.
    """

    def __init__(self, console: Console) -> None:
        super().__init__(
            console, TextColumn("{task.description}"), BarColumn(20), TextColumn("{task.percentage:.0f} %"),
            TextColumn("{task.fields[rate]}"), TimeElapsedColumn(), TextColumn("elapsed,"), TimeRemainingColumn(),
            TextColumn("remaining"),
        )  # fmt: skip
        self._task = self._bar.add_task("", rate="", start=False)
        self._shown: dict[str, float] = {}

    def __call__(self, done: int, total: int, scores: dict[str, float]) -> None:
        """Report; see ``train.Report``."""
        if scores != self._shown:
            self._shown = scores
            self._console.print(f"{done:>11,} steps: {describe(scores)}", soft_wrap=True)
            self._bar.update(self._task, description=f"cost {number(scores['cost'])}")
        self._bar.start_task(self._task)
        speed = self._bar.tasks[0].speed
        self._bar.update(self._task, completed=done, total=total, rate=f"{speed:,.0f} steps/s," if speed else "")


def describe(scores: dict[str, float]) -> str:
    """The scores in a line."""
    names = [name.removesuffix("/cost") for name in scores if name.endswith("/cost")]
    parts = [
        f"{name}: vibration {number(scores[f'{name}/vibration'])}, tracking {number(scores[f'{name}/tracking'])}"
        for name in names
    ]
    return f"cost {number(scores['cost'])} of AHSC's ({'; '.join(parts)})"


def train_command(
    algo: Annotated[
        str, typer.Option("--algo", metavar="A", help=f"{', '.join(CONFIGS)}; or a YAML file of configs/train's kind.")
    ] = "ppo",
    seed: Annotated[
        int, typer.Option("--seed", metavar="K", help=f"Seed of everything random, below {VALIDATION_SEED}.")
    ] = 0,
    n_envs: Annotated[
        int | None, typer.Option("--n-envs", metavar="N", help="Environments.", show_default="the configuration's")
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Change the configuration, such as learning.gamma=0.99; repeatable."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="DIR", help="Run folder.", show_default="runs/train-<algo>-<date-time>"),
    ] = None,
    going_on: Annotated[bool, typer.Option("--resume", help="Go on with the killed training in --out.")] = False,
    quiet: Quiet = False,
) -> None:
    r"""Train a schedule of the panels' damping; a killed training goes on with --resume as if nothing had happened.

    Leaves best.npz and last.npz for sffr evaluate, progress.csv, TensorBoard's files, and checkpoints in a run folder.
    Needs the extra [bold]agents[/]: pip install "sffr-gym\[agents]".
    """
    console = Console(stderr=True, quiet=quiet, highlight=False)
    with user_errors():
        changes = [*(overrides or ()), *([f"n_envs={n_envs}"] if n_envs is not None else [])]
        if going_on and (out is None or changes):
            raise ConfigError("--resume goes on with the training in --out as it was configured; it takes no changes")
        config = load_config(algo, changes)
        _require("torch", "stable_baselines3")
        from agents.learning.train import resume, train

        folder = out or Path("runs") / f"train-{config.algo}-{datetime.now():%Y%m%d-%H%M%S}"
        try:
            with TrainingDisplay(console) as display:
                if going_on:
                    scores = resume(folder, display)
                else:
                    scores = train(config, seed, folder, display, ["sffr", *sys.argv[1:]])
        except KeyboardInterrupt:
            console.print(f"interrupted; sffr train --resume --out {shlex.quote(str(folder))} goes on", soft_wrap=True)
            raise typer.Exit(130) from None
    Console(quiet=quiet, highlight=False).print(f"{folder / 'best.npz'}: {describe(scores)}", soft_wrap=True)


def export_command(
    source: Annotated[Path, typer.Argument(metavar="SOURCE", help="Run folder of sffr train, or an SB3 zip.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="Where the policy goes.")] = Path(
        "policy.npz"
    ),
    algo: Annotated[
        str, typer.Option("--algo", metavar="A", help="Configuration that a zip was trained with: a name or file.")
    ] = "ppo",
    trust: Annotated[
        bool, typer.Option("--trust", help="Load a zip by SB3 itself, which runs code that is in it.")
    ] = False,
) -> None:
    """Write a policy as one .npz file that runs without torch: of a run's last checkpoint, or of an SB3 zip."""
    with user_errors():
        if out.suffix != ".npz":
            raise ConfigError(f"{out}: a policy's file ends in .npz")
        _require("torch", "stable_baselines3")
        from agents.learning.export import export_run, export_zip

        if source.is_dir():
            export_run(source, out)
        else:
            export_zip(source, load_config(algo), out, trust)
    Console(highlight=False).print(str(out), markup=False, soft_wrap=True)


def tune_command(
    search: Annotated[
        str, typer.Argument(metavar="SEARCH", help="Shipped search (ppo, sac), or a YAML file of configs/tune's kind.")
    ],
    trials: Annotated[
        int | None, typer.Option("--trials", metavar="N", help="Trials in all.", show_default="the search's")
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Change the search, such as seeds=5; repeatable."),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", metavar="K", help="Seed of the search; trainings count from 0.")] = 0,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="DIR", help="Run folder.", show_default="runs/tune-<search>"),
    ] = None,
    storage: Annotated[
        Path | None,
        typer.Option(
            "--storage", metavar="FILE", help="Trials: SQLite for .db or .sqlite, else a journal.",
            show_default="study.journal in DIR",
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:  # fmt: skip
    r"""Search for the settings of a training by Optuna; the same command goes on with a search that was killed.

    Each trial trains with several seeds and counts by the interquartile mean of the costs of all their validation
    episodes. Leaves trials.csv, and best.yaml for sffr train --algo. Needs the extras [bold]agents[/], [bold]tune[/].
    """
    notes = Console(stderr=True, quiet=quiet, highlight=False)
    with user_errors():
        plan = load_tune(search, [*(overrides or ()), *([f"trials={trials}"] if trials is not None else [])])
        _require("torch", "stable_baselines3", "optuna")
        from agents.learning.tune import BEST_CONFIG, tune

        folder = out or Path("runs") / f"tune-{Path(search).stem}"
        try:
            with Bar(notes) as bar:
                best = tune(plan, folder, storage, seed, bar.show)
        except KeyboardInterrupt:
            notes.print(f"interrupted; the same command goes on in {folder}", soft_wrap=True)
            raise typer.Exit(130) from None
    settings = ", ".join(f"{key} = {value}" for key, value in best.params.items())
    console = Console(quiet=quiet, highlight=False)
    console.print(f"cost {number(best.values[0])}: {settings}", markup=False, soft_wrap=True)
    console.print(f"{folder / BEST_CONFIG}", markup=False, soft_wrap=True)


def curves_command(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="Run folders of sffr train, of any seeds and algorithms.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="Picture.")] = Path("learning.png"),
) -> None:
    """Draw learning curves over training seeds, and print where they end."""
    with user_errors():
        _require("matplotlib")
        from agents.learning.figures import by_algorithm, learning_curves, read_curve, save_figure

        groups = by_algorithm([read_curve(folder) for folder in runs])
        save_figure(lambda: learning_curves(groups), out)
    console = Console(highlight=False)
    for algo, curves in groups.items():
        minutes = max(curve.seconds[-1] for curve in curves) / 60.0
        ends = "; ".join(
            f"{name} {', '.join(number(float(curve.vibration[name][-1])) for curve in curves)}"
            for name in curves[0].vibration
        )
        console.print(
            f"{algo}, seeds {', '.join(str(curve.seed) for curve in curves)}, {curves[0].steps[-1]:,.0f} steps in at "
            f"most {number(minutes)} min: vibration / AHSC's {ends}", soft_wrap=True,
        )  # fmt: skip
    console.print(str(out), markup=False, soft_wrap=True)


def seeds_command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of sffr benchmark.")],
) -> None:
    """Print scores over training seeds as Markdown, of a benchmark of policies named such as ppo-0/best, ppo-1/best.

    Relative to AHSC on the same episode: interquartile mean over seeds and episodes, with a 95 % interval of the
    bootstrap that draws seeds and episodes anew.
    """
    with user_errors():
        scores = score_seeds(read_episodes(run))
    rows = [
        [scenario, f"`{name}`", f"{score.seeds} x {score.episodes}", *map(show, score.ratios.values()),
         show(score.cost), str(score.failed)]
        for scenario, own in scores.items()
        for name, score in own.items()
        if name != REFERENCE
    ]  # fmt: skip
    head = ["scenario", "policy", "seeds x episodes", *(f"{name} ratio" for name in WEIGHTS), "cost", "failed"]
    typer.echo(markdown_table(head, rows))


def phase_command(
    policy: Annotated[str, typer.Argument(metavar="POLICY", help="Shipped learned policy, or an .npz file.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="Picture.")] = Path("phase.png"),
) -> None:
    """Draw what a learned policy does: its damping against the phase of a panel's swing, and an episode with it."""
    with user_errors():
        _require("matplotlib")
        from agents.learned import load_schedule, policy_file
        from agents.learning.figures import save_figure, schedule_figure

        file = policy_file(policy)
        if file is None:
            raise ConfigError(f"{policy}: is neither a shipped learned policy nor an .npz file")
        schedule, params = load_schedule(file), load_params()
        save_figure(lambda: schedule_figure(schedule, params), out)
    Console(highlight=False).print(str(out), markup=False, soft_wrap=True)


def _require(*packages: str) -> None:
    """Say what is missing before anything else fails."""
    missing = [package for package in packages if find_spec(package) is None]
    if missing:
        extras = {"optuna": "agents,tune", "matplotlib": "plot"}.get(packages[-1], "agents")
        raise ConfigError(f"{' and '.join(missing)} not installed: pip install 'sffr-gym[{extras}]'")
