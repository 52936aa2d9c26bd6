"""The commands ``sffr linearize`` and ``sffr export-run``: arguments, and what is printed."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from sffr_gym import ConfigError, Simulator
from sffr_gym.config.files import check_target, write_whole
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.envs.arguments import resolve_params, resolve_robot
from sffr_gym.task.scenario import load_scenario
from sffr_workbench.cli.options import Overrides, Overwrite, ParamsFile, Quiet, argument, number, option, whole
from sffr_workbench.cli.progress import ProgressBar
from sffr_workbench.cli.terminal import consoles, interruptible
from sffr_workbench.common import format_number
from sffr_workbench.export import FORMS, Choice, export_run, linear_bytes
from sffr_workbench.export.linear import check_suffix
from sffr_workbench.export.tables import check_form


class Point(StrEnum):
    """Where a robot is linearised."""

    REST = "rest"
    START = "start"


def add_commands(app: typer.Typer) -> None:
    """Add the command of this module to the command line."""
    app.command("linearize")(linearize_command)
    app.command("export-run", no_args_is_help=True)(export_run_command)


def linearize_command(
    out: Annotated[Path, option("--out -o", "A .mat or .npz.", "FILE")] = Path("model.mat"),
    at: Annotated[
        Point, option("--at", "Everything at rest and panels straight, or the configured start with its motion.")
    ] = Point.REST,
    scenario: Annotated[
        str | None, option("--scenario -s", "Take the robot of a scenario, as its controllers know it.", "S")
    ] = None,
    params: ParamsFile = None,
    overrides: Overrides = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Write the robot as matrices: A, B, C, D with names and units, continuous and sampled at the control period.

    Grasp constraints are projected out exactly. Inputs are voltages, thrust and joint torques, outputs all that moves,
    the base's acceleration and the grasp forces; docs/control.md has the list. In Python: Simulator.linearize.
    """
    _, results = consoles(quiet)
    check_suffix(out)
    check_target(out, overwrite)
    chosen = resolve_params(params, overrides or ())
    if scenario is not None:
        chosen = resolve_robot(load_scenario(scenario), params, overrides or ())
    plant = Simulator(chosen)
    model = plant.linearize(plant.rest_state() if at is Point.REST else plant.initial_state())
    write_whole(out, linear_bytes(model, out.suffix))
    values = np.linalg.eigvals(model.A)
    swinging = np.sort(abs(values[values.imag > 1e-3]))
    size = f"{len(model.states)} states, {len(model.inputs)} inputs, {len(model.outputs)} outputs"
    results.print(f"{size}; derivatives exact to {model.error:.0e}", markup=False, soft_wrap=True)
    if len(swinging):
        listed = ", ".join(map(format_number, swinging))
        results.print(f"oscillations [rad/s]: {listed}", markup=False, soft_wrap=True)
    results.print(str(out), markup=False, soft_wrap=True)


def export_run_command(
    run: Annotated[Path, argument("RUN", "Folder of sffr evaluate or sffr benchmark.", False)],
    csv: Annotated[bool, option("--csv", "Write .csv files; so it is without any of the three.")] = False,
    mat: Annotated[bool, option("--mat", "Write .mat files.")] = False,
    parquet: Annotated[bool, option("--parquet", "Write .parquet files.")] = False,
    rate: Annotated[
        float | None, option("--rate", "Rows a second, at most 500 at 2 ms.", "HZ", "20 at 2 ms", parser=number(1e-6))
    ] = None,
    policies: Annotated[list[str] | None, option("--policy", "Of these policies; repeatable.", "P", "all")] = None,
    seeds: Annotated[
        list[int] | None, option("--seed", "Episodes of these seeds; repeatable.", "K", "the first", parser=whole())
    ] = None,
    every: Annotated[bool, option("--all", "All episodes.")] = False,
    out: Annotated[Path | None, option("--out -o", "Folder of the files.", "DIR", "<RUN>-export")] = None,
    overwrite: Annotated[bool, option("--overwrite", "Replace an export in DIR.")] = False,
    quiet: Quiet = False,
) -> None:
    r"""Write histories of a run's episodes as tables: every column with its unit and frame in schema.json.

    Each episode is run again from the run's manifest, at any rate, and must measure the same. docs/control.md has the
    columns. Parquet needs the extra [bold]parquet[/]: pip install "sffr-gym\[parquet]".
    """
    notes, results = consoles(quiet)
    forms = [form for form, asked in zip(FORMS, (csv, mat, parquet), strict=True) if asked] or [FORMS[0]]
    if len(forms) > 1:
        raise ConfigError("give one of --csv, --mat and --parquet")
    check_form(forms[0])
    out = out or run.with_name(f"{run.resolve().name}-export")
    choice = Choice(tuple(policies or ()), tuple(seeds or ()), every)
    with (
        interruptible(notes, f"nothing was written to {out}"),
        RunFolder.claim(out, "export", overwrite=overwrite) as target,
        ProgressBar(notes) as progress,
    ):
        written = export_run(run, target, forms[0], rate, choice, progress)
    names = ", ".join(path.name for path in written)
    results.print(f"{out}: {names}", markup=False, soft_wrap=True)
