"""``sffr train``, ``sffr export`` and ``sffr tune``: arguments, and what the terminal shows. Torch is imported late."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from sffr_agents.config import CONFIGS, VALIDATION_SEED, TrainConfig, build_section, load_config
from sffr_agents.folder import first_difference, read_run
from sffr_agents.tune_config import load_tune
from sffr_baselines.learned import load_schedule
from sffr_gym import ConfigError, load_params
from sffr_gym.config.files import check_target
from sffr_gym.config.ranges import LARGEST_SEED
from sffr_gym.task.score import REFERENCE, WEIGHTS
from sffr_workbench.benchmark import score_seeds
from sffr_workbench.cli.options import Overwrite, Quiet, argument, option, whole
from sffr_workbench.cli.progress import ProgressBar, time_left
from sffr_workbench.cli.terminal import consoles, dated_folder, interruptible, typed_command, user_errors
from sffr_workbench.common import markdown_table, require
from sffr_workbench.common.numbers import format_estimate, format_number
from sffr_workbench.evaluation import read_episodes
from sffr_workbench.figures import by_algorithm, learning_curves, read_curve, save_figures, schedule_figure

DEFAULT_ALGO = "ppo"


def add_commands(app: typer.Typer) -> None:
    """Add the commands of this module to the command line."""
    app.command("train")(train_command)
    app.command("export", no_args_is_help=True)(export_command)
    app.command("tune", no_args_is_help=True)(tune_command)
    app.command("curves", no_args_is_help=True)(curves_command)
    app.command("phase", no_args_is_help=True)(phase_command)
    app.command("seeds", no_args_is_help=True)(seeds_command)


class TrainingProgress:
    """A line for each of a training's comparisons with AHSC, and a bar with the last one's cost and the speed."""

    def __init__(self, bar: ProgressBar, console: Console) -> None:
        self._bar, self._console = bar, console
        self._shown: dict[str, float] = {}
        self._cost = ""

    def __call__(self, done: int, total: int, scores: dict[str, float]) -> None:
        """Show steps done, steps in all, and the scores of the last comparison."""
        if scores != self._shown:
            self._shown, self._cost = scores, f"cost {format_number(scores['cost'])}"
            self._console.print(f"{done:>11,} steps: {describe(scores)}", soft_wrap=True)
        rate = f", {speed:,.0f} steps/s" if (speed := self._bar.speed) else ""
        self._bar(self._cost + rate, done, total)


def warn(console: Console, line: str) -> None:
    """Show a line about something that is wrong, but can be gone on from."""
    console.print(f"warning: {line}", style="yellow", markup=False, soft_wrap=True)


def describe(scores: dict[str, float]) -> str:
    """Return the scores in a line."""
    names = [name.removesuffix("/cost") for name in scores if name.endswith("/cost")]
    shown = {name: format_number(score) for name, score in scores.items()}
    parts = [f"{name}: vibration {shown[f'{name}/vibration']}, tracking {shown[f'{name}/tracking']}" for name in names]
    return f"cost {shown['cost']} of AHSC's ({'; '.join(parts)})"


def train_command(
    algo: Annotated[
        str | None, option("--algo", f"{', '.join(CONFIGS)}; or a YAML file of configs/train's kind.", "A", "ppo")
    ] = None,
    seed: Annotated[
        int | None,
        option("--seed", f"Seed of everything random, below {VALIDATION_SEED}.", "K", "0", parser=whole()),
    ] = None,
    n_envs: Annotated[
        int | None, option("--n-envs", "Environments.", "N", "the configuration's", parser=whole())
    ] = None,
    overrides: Annotated[
        list[str] | None,
        option("--set", "Change the configuration, such as learning.gamma=0.99; repeatable.", "KEY=VALUE"),
    ] = None,
    out: Annotated[Path | None, option("--out -o", "Run folder.", "DIR", "runs/train-<algo>-<date-time>")] = None,
    going_on: Annotated[bool, option("--resume", "Go on with the killed training in --out.")] = False,
    quiet: Quiet = False,
) -> None:
    r"""Train a schedule of the panels' damping; a killed training goes on with --resume as if nothing had happened.

    Leaves best.npz and last.npz for sffr evaluate, progress.csv, TensorBoard's files, and checkpoints in a run folder.
    Needs the extra [bold]agents[/]: pip install "sffr-gym\[agents]".
    """
    notes, results = consoles(quiet)
    with user_errors():
        changes = [*(overrides or ()), *([f"n_envs={n_envs}"] if n_envs is not None else [])]
        if going_on and out is None:
            raise ConfigError("--resume goes on with the training in --out; say which one")
        config = begun_as(out, algo, seed, changes) if going_on and out else load_config(algo or DEFAULT_ALGO, changes)
        require("agents", "torch", "stable_baselines3")
        from sffr_agents.train import resume, train  # torch takes seconds to import

        folder = out or dated_folder(f"train-{config.algo}")
        advice = f"sffr train --resume --out {shlex.quote(str(folder))} goes on"
        with interruptible(notes, advice), ProgressBar(notes, *time_left(), counted=False) as bar:
            progress = TrainingProgress(bar, notes)
            if going_on:
                scores = resume(folder, progress, lambda line: warn(notes, line))
            else:
                scores = train(config, seed or 0, folder, progress, typed_command())
    results.print(f"{folder / 'best.npz'}: {describe(scores)}", soft_wrap=True)


def begun_as(folder: Path, algo: str | None, seed: int | None, changes: Sequence[str]) -> TrainConfig:
    """Return the configuration of the training in a folder, if what else is asked for does not contradict it.

    Args:
        folder: of the run.
        algo: name or file of a configuration, None if it was not given.
        seed: of the training, None if it was not given.
        changes: assignments to the configuration.

    Raises:
        ConfigError: if the folder holds no training, or another one; the message has both values.
    """
    held, held_seed = read_run(folder)
    data = held.model_dump(mode="json")
    if algo == held.algo:  # the rest of the shipped configuration may have been changed when it began
        algo = None
    if algo in CONFIGS:
        asked: dict[str, Any] = data | {"algo": algo}
    elif algo is not None:
        asked = load_config(algo, changes).model_dump(mode="json")
    else:
        asked = build_section(type(held), data, lambda key: str(folder), changes).model_dump(mode="json")
    seeds = held_seed if seed is None else seed
    if found := first_difference({"seed": held_seed, **data}, {"seed": seeds, **asked}):
        key, own, other = found
        raise ConfigError(
            f"{folder}: holds a training with {key} = {json.dumps(own)}, not {json.dumps(other)}; leave that option "
            "out, or choose another folder"
        )
    return held


def export_command(
    source: Annotated[Path, argument("SOURCE", "Run folder of sffr train, or an SB3 zip.")],
    out: Annotated[Path, option("--out -o", "Where the policy goes.", "FILE")] = Path("policy.npz"),
    algo: Annotated[
        str | None,
        option("--algo", "Configuration that a zip was trained with: a name or file.", "A", "what its weights say"),
    ] = None,
    changes: Annotated[
        list[str] | None,
        option("--set", "What a zip without --algo was trained in, such as law=hsc; repeatable.", "KEY=VALUE"),
    ] = None,
    trust: Annotated[bool, option("--trust", "Load a zip by SB3 itself, which runs code that is in it.")] = False,
    overwrite: Overwrite = False,
) -> None:
    """Write a policy as one .npz file that runs without torch: of a run's last checkpoint, or of an SB3 zip."""
    with user_errors():
        if out.suffix != ".npz":
            raise ConfigError(f"{out}: a policy's file ends in .npz")
        check_target(out, overwrite)
        is_run, config = source.is_dir(), load_config(algo or DEFAULT_ALGO)
        if is_run and trust:
            raise ConfigError("--trust is for zips; nothing of a run folder is run")
        if changes and (is_run or algo or trust):
            raise ConfigError("--set is for zips without --algo and --trust; others have a configuration")
        if is_run:
            begun_as(source, algo, None, [])
        require("agents", "torch", "stable_baselines3")
        from sffr_agents.export import export_run, export_zip  # torch takes seconds to import
        from sffr_agents.sb3_actor import export_plain_zip

        if is_run:
            export_run(source, out, lambda line: warn(consoles()[0], line))
        elif algo is None and not trust:
            export_plain_zip(source, out, tuple(changes or ()))
        else:
            export_zip(source, config, out, trust)
    consoles()[1].print(str(out), markup=False, soft_wrap=True)


