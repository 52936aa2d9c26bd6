"""The command line ``sffr``: all commands, each of a module of this room; their work is done in the other rooms."""

from __future__ import annotations

from typing import Annotated

import typer

from sffr_gym.config.provenance import package_version
from sffr_workbench.cli import (
    animate,
    benchmark,
    bound,
    dataset,
    doctor,
    evaluate,
    export,
    learning,
    new,
    report,
    reproduce,
    speed,
    sweep,
    trainings,
    verify,
)
from sffr_workbench.cli.encoding import spell_out
from sffr_workbench.cli.terminal import Commands

app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_show_locals=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(asked: bool) -> None:
    """Print the version and exit."""
    if asked:
        typer.echo(f"sffr-gym {package_version('sffr-gym') or '(not installed)'}")
        raise typer.Exit


@app.callback()
def sffr(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """A free-flying space robot with flexible panels: run, measure and compare its controllers."""


spell_out()  # also before a command runs, in help and errors of usage
for module in (
    evaluate,
    verify,
    reproduce,
    animate,
    speed,
    benchmark,
    sweep,
    trainings,
    learning,
    bound,
    dataset,
    report,
    export,
    new,
    doctor,
):
    module.add_commands(app)


if __name__ == "__main__":
    app()
