"""The command ``sffr bench``: arguments, and what the terminal shows."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from sffr_gym.config.run_folder import RunFolder
from sffr_workbench.cli.options import option, whole
from sffr_workbench.cli.terminal import consoles, interruptible, typed_command
from sffr_workbench.common import require


def add_commands(app: typer.Typer) -> None:
    """Add the command of this module to the command line."""
    app.command("bench")(bench_command)


def bench_command(
    quick: Annotated[bool, option("--quick", "Tiny runs that show that everything works, not how fast.")] = False,
    only: Annotated[
        str | None,
        option(
            "--only", "Some of physics, loop, gym, vector, growth, memory, starts, precision, profile.", "A,B", "all"
        ),
    ] = None,
    repeats: Annotated[
        int | None, option("--repeats", "Rounds of each comparison.", "N", "7, or 2 if quick", parser=whole(1, 1000))
    ] = None,
    out: Annotated[Path, option("--out -o", "Folder of bench.json and the picture.", "DIR")] = Path("runs/bench"),
    doc: Annotated[Path | None, option("--doc", "Markdown file to write the tables into.", "FILE")] = None,
    overwrite: Annotated[bool, option("--overwrite", "Replace finished measurements in DIR.")] = False,
) -> None:
    r"""Measure the speed of the simulator and its environments, side by side with MuJoCo, SciPy and Gymnasium.

    Prints tables and whether the targets are met; writes bench.json and work_precision.png. All of it takes about a
    quarter of an hour and wants the machine to itself. Needs the extra [bold]bench[/]:
    pip install "sffr-gym\[bench]".
    """
    require("bench", "mujoco", "imageio", "psutil", "matplotlib")
    from sffr_workbench.speed import page, suite  # these need what was just required
    from sffr_workbench.speed.precision import PICTURE
    from sffr_workbench.speed.targets import check_targets

    names = suite.choose(only)
    repeats = repeats or (suite.QUICK_REPEATS if quick else suite.REPEATS)
    notes, results = consoles()
    command, sections = typed_command(), []
    with interruptible(notes, f"nothing was written to {out}"), ExitStack() as claimed:
        run = claimed.enter_context(RunFolder.claim(out, "speed", overwrite=overwrite))
        run.check_names([page.RESULT_FILE, PICTURE])
        write_doc = claimed.enter_context(page.claimed_doc(doc, page.DRAWN in names)) if doc is not None else None
        for name in names:
            notes.print(f"measuring {name} ...", style="dim")
            section = suite.MEASUREMENTS[name](repeats, quick)
            sections.append(section)
            results.print(page.section_table(section))
            for line in section.remarks:
                results.print(line, style="dim", markup=False)
            results.print()
        targets = [] if quick else check_targets(sections)
        if targets:
            results.print(page.target_table(targets))
        contents = {page.RESULT_FILE: page.result_json(sections, targets, repeats, quick, command).encode()}
        written = run.replace(contents | page.picture(sections), remove=run.files)
        if doc is not None and write_doc is not None:
            write_doc(sections, targets, command)
            written.append(doc)
    results.print(f"\n{', '.join(map(str, written))}", markup=False, soft_wrap=True)
