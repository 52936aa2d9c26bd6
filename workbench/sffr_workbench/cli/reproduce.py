"""The command ``sffr reproduce``: arguments, and what is printed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sffr_gym.config.run_folder import RunFolder
from sffr_workbench.cli.options import Quiet, number, option
from sffr_workbench.cli.progress import ProgressBar
from sffr_workbench.cli.terminal import consoles, interruptible, typed_command
from sffr_workbench.common import require
from sffr_workbench.reproduce import claims_table, reproduce, verdicts


def add_commands(app: typer.Typer) -> None:
    """Add the command of this module to the command line."""
    app.command("reproduce")(reproduce_command)


def reproduce_command(
    out: Annotated[Path, option("--out -o", "Folder of pictures, claims and page.", "DIR")] = Path("runs/reproduce"),
    duration: Annotated[
        float | None,
        option("--duration", "Cut each run to this \\[s], for a quick look.", "S", "110.9", parser=number(1.0, 1.0e4)),
    ] = None,
    overwrite: Annotated[bool, option("--overwrite", "Replace a finished run in DIR.")] = False,
    quiet: Quiet = False,
) -> None:
    r"""Draw the paper's figures of section 5.3 with our numbers, and say which of its claims hold.

    Prints the claims; writes index.html, one picture for each figure, claims.md and claims.json. Takes about a minute.
    Needs the extra [bold]plot[/]; with [bold]verify[/] it also compares with the engines of sffr verify.
    """
    notes, results = consoles(quiet)
    require("plot", "matplotlib")
    with (
        interruptible(notes, f"nothing was written to {out}"),
        RunFolder.claim(out, "reproduction", overwrite=overwrite) as run,
        ProgressBar(notes) as progress,
    ):
        claims, written = reproduce(run, typed_command(), duration, progress)
    results.print(claims_table(claims, results.width))
    results.print(verdicts(claims), markup=False)
    results.print(f"\n{out}: {', '.join(path.name for path in written)}", markup=False, soft_wrap=True)
