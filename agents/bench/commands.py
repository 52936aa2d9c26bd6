"""The command ``sffr bench``: arguments, and what the terminal shows."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from agents.user_errors import user_errors
from sffr_gym import ConfigError


def add_commands(app: typer.Typer) -> None:
    """Add the command of this module to the command line."""
    app.command("bench")(bench_command)


def bench_command(
    quick: Annotated[
        bool, typer.Option("--quick", help="Tiny runs that show that everything works, not how fast.")
    ] = False,
    only: Annotated[
        str | None,
        typer.Option(
            "--only",
            metavar="A,B",
            show_default="all",
            help="Some of physics, loop, gym, vector, growth, memory, starts, precision, profile.",
        ),
    ] = None,
    repeats: Annotated[
        int | None,
        typer.Option(
            "--repeats", metavar="N", min=1, help="Rounds of each comparison.", show_default="7, or 2 if quick"
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder of bench.json and the picture.")
    ] = Path("runs/bench"),
    doc: Annotated[
        Path | None, typer.Option("--doc", metavar="FILE", help="Markdown file to write the tables into.")
    ] = None,
) -> None:
    """Measure the speed of the simulator and its environments, side by side with MuJoCo, SciPy and Gymnasium.

    Prints tables and whether the targets are met; writes bench.json and work_precision.png. All of it takes about a
    quarter of an hour and wants the machine to itself. Needs the extra bench.
    """
    with user_errors():
        try:
            from agents.bench import report, suite
            from agents.bench.precision import save_picture
            from agents.bench.targets import judge
        except ModuleNotFoundError as error:
            if error.name not in {"mujoco", "psutil", "matplotlib"}:
                raise
            raise ConfigError(f"{error}; pip install 'sffr-gym[bench]'") from None
        names = suite.choose(only)
        if doc is not None:
            report.check_doc(doc)
        repeats = repeats or (suite.QUICK_REPEATS if quick else suite.REPEATS)
        console, notes = Console(highlight=False), Console(stderr=True, highlight=False)
        command, sections = ["sffr", *sys.argv[1:]], []
        for name in names:
            notes.print(f"measuring {name} ...", style="dim")
            section = suite.MEASUREMENTS[name](repeats, quick)
            sections.append(section)
            console.print(report.section_table(section))
            for line in section.remarks:
                console.print(line, style="dim", markup=False)
            console.print()
        targets = [] if quick else judge(sections)
        if targets:
            console.print(report.target_table(targets))
        written = [report.write_result(out, sections, targets, repeats, quick, command)]
        written += [save_picture(section, out) for section in sections if section.name == "precision"]
        if doc is not None:
            report.write_doc(doc, sections, targets, command)
            written.append(doc)
    console.print(f"\n{', '.join(map(str, written))}", markup=False, soft_wrap=True)
