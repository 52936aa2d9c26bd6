"""The commands ``sffr benchmark``, ``sffr compare`` and ``sffr tune-law``: arguments, and what the terminal shows."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer
from rich.console import Console
from rich.text import Text

from sffr_baselines.settings import TUNED, Settings
from sffr_gym.compile.threads import available_cores
from sffr_gym.config.files import check_target
from sffr_gym.envs.arguments import resolve_params
from sffr_gym.task.scenario import EVALUATION_SEED, load_scenario, scenario_names
from sffr_gym.task.score import WEIGHTS
from sffr_workbench.benchmark import Plan, SuiteScores, common_episodes, ranked, score_suite
from sffr_workbench.benchmark.episodes import unfit_policies
from sffr_workbench.benchmark.page import RESULTS_FILE
from sffr_workbench.benchmark.run import SUITE_EPISODES, default_policies, run_benchmark
from sffr_workbench.benchmark.tuning import EVALUATIONS, SCENARIO, TRAINING_EPISODES, tune_law, write_settings
from sffr_workbench.cli.options import (
    Address,
    BackendName,
    FirstSeed,
    Jobs,
    Overrides,
    Overwrite,
    ParamsFile,
    Quiet,
    argument,
    option,
    whole,
)
from sffr_workbench.cli.progress import ProgressBar, time_left
from sffr_workbench.cli.terminal import can_draw, consoles, interruptible, typed_command
from sffr_workbench.common import Backend, terminal_table
from sffr_workbench.common.numbers import format_difference, format_estimate, format_number

WIDE, MEDIUM = 128, 92  # columns of a terminal that shows everything, or the differences at least


def add_commands(app: typer.Typer) -> None:
    """Add the commands of this module to the command line."""
    app.command("benchmark")(benchmark_command)
    app.command("compare", no_args_is_help=True)(compare_command)
    app.command("tune-law", no_args_is_help=True)(tune_law_command)


def benchmark_command(
    policies: Annotated[
        list[str] | None,
        argument(
            "[POLICY...]",
            "Policies to run, .npz files of learned ones, laws of your own as mine.py:MyLaw.",
            " ".join(default_policies()),
        ),
    ] = None,
    scenarios: Annotated[
        list[str] | None, option("--scenario -s", "Shipped name or YAML file; repeatable.", "S", "all shipped")
    ] = None,
    episodes: Annotated[
        int, option("--episodes -n", "Episodes of each policy in each scenario.", "N", parser=whole())
    ] = SUITE_EPISODES,
    seed: FirstSeed = EVALUATION_SEED,
    jobs: Jobs = None,
    backend: BackendName = "loky",
    address: Address = None,
    device: Annotated[
        Literal["cpu", "cuda"], option("--device", "Where laws and learned schedules run: `cuda` is an NVIDIA GPU.")
    ] = "cpu",
    out: Annotated[Path, option("--out -o", "Run folder.", "DIR")] = Path("runs/benchmark"),
    docs: Annotated[
        Path | None, option("--docs", "Write results.md, leaderboard.json and images/ there as well.", "DIR")
    ] = None,
    params: ParamsFile = None,
    overrides: Overrides = None,
    figures: Annotated[bool, option("--figures/--no-figures", "Draw the figures.")] = True,
    overwrite: Annotated[bool, option("--overwrite", "Start again instead of going on.")] = False,
    quiet: Quiet = False,
) -> None:
    """Score policies over all scenarios, in parallel; an interrupted run goes on where it was.

    Prints the scores; writes results.md, leaderboard.json, figures, episodes.csv and manifest.json. Each finished
    episode is kept at once: the same command, or one with more policies, scenarios or episodes, runs what is missing.
    """
    notes, results = consoles(quiet)
    figures, runner = figures and can_draw(notes), Backend(backend, address)
    asked, chosen = policies or list(default_policies()), tuple(scenarios or scenario_names())
    robot = resolve_params(params, overrides or [])
    unfit = unfit_policies(asked, chosen, robot)
    for reason in unfit.values():
        notes.print(f"skipped: {reason}", style="yellow", markup=False, soft_wrap=True)
    plan = Plan(tuple(name for name in asked if name not in unfit), chosen, episodes, seed, robot)
    for each in map(load_scenario, plan.scenarios):
        each.robot_of(plan.params, overrides or [])  # or refuse, before anything runs
    again = "the same command without --overwrite" if overwrite else "the same command"
    advice = f"what was finished is kept in {out}, and {again} goes on"
    with interruptible(notes, advice), ProgressBar(notes, *time_left()) as progress:
        scores, written = run_benchmark(
            plan, out, jobs or available_cores(), typed_command(), docs, figures, overwrite, progress, runner, device
        )
    print_scores(results, scores)
    pages = (str(path) for path in written if path.name == RESULTS_FILE)
    results.print(f"\n{', '.join(pages)}", markup=False, soft_wrap=True)


def compare_command(
    runs: Annotated[list[Path], argument("RUN...", "Folders of sffr evaluate or sffr benchmark.", False)],
) -> None:
    """Compare policies of several runs on the episodes that all of them have, relative to AHSC."""
    _, results = consoles()
    episodes = common_episodes(runs)
    scores = score_suite(episodes)
    print_scores(results, scores)
    count = len({(episode.scenario, episode.seed) for episode in episodes})
    results.print(f"\n{count} common episodes of {', '.join(scores.scenarios)}", style="dim", soft_wrap=True)


def tune_law_command(
    law: Annotated[str, argument("LAW", f"One of {', '.join(TUNED)}.", False)],
    scenarios: Annotated[
        list[str] | None,
        option("--scenario -s", "Shipped name or YAML file; repeatable, for the mean.", "S", SCENARIO),
    ] = None,
    episodes: Annotated[
        int, option("--episodes -n", "Training episodes in each.", "N", parser=whole())
    ] = TRAINING_EPISODES,
    seed: Annotated[int, option("--seed", f"Seed of the first one, below {EVALUATION_SEED}.", "K", parser=whole())] = 0,
    evaluations: Annotated[
        int, option("--evaluations", "About as many settings at most.", "N", parser=whole(3, 10_000))
    ] = EVALUATIONS,
    out: Annotated[Path | None, option("--out -o", "Settings to write.", "FILE", "print only")] = None,
    params: ParamsFile = None,
    overrides: Overrides = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Find the settings of a law that cost least.

    Minimises the cost relative to AHSC on training episodes by the method of Nelder and Mead. The shipped settings are
    in configs/policies, a file for each law.
    """
    notes, results = consoles(quiet)
    if out is not None:
        check_target(out, overwrite)
    names = scenarios or [SCENARIO]
    robot = resolve_params(params, overrides or [])
    for name in names:
        load_scenario(name).robot_of(robot, overrides or [])  # or refuse, before anything runs
    with interruptible(notes, "nothing was written"):
        found = tune_law(
            law, robot, names, episodes, seed, evaluations,
            lambda settings, cost: notes.print(f"{_shown(settings)}: cost {cost:.5f}", markup=False),
        )  # fmt: skip
        if out is not None:
            write_settings(out, found, shlex.join(typed_command()))
    results.print(
        f"{_shown(found.settings)}: cost {found.cost:.4f}; at the start {found.start_cost:.4f}; "
        f"{found.evaluations} settings tried",
        markup=False, soft_wrap=True,
    )  # fmt: skip


