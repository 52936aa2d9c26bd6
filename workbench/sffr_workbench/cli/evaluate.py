"""The command ``sffr evaluate``: arguments, and what is printed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sffr_baselines import POLICIES
from sffr_baselines.own_law import OwnPolicy
from sffr_gym import ConfigError
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.task.scenario import EVALUATION_SEED
from sffr_workbench.cli.options import FirstSeed, Overrides, ParamsFile, Quiet, ScenarioName, argument, option, whole
from sffr_workbench.cli.progress import EvaluationProgress
from sffr_workbench.cli.terminal import can_draw, consoles, dated_folder, interruptible, typed_command
from sffr_workbench.evaluation import (
    plan_evaluation,
    run_evaluation,
    run_names,
    summary_remarks,
    summary_table,
    write_run,
)
from sffr_workbench.evaluation.run import DEFAULT_EPISODES
from sffr_workbench.figures import draw_episode_figures

SLOW = 3.0e-4  # s, of a call of a law; an episode of the case study then takes 17 s
MOST_DIGITS = 8  # of an episode's number
_POLICY_HELP = (
    "Policies to compare; a learned one by its [bold].npz[/] file, a law of your own as [bold]mine.py:MyLaw[/].\n\n"
    + "\n\n".join(f"[bold]{name}[/]: {text}" for name, text in POLICIES.items())
)


def add_commands(app: typer.Typer) -> None:
    """Add the command of this module to the command line."""
    app.command("evaluate", no_args_is_help=True)(evaluate_command)


def chosen_episodes(record: str) -> list[int] | None:
    """Return the numbers of a list such as ``0,3,7``, None for ``all``; raises ConfigError for anything else."""
    if record == "all":
        return None
    parts = [part.strip() for part in record.split(",")]
    if not all(part.isascii() and part.isdecimal() and len(part) < MOST_DIGITS for part in parts):
        raise ConfigError(f"--record {record!r}: must be episodes counted from 0, such as 0,3,7, or all")
    return sorted(map(int, parts))


def evaluate_command(
    policies: Annotated[list[str], argument("POLICY", _POLICY_HELP, False)],
    scenario: ScenarioName = "nominal",
    episodes: Annotated[
        int | None,
        option(
            "--episodes -n",
            "Episodes of each policy, the same ones for all.",
            "N",
            f"{DEFAULT_EPISODES}, or 1 if the scenario draws nothing",
            parser=whole(),
        ),
    ] = None,
    seed: FirstSeed = EVALUATION_SEED,
    out: Annotated[Path | None, option("--out -o", "Run folder.", "DIR", "runs/<scenario>-<date-time>")] = None,
    params: ParamsFile = None,
    overrides: Overrides = None,
    figures: Annotated[bool, option("--figures/--no-figures", "Draw each policy's first recorded episode.")] = True,
    record: Annotated[
        str, option("--record", "Episodes to record, counted from 0, such as 0,3,7; or all.", "LIST")
    ] = "0",
    overwrite: Annotated[bool, option("--overwrite", "Replace a finished run in DIR.")] = False,
    quiet: Quiet = False,
) -> None:
    """Run policies on the same episodes of a scenario, measure them, and leave a run folder.

    Prints a table; writes summary.json, episodes.csv, manifest.json and figures.
    """
    notes, results = consoles(quiet)
    out, draw = out or dated_folder(Path(scenario).stem), figures and can_draw(notes)
    plan = plan_evaluation(policies, scenario, episodes, seed, params, overrides or (), chosen_episodes(record))
    for policy in plan.policies:
        if isinstance(policy, OwnPolicy) and policy.call_time > SLOW:
            minutes = policy.call_time * plan.scenario.ticks(plan.params) / 60.0
            taken = f"{1000.0 * policy.call_time:.2g} ms a call, {minutes:.2g} min an episode"
            notes.print(f"note: {policy.name} takes {taken}", markup=False, soft_wrap=True)
    if seed < EVALUATION_SEED:
        notes.print(f"note: seeds below {EVALUATION_SEED} are for training; compare agents on seeds from there up")
    with (
        interruptible(notes, f"nothing was written to {out}, and the same command starts again"),
        RunFolder.claim(out, "evaluation", overwrite=overwrite) as run,
    ):
        run.check_names(run_names(plan, draw))
        with EvaluationProgress(notes) as progress:
            evaluation = run_evaluation(plan, progress)
        try:
            pictures = draw_episode_figures(evaluation.first) if draw else {}
        except Exception:  # whatever is wrong with a figure, the episodes are kept
            write_run(run, evaluation, typed_command())
            raise
        written = write_run(run, evaluation, typed_command(), pictures)
    results.print(summary_table(evaluation, results.width))
    for line in summary_remarks(evaluation):
        results.print(line, style="dim", markup=False)
    names = (path.relative_to(out).as_posix() for path in written)
    results.print(f"\n{out}: {', '.join(names)}", markup=False, soft_wrap=True)
