"""The command ``sffr verify``: which checks run, whether their libraries are there, and the table of their outcome."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from sffr_gym import ConfigError
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.config.suggestion import did_you_mean
from sffr_workbench.cli.options import Quiet, option
from sffr_workbench.cli.progress import ProgressBar
from sffr_workbench.cli.terminal import consoles, dated_folder, interruptible
from sffr_workbench.common import format_error, is_missing, terminal_table
from sffr_workbench.verify import NAMES, PAGE_FILE, SECTIONS, Check, missing_libraries, run_checks, write_page

PAGE_LIBRARIES = ("jinja2", "matplotlib")
_SECTIONS_HELP = "Run these checks alone; repeatable.\n\n" + "\n\n".join(
    f"[bold]{name}[/]: {escape(title)}" for title, name in SECTIONS
)


def add_commands(app: typer.Typer) -> None:
    """Add the command of this module to the command line."""
    app.command("verify")(verify_command)


def verify_command(
    quick: Annotated[
        bool, option("--quick", "Fewer random states, shorter runs, and without what only explains.")
    ] = False,
    sections: Annotated[list[str] | None, option("--section", _SECTIONS_HELP, "NAME", "all")] = None,
    out: Annotated[Path | None, option("--out -o", "Folder of the page.", "DIR", "runs/verify-<date-time>")] = None,
    overwrite: Annotated[bool, option("--overwrite", "Replace the page in DIR.")] = False,
    quiet: Quiet = False,
) -> None:
    r"""Check the simulator against derivations and engines that others wrote: SymPy, Pinocchio, MuJoCo, Exudyn.

    Prints a table and writes a page with pictures. Exit code 1 if a check fails, 2 if nothing could run. Needs the
    extra [bold]verify[/]: pip install "sffr-gym\[verify]".
    """
    notes, results = consoles(quiet)
    out = out or dated_folder("verify")
    chosen = choose_sections(sections or ())
    checks = []
    with (
        interruptible(notes, f"nothing was written to {out}"),
        RunFolder.claim(out, "verification", overwrite=overwrite) as run,
    ):
        run.check_names([PAGE_FILE])
        with ProgressBar(notes) as progress:
            for check in run_checks(quick, chosen, progress):
                print_outcome(notes, check)
                checks.append(check)
        page = write_page(checks, run)
    results.print(checks_table(checks))
    for line in verdict(checks):
        results.print(line, markup=False)
    results.print(page, markup=False, soft_wrap=True)
    if any(not check.passed for check in checks):
        raise typer.Exit(1)


def choose_sections(sections: Sequence[str]) -> tuple[str, ...]:
    """Return the sections to run, in the order of the page: those named, or all.

    Raises:
        ConfigError: for an unknown name, with the nearest one, and for a library that is not installed.
    """
    for name in sections:
        if name not in NAMES:
            hint = did_you_mean(name, NAMES) or f"; there are {', '.join(NAMES)}"
            raise ConfigError(f"section {name!r}: unknown{hint}")
    chosen = tuple(name for name in NAMES if name in sections or not sections)
    if libraries := dict.fromkeys([*filter(is_missing, PAGE_LIBRARIES), *missing_libraries(chosen).values()]):
        raise ConfigError(f"not installed: {', '.join(libraries)}; pip install 'sffr-gym[verify]'")
    return chosen


def print_outcome(console: Console, check: Check) -> None:
    """Print a line for a check: at once for a failure, for all where there is no terminal and hence no bar."""
    if console.is_terminal and check.passed:
        return
    against = f", against {check.against}" if check.against else ""
    line = f"{'pass' if check.passed else 'FAIL'} {check.seconds:5.1f} s  {check.name}{against}"
    console.print(line, style=None if check.passed else "red", markup=False, soft_wrap=True)


def checks_table(checks: Sequence[Check]) -> Table:
    """Return a row for each check: what, against what, error and what is allowed."""
    out = terminal_table()
    for heading in "", "what", "against":
        out.add_column(heading, ratio={"what": 5, "against": 3}.get(heading))
    for heading in "error", "allowed", "time":
        out.add_column(heading, justify="right", no_wrap=True)
    for title, members in groupby(checks, key=lambda check: check.section):
        out.add_section()
        out.add_row("", Text(title, style="bold"))
        for check in members:
            mark = Text("pass", style="green") if check.passed else Text("FAIL", style="bold red")
            numbers = (format_error(each, check.unit) for each in (check.error, check.allowed))
            style = None if check.passed else "red"
            out.add_row(mark, Text(check.name), Text(check.against), *numbers, f"{check.seconds:.1f} s", style=style)
    return out


def verdict(checks: Sequence[Check]) -> list[str]:
    """Return what is wrong with each failed check, and how many failed."""
    failed = [check for check in checks if not check.passed]
    lines = [f"FAIL {check.name}: {check.note}" for check in failed]
    outcome = f"{len(failed)} of {len(checks)} checks failed" if failed else f"all {len(checks)} checks passed"
    return [*lines, f"{outcome}, {sum(check.seconds for check in checks):.0f} s"]
