"""The command ``sffr report``: arguments, and what is printed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sffr_workbench.cli.options import Overwrite, Quiet, argument, option
from sffr_workbench.cli.terminal import consoles, interruptible
from sffr_workbench.common import require
from sffr_workbench.report import REPORT_FILE, write_report


def add_commands(app: typer.Typer) -> None:
    """Add the command of this module to the command line."""
    app.command("report", no_args_is_help=True)(report_command)


def report_command(
    runs: Annotated[list[Path], argument("RUN", "Run folders of sffr evaluate or sffr benchmark.", False)],
    out: Annotated[Path | None, option("--out -o", "The page.", "FILE", f"{REPORT_FILE} in the first RUN")] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    r"""Put runs into one page: scores, figures, spectra, use of the actuators, and a replay to play and to scrub.

    The page is a single HTML file that works without a network. The replay shows the first episode of each policy, of
    which sffr evaluate leaves a recording. Needs the extra [bold]report[/]: pip install "sffr-gym\[report]".
    """
    require("report", "jinja2")
    notes, results = consoles(quiet)
    with interruptible(notes, "nothing was written"):
        file = write_report(runs, out, overwrite)
    results.print(f"{file}: {file.stat().st_size / 1e6:.2f} MB", markup=False, soft_wrap=True)
