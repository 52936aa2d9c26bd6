"""The command ``sffr animate``: arguments, and what is printed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sffr_gym.task.scenario import EVALUATION_SEED
from sffr_gym.task.signals import VIBRATION
from sffr_workbench.cli.options import (
    Overrides,
    Overwrite,
    ParamsFile,
    Quiet,
    ScenarioName,
    argument,
    number,
    option,
    whole,
)
from sffr_workbench.cli.progress import EvaluationProgress
from sffr_workbench.cli.terminal import consoles, interruptible
from sffr_workbench.common import format_number
from sffr_workbench.figures import MovieOptions, animate


def add_commands(app: typer.Typer) -> None:
    """Add the command of this module to the command line."""
    app.command("animate", no_args_is_help=True)(animate_command)


def animate_command(
    policies: Annotated[list[str], argument("POLICY [POLICY]", "One policy, or two side by side.", False)],
    scenario: ScenarioName = "nominal",
    seed: Annotated[int, option("--seed", "Seed of the episode.", "K", parser=whole())] = EVALUATION_SEED,
    out: Annotated[Path | None, option("--out -o", "A .gif or .mp4.", "FILE", "runs/<policies>-<scenario>.gif")] = None,
    params: ParamsFile = None,
    overrides: Overrides = None,
    speed: Annotated[float, option("--speed", "Times real time.", "N", parser=number())] = MovieOptions.speed,
    fps: Annotated[int, option("--fps", "Pictures a second.", "N", parser=whole())] = MovieOptions.fps,
    duration: Annotated[
        float | None, option("--duration", "Show so much of the episode \\[s].", "S", "all", parser=number())
    ] = None,
    size: Annotated[
        int, option("--size", "Sides of a policy's picture \\[pixels].", "N", parser=whole())
    ] = MovieOptions.size,
    exaggeration: Annotated[
        float, option("--exaggeration", "Draw deflections so many times as large.", "N", parser=number())
    ] = MovieOptions.exaggeration,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    r"""Make a moving picture of a policy at work, or of two side by side in the same episode: GIF or MP4.

    A GIF needs the extra [bold]render[/], an MP4 [bold]video[/]: pip install "sffr-gym\[video]".
    """
    notes, results = consoles(quiet)
    out = out or Path("runs") / f"{'-'.join(Path(policy).name for policy in policies)}-{Path(scenario).stem}.gif"
    options = MovieOptions(speed, fps, duration, size, exaggeration)
    with interruptible(notes, "nothing was written"), EvaluationProgress(notes) as progress:
        trajectories = animate(policies, out, scenario, seed, params, overrides or (), options, overwrite, progress)
    for trajectory in trajectories:
        energy = 1000.0 * trajectory.signals[:, VIBRATION].mean()
        end = f", failed: {trajectory.failure}" if trajectory.failure else ""
        results.print(f"{trajectory.policy}: vibration energy {format_number(energy)} mJ on average{end}", markup=False)
    results.print(f"{out}: {out.stat().st_size / 1e6:.2f} MB", markup=False, soft_wrap=True)
