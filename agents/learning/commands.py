"""``sffr train`` and ``sffr export``: arguments, and what the terminal shows. Torch is imported when a command runs."""

from __future__ import annotations

import sys
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Annotated, Self

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from agents.learning.config import CONFIGS, load_config
from agents.user_errors import user_errors
from sffr_gym import ConfigError


def add_commands(app: typer.Typer) -> None:
    """Add the commands of this module to the command line."""
    app.command("train")(train_command)
    app.command("export", no_args_is_help=True)(export_command)


class TrainingDisplay:
    """A bar with the time left and the last comparison with AHSC; a context manager and ``train.Report``."""

    def __init__(self, console: Console) -> None:
        self._bar = Progress(
            TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed:,.0f} steps,"),
            TextColumn("{task.fields[rate]}"), TimeElapsedColumn(), TextColumn("elapsed,"), TimeRemainingColumn(),
            TextColumn("remaining"), console=console,
        )  # fmt: skip
        self._task = self._bar.add_task("no score yet", rate="", total=None)

    def __enter__(self) -> Self:
        """Show the bar."""
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave its last state."""
        self._bar.stop()

    def __call__(self, done: int, total: int, scores: dict[str, float]) -> None:
        """Report; see ``train.Report``."""
        speed = self._bar.tasks[0].speed
        rate = f"{speed:,.0f}/s," if speed else ""
        self._bar.update(self._task, completed=done, total=total, rate=rate, description=describe(scores))


def describe(scores: dict[str, float]) -> str:
    """The scores in a line."""
    if not scores:
        return "no score yet"
    names = [name.removesuffix("/cost") for name in scores if name.endswith("/cost")]
    parts = [
        f"{name}: vibration {scores[f'{name}/vibration']:.2f}, cost {scores[f'{name}/cost']:.2f}" for name in names
    ]
    return f"of AHSC's, {'; '.join(parts)}"


def train_command(
    algo: Annotated[
        str, typer.Option("--algo", metavar="A", help=f"{', '.join(CONFIGS)}; or a YAML file of configs/train's kind.")
    ] = "ppo",
    seed: Annotated[int, typer.Option("--seed", metavar="K", help="Seed of everything random.")] = 0,
    n_envs: Annotated[
        int | None, typer.Option("--n-envs", metavar="N", help="Environments.", show_default="the configuration's")
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Change the configuration, such as learning.gamma=0.99."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="DIR", help="Run folder.", show_default="runs/train-<algo>-<date-time>"),
    ] = None,
    going_on: Annotated[bool, typer.Option("--resume", help="Go on with the killed training in --out.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")] = False,
) -> None:
    """Train a schedule of the panels' damping and leave checkpoints, logs, best.npz and last.npz in a run folder."""
    console = Console(stderr=True, quiet=quiet, highlight=False)
    with user_errors():
        _require("torch", "stable_baselines3")
        from agents.learning.train import resume, train

        changes = [*(overrides or ()), *([f"n_envs={n_envs}"] if n_envs is not None else [])]
        if going_on and (out is None or changes):
            raise ConfigError("--resume goes on with the training in --out as it was configured; it takes no changes")
        folder = out or Path("runs") / f"train-{Path(algo).stem}-{datetime.now():%Y%m%d-%H%M%S}"
        config = load_config(algo, changes)
        console.print("the first run compiles the simulator for this machine, a minute or two, once")
        with TrainingDisplay(console) as display:
            if going_on:
                scores = resume(folder, display)
            else:
                scores = train(config, seed, folder, display, ["sffr", *sys.argv[1:]])
    Console(quiet=quiet, highlight=False).print(f"{folder}/best.npz {describe(scores)}", soft_wrap=True)


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
        _require("torch", "stable_baselines3")
        from agents.learning.export import export_run, export_zip

        if source.is_dir():
            export_run(source, out)
        else:
            export_zip(source, load_config(algo), out, trust)
    Console(highlight=False).print(str(out), markup=False)


def _require(*packages: str) -> None:
    """Say what is missing before anything else fails."""
    from importlib.util import find_spec

    missing = [package for package in packages if find_spec(package) is None]
    if missing:
        raise ConfigError(f"{' and '.join(missing)} not installed: pip install 'sffr-gym[agents]'")
