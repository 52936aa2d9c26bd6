"""The page of ``sffr verify``: one HTML file with the table of checks and the figures, light and dark."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from sffr_gym.config.provenance import package_version
from sffr_gym.config.run_folder import RunFolder
from sffr_workbench.common import format_error, template
from sffr_workbench.verify.check import Check
from sffr_workbench.verify.figures import svg

PAGE_FILE = "verification.html"
ENGINES = ("sffr-gym", "sympy", "pin", "mujoco", "exudyn")  # whose versions the page gives


def write_page(checks: Sequence[Check], run: RunFolder) -> Path:
    """Write the page of a finished verification into its folder and return the file.

    Raises:
        ModuleNotFoundError: without jinja2; without matplotlib, if a check has figures.
    """
    (file,) = run.replace({PAGE_FILE: checks_page(checks).encode()}, remove=run.files)
    return file


def checks_page(checks: Sequence[Check]) -> str:
    """Return the checks as HTML."""
    versions = {name: version for name in ENGINES if (version := package_version(name))}
    return template("sffr_workbench.verify", {"error": format_error, "svg": svg}).render(
        sections=[(title, list(members)) for title, members in groupby(checks, key=lambda check: check.section)],
        total=len(checks), failed=sum(not check.passed for check in checks),
        seconds=sum(check.seconds for check in checks), versions=versions,
    )  # fmt: skip
