"""The work of ``sffr verify``: which checks run, whether their libraries are there, and the table of their outcome."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from importlib.util import find_spec
from itertools import groupby

from rich import box
from rich.table import Table
from rich.text import Text

from agents.display import CheckDisplay
from sffr_gym import ConfigError
from verification import NAMES, Check, missing_libraries, number, run_checks

INSTALL = "pip install 'sffr-gym[verify]'"
PAGE_LIBRARIES = ("jinja2", "matplotlib")


def choose(sections: Sequence[str]) -> tuple[str, ...]:
    """The sections to run, in the order of the report: those named, or all.

    Raises:
        ConfigError: for an unknown name, with the nearest one, and for a library that is not installed.
    """
    for name in sections:
        if name not in NAMES:
            near = difflib.get_close_matches(name, NAMES, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else f"; there are {', '.join(NAMES)}"
            raise ConfigError(f"section {name!r}: unknown{hint}")
    chosen = tuple(name for name in NAMES if name in sections or not sections)
    lacking = missing_libraries(chosen)
    libraries = dict.fromkeys([*(name for name in PAGE_LIBRARIES if find_spec(name) is None), *lacking.values()])
    if libraries:
        raise ConfigError(f"not installed: {', '.join(libraries)}; {INSTALL}")
    return chosen


def run(sections: Sequence[str], quick: bool, display: CheckDisplay) -> list[Check]:
    """Run the checks of the sections and show how far they are."""
    checks = []
    for check in run_checks(quick, sections, display.begin):
        display.end(check)
        checks.append(check)
    return checks


def table(checks: Sequence[Check]) -> Table:
    """One row for each check: what, against what, error and what is allowed."""
    out = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
    for heading in "", "what", "against":
        out.add_column(heading, ratio={"what": 5, "against": 3}.get(heading))
    for heading in "error", "allowed", "time":
        out.add_column(heading, justify="right", no_wrap=True)
    for title, members in groupby(checks, key=lambda check: check.section):
        out.add_section()
        out.add_row("", Text(title, style="bold"))
        for check in members:
            mark = Text("pass", style="green") if check.passed else Text("FAIL", style="bold red")
            numbers = (number(check.error, check.unit), number(check.allowed, check.unit), f"{check.seconds:.1f} s")
            out.add_row(mark, Text(check.name), Text(check.against), *numbers, style=None if check.passed else "red")
    return out


def remarks(checks: Sequence[Check]) -> list[str]:
    """What is wrong with each failed check, and the verdict."""
    failed = [check for check in checks if not check.passed]
    seconds = sum(check.seconds for check in checks)
    lines = [f"FAIL {check.name}: {check.note}" for check in failed]
    verdict = f"{len(failed)} of {len(checks)} checks failed" if failed else f"all {len(checks)} checks passed"
    return [*lines, f"{verdict}, {seconds:.0f} s"]
