"""Options that several commands share: one name, one meaning and one help text."""

from __future__ import annotations

from typing import Annotated

import typer

ParamsFile = Annotated[
    str | None,
    typer.Option("--params", metavar="FILE", help="YAML file over the case study.", show_default="the case study"),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change a parameter, SI units, such as panel.EI=25; repeatable."),
]
ScenarioName = Annotated[
    str, typer.Option("--scenario", "-s", metavar="S", help="Shipped scenario's name, or a YAML file.")
]
FirstSeed = Annotated[
    int, typer.Option("--seed", metavar="K", help="Seed of the first episode; the next ones count up.")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]