def _shown(settings: Settings) -> str:
    """Return the settings that are searched as text."""
    values = {name: np.atleast_1d(getattr(settings, name)) for name in settings.SEARCHED}
    return ", ".join(f"{name} {' '.join(map(format_number, own))}" for name, own in values.items())


def print_scores(console: Console, scores: SuiteScores) -> None:
    """Print the overall scores, the lowest cost first."""
    wide, medium = console.width >= WIDE, console.width >= MEDIUM
    out = terminal_table()
    out.add_column("policy", style="bold", no_wrap=True)
    heads = ["less AHSC"] * medium + ["typical", *(f"{name.split('_')[0]}\nratio" for name in WEIGHTS)] * wide
    for head in ("cost", *heads, "better", "failed"):
        out.add_column(head, justify="right", no_wrap=True)
    for policy in ranked(scores):
        score = scores.overall[policy]
        cells = [format_estimate(score.cost)] + [format_difference(score.difference)] * medium
        cells += [format_estimate(score.typical), *map(format_number, score.ratios.values())] * wide
        cells += [f"{100.0 * score.improvement:.0f} %", f"{score.failed}/{score.episodes}"]
        out.add_row(Text(policy), *cells)
    console.print(out)
    console.print(
        f"relative to AHSC over {len(scores.scenarios)} scenarios, lower is better; [95 % intervals]", style="dim",
        markup=False,
    )  # fmt: skip
