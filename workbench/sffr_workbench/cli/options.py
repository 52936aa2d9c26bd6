"""Options that several commands share: one name, one meaning and one help text."""

from __future__ import annotations

from typing import Annotated, Any

import typer


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
FirstSeed = Annotated[int, option("--seed", "Seed of the first episode; the next ones count up.", "K")]
Quiet = Annotated[bool, option("--quiet -q", "Print errors only.")]
Overwrite = Annotated[bool, option("--overwrite", "Replace FILE.")]
