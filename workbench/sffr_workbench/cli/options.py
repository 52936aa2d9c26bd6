"""Options that several commands share: one name, one meaning and one help text."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from math import inf, isfinite
from typing import Annotated, Any

import typer

MOST_JOBS = 4 * (os.cpu_count() or 1)  # more only take memory, some 200 MB each, whatever limits the default
DIGITS = 18
_WHOLE = re.compile(rf"[-+]?[0-9]{{1,{DIGITS}}}")  # as in a file: no blanks, no 1_000, no digits of other scripts
_NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")


def whole(least: float = -inf, most: float = inf) -> Callable[[str | int], int]:
    """Return what reads a whole number from ``least`` to ``most``, for an option's ``parser``."""

    def whole_number(text: str | int) -> int:
        if not _WHOLE.fullmatch(str(text)):
            raise typer.BadParameter(f"{str(text)[:60]!r} is no whole number of at most {DIGITS} digits")
        return int(_within(int(text), least, most))

    return whole_number


def number(least: float = -inf, most: float = inf) -> Callable[[str | float], float]:
    """Return what reads a finite number from ``least`` to ``most``; see :func:`whole`."""

    def finite_number(text: str | float) -> float:
        if not (_NUMBER.fullmatch(str(text)) and isfinite(float(text))):
            raise typer.BadParameter(f"{str(text)[:60]!r} is no finite number")
        return _within(float(text), least, most)

    return finite_number


def _within(value: float, least: float, most: float) -> float:
    """Return a value that lies in a range; raise the command line's error for another."""
    if not least <= value <= most:
        bounds = f"from {least} to {most}" if most < inf else f"at least {least}"
        raise typer.BadParameter(f"{value} must be {bounds}")
    return value


def option(flags: str, help: str, metavar: str | None = None, shown: bool | str = True, **settings: Any) -> Any:
    """Return an option of a command.

    Args:
        flags: its names, separated by blanks.
        help: a sentence.
        metavar: what help calls its value.
        shown: False to hide its default in help, or what to show for it.
        settings: further ones of ``typer.Option``.
    """
    return typer.Option(*flags.split(), help=help, metavar=metavar, show_default=shown, **settings)


def argument(metavar: str, help: str, shown: bool | str = True) -> Any:
    """Return an argument of a command; see :func:`option`."""
    return typer.Argument(metavar=metavar, help=help, show_default=shown)


ParamsFile = Annotated[str | None, option("--params", "YAML file over the case study.", "FILE", "the case study")]
Overrides = Annotated[
    list[str] | None, option("--set", "Change a parameter, SI units, such as panel.EI=25; repeatable.", "KEY=VALUE")
]
ScenarioName = Annotated[str, option("--scenario -s", "Shipped scenario's name, or a YAML file.", "S")]
FirstSeed = Annotated[int, option("--seed", "Seed of the first episode; the next ones count up.", "K", parser=whole())]
Jobs = Annotated[
    int | None,
    option("--jobs -j", "Processes; no result depends on it.", "N", "all that may be used", parser=whole(1, MOST_JOBS)),
]
BackendName = Annotated[
    str, option("--backend", "What runs them: loky (processes of this machine), ray or dask, extra cluster.", "B")
]
Address = Annotated[
    str | None, option("--address", "Head of a Ray cluster, or Dask's scheduler.", "HOST:PORT", "one on this machine")
]
Quiet = Annotated[bool, option("--quiet -q", "Print errors only.")]
Overwrite = Annotated[bool, option("--overwrite", "Replace FILE.")]
