"""The command ``sffr linearize``: arguments, and what is printed."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from sffr_gym import Simulator
from sffr_gym.config.files import check_target, write_whole
from sffr_gym.envs.arguments import resolve_params, resolve_robot
from sffr_gym.task.scenario import load_scenario
from sffr_workbench.cli.options import Overrides, Overwrite, ParamsFile, Quiet, option
from sffr_workbench.cli.terminal import consoles
from sffr_workbench.common import format_number
from sffr_workbench.export import linear_bytes
from sffr_workbench.export.linear import check_suffix


class Point(StrEnum):
    """Where a robot is linearised."""

    REST = "rest"
    START = "start"


def add_commands(app: typer.Typer) -> None:
    """Add the command of this module to the command line."""
    app.command("linearize")(linearize_command)


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