def tune_command(
    search: Annotated[
        str, argument("SEARCH", "Shipped search (ppo, sac), or a YAML file of configs/tune's kind.")
    ],
    trials: Annotated[
        int | None, option("--trials", "Trials in all.", "N", "the search's", parser=whole())
    ] = None,
    overrides: Annotated[
        list[str] | None,
        option("--set", "Change the search, such as seeds=5; repeatable.", "KEY=VALUE"),
    ] = None,
    seed: Annotated[
        int, option("--seed", "Seed of the search; trainings count from 0.", "K", parser=whole(0, LARGEST_SEED))
    ] = 0,
    out: Annotated[
        Path | None,
        option("--out -o", "Run folder.", "DIR", "runs/tune-<search>"),
    ] = None,
    storage: Annotated[
        str | None,
        option(
            "--storage", "Trials: SQLite for .db or .sqlite, else a journal; or a database's URL for several machines.",
            "FILE", "study.journal in DIR",
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:  # fmt: skip
    r"""Search for the settings of a training by Optuna; the same command goes on with a search that was killed.

    Each trial trains with several seeds and counts by the interquartile mean of the costs of all their validation
    episodes. Leaves trials.csv, and best.yaml for sffr train --algo. Needs the extras [bold]agents[/], [bold]tune[/].
    """
    notes, results = consoles(quiet)
    with user_errors():
        plan = load_tune(search, [*(overrides or ()), *([f"trials={trials}"] if trials is not None else [])])
        require("agents,tune", "torch", "stable_baselines3", "optuna")
        from sffr_agents.tune import BEST_CONFIG, tune  # torch takes seconds to import

        folder = out or Path("runs") / f"tune-{Path(search).stem}"
        advice = f"the same command goes on in {folder}"
        with interruptible(notes, advice), ProgressBar(notes, *time_left()) as progress:
            best = tune(plan, folder, storage, seed, progress, lambda line: warn(notes, line))
    settings = ", ".join(f"{key} = {value}" for key, value in best.params.items())
    results.print(f"cost {format_number(best.values[0])}: {settings}", markup=False, soft_wrap=True)
    results.print(f"{folder / BEST_CONFIG}", markup=False, soft_wrap=True)


def curves_command(
    runs: Annotated[list[Path], argument("RUN...", "Run folders of sffr train, of any seeds and algorithms.")],
    out: Annotated[Path, option("--out -o", "Picture.", "FILE")] = Path("learning.png"),
    overwrite: Overwrite = False,
) -> None:
    """Draw learning curves over training seeds, and print where they end."""
    with user_errors():
        check_target(out, overwrite)
        require("plot", "matplotlib")
        groups = by_algorithm([read_curve(folder) for folder in runs])
        save_figures(out.parent, {out.name: learning_curves}, groups)
    _, results = consoles()
    for algo, curves in groups.items():
        minutes = max(curve.seconds[-1] for curve in curves) / 60.0
        ends = "; ".join(
            f"{name} {', '.join(format_number(float(curve.vibration[name][-1])) for curve in curves)}"
            for name in curves[0].vibration
        )
        results.print(
            f"{algo}, seeds {', '.join(str(curve.seed) for curve in curves)}, {curves[0].steps[-1]:,.0f} steps in at "
            f"most {format_number(minutes)} min: vibration / AHSC's {ends}", soft_wrap=True,
        )  # fmt: skip
    results.print(str(out), markup=False, soft_wrap=True)


def seeds_command(run: Annotated[Path, argument("RUN", "Folder of sffr benchmark.")]) -> None:
    """Print scores over training seeds as Markdown, of a benchmark of policies named such as ppo-0/best, ppo-1/best.

    Relative to AHSC on the same episode: interquartile mean over seeds and episodes, with a 95 % interval of the
    bootstrap that resamples seeds and episodes.
    """
    with user_errors():
        episodes = read_episodes(run)
        try:
            scores = score_seeds(episodes)
        except ConfigError as error:
            raise ConfigError(f"{run}: {error}") from None
    rows = [
        [scenario, f"`{name}`", f"{score.seeds} x {score.episodes}", *map(format_estimate, score.ratios.values()),
         format_estimate(score.cost), str(score.failed)]
        for scenario, own in scores.items()
        for name, score in own.items()
        if name != REFERENCE
    ]  # fmt: skip
    head = ["scenario", "policy", "seeds x episodes", *(f"{name} ratio" for name in WEIGHTS), "cost", "failed"]
    typer.echo(markdown_table(head, rows))


def phase_command(
    policy: Annotated[str, argument("POLICY", "Shipped learned policy, or an .npz file.")],
    out: Annotated[Path, option("--out -o", "Picture.", "FILE")] = Path("phase.png"),
    overwrite: Overwrite = False,
) -> None:
    """Draw what a learned policy does: its damping against the phase of a panel's swing, and an episode with it."""
    with user_errors():
        check_target(out, overwrite)
        require("plot", "matplotlib")
        schedule, params = load_schedule(policy), load_params()
        save_figures(out.parent, {out.name: schedule_figure}, schedule, params)
    consoles()[1].print(str(out), markup=False, soft_wrap=True)
