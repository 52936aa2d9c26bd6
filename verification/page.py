"""The report of ``sffr verify``: one HTML file with the table of checks and the pictures, light and dark."""

from __future__ import annotations

import math
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from itertools import groupby
from pathlib import Path

from verification.check import Check

FILE = "verification.html"
ENGINES = ("sffr-gym", "sympy", "pin", "mujoco", "exudyn")  # whose versions the report gives


def write_page(checks: Sequence[Check], folder: Path) -> Path:
    """Write the report into a folder, which is made if it is missing, and return the file.

    Raises:
        ModuleNotFoundError: without jinja2; without matplotlib, if a check has pictures.
    """
    text = page(checks)
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / FILE
    file.write_text(text, encoding="utf-8")
    return file


def page(checks: Sequence[Check]) -> str:
    """The report as HTML."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    from verification.pictures import svg

    environment = Environment(
        loader=PackageLoader("verification"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {"number": number, "svg": svg}
    return environment.get_template("report.html").render(
        sections=[(title, list(members)) for title, members in groupby(checks, key=lambda check: check.section)],
        total=len(checks), failed=sum(not check.passed for check in checks),
        seconds=sum(check.seconds for check in checks), versions=_versions(),
    )  # fmt: skip


def number(value: float, unit: str) -> str:
    """An error or an allowance for people: two digits, a small integer as such."""
    if math.isnan(value):
        return "none"
    digits = f"{value:.0f}" if float(value).is_integer() and value < 1000 else f"{value:.2g}"
    return f"{digits} {unit}".rstrip()


def _versions() -> dict[str, str]:
    found = {}
    for name in ENGINES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
