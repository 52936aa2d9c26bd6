"""The command ``sffr report``: arguments, and what is printed."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from agents.options import Quiet
from agents.report.page import PAGE, report
from agents.user_errors import user_errors
from sffr_gym import ConfigError


def add_commands(app: typer.Typer) -> None:
    """Add them to the command line."""
    app.command("report", no_args_is_help=True)(report_command)


def report_command(
    runs: Annotated[
        list[Path],
        typer.Argument(metavar="RUN", help="Run folders of sffr evaluate or sffr benchmark.", show_default=False),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="The page.", show_default=f"{PAGE} in the first RUN"),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace FILE.")] = False,
    quiet: Quiet = False,
) -> None:
    r"""Put runs into one page: scores, figures, spectra, use of the actuators, and a replay to play and to scrub.

    The page is a single HTML file that works without a network. The replay shows the first episode of each policy, of
    which sffr evaluate leaves a recording. Needs the extra [bold]report[/]: pip install "sffr-gym\[report]".
    """
    with user_errors():
        if find_spec("jinja2") is None:
            raise ConfigError("not installed: jinja2; pip install 'sffr-gym[report]'")
        file = report(runs, out or runs[0] / PAGE, overwrite)
    tables = Console(quiet=quiet, highlight=False)
    tables.print(f"{file}: {file.stat().st_size / 1e6:.2f} MB", markup=False, soft_wrap=True)
