"""The command ``sffr dataset``: arguments, and what is printed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sffr_gym.envs.arguments import resolve_params
from sffr_workbench.cli.options import Overrides, ParamsFile, Quiet, ScenarioName, argument, option, whole
from sffr_workbench.cli.progress import ProgressBar, time_left
from sffr_workbench.cli.terminal import consoles, interruptible
from sffr_workbench.common import require
from sffr_workbench.dataset import IDS, DatasetPlan, write_datasets


def add_commands(app: typer.Typer) -> None:
    """Add the command of this module to the command line."""
    app.command("dataset", no_args_is_help=True)(dataset_command)


def dataset_command(
    policies: Annotated[list[str], argument("POLICY", "Policies to record, each into a dataset of its own.", False)],
    scenario: ScenarioName = "excited",
    episodes: Annotated[int, option("--episodes -n", "Episodes of each policy.", "N", parser=whole(1))] = 10,
    seed: Annotated[
        int, option("--seed", "Seed of the first episode; the next ones count up.", "K", parser=whole())
    ] = 0,
    env_id: Annotated[str, option("--env", f"Environment: {' or '.join(IDS)}.", "ID")] = IDS[0],
    infos: Annotated[bool, option("--infos", "Keep the infos of each step too.")] = False,
    out: Annotated[Path, option("--out -o", "Root of the datasets, for MINARI_DATASETS_PATH.", "DIR")] = Path(
        "datasets"
    ),
    params: ParamsFile = None,
    overrides: Overrides = None,
    overwrite: Annotated[bool, option("--overwrite", "Replace datasets of the same names.")] = False,
    quiet: Quiet = False,
) -> None:
    r"""Record episodes of policies as datasets of Minari, with environment, policy and hashes of both.

    Observations and actions are float32, and lie in the spaces. Needs the extra [bold]data[/]:
    pip install "sffr-gym\[data]".
    """
    notes, results = consoles(quiet)
    require("data", "minari", "h5py", "PIL")
    asked = resolve_params(params, overrides or [])
    plan = DatasetPlan(tuple(policies), scenario, episodes, seed, env_id, asked, infos)
    with interruptible(notes, f"what was finished is in {out}"), ProgressBar(notes, *time_left()) as progress:
        written = write_datasets(plan, out, overwrite, progress)
    for place in written:
        results.print(place.relative_to(out.absolute()).as_posix(), markup=False, soft_wrap=True)
    results.print(f"\nMINARI_DATASETS_PATH={out.absolute()}", markup=False, soft_wrap=True)
