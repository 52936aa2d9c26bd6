"""The command ``sffr doctor``: what is printed."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

from sffr_workbench.cli.options import option
from sffr_workbench.cli.terminal import consoles
from sffr_workbench.common import terminal_table
from sffr_workbench.common.installation import Finding, core_findings, extra_findings


def add_commands(app: typer.Typer) -> None:
    """Add the command of this module to the command line."""
    app.command("doctor")(doctor_command)


def doctor_command(
    extras: Annotated[bool, option("--extras/--no-extras", "Also import what the extras bring.")] = True,
) -> None:
    """Say what is installed here, whether it works, and what to do where it does not.

    Versions, the compiled code that is loaded, processors, where results go, and each extra. Exit code 1 if something
    is missing that everything needs; an extra that is not installed is no error.
    """
    notes, results = consoles()
    findings = list(core_findings())
    _print(results, findings)
    if extras:
        notes.print("importing the extras ...", style="dim")
        results.print()
        _print(results, more := list(extra_findings()))
        findings += more
    broken = [each for each in findings if each.broken]
    advised = sum(bool(each.advice) for each in findings)
    verdict = f"{len(broken)} broken" if broken else "all that every use needs works"
    results.print(f"\n{verdict}; advice on {advised} of {len(findings)}", markup=False, soft_wrap=True)
    if broken:
        raise typer.Exit(1)


def _print(console: Console, findings: Iterable[Finding]) -> None:
    """Print a row for each finding, its advice below."""
    out = terminal_table()
    out.add_column("", no_wrap=True)
    out.add_column("what", style="bold", no_wrap=True)
    out.add_column("found", overflow="fold")
    for each in findings:
        mark = Text("BAD", style="bold red") if each.broken else Text("-" if each.advice else "ok", style="green")
        found = Text(each.state)
        if each.advice:
            found.append(f"\n{each.advice}", style="yellow")
        out.add_row(mark, Text(each.what), found)
    console.print(out)
