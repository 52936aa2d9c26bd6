"""Measurements for people and machines: tables of the terminal, JSON, and the generated part of ``docs/speed.md``."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

import sffr_gym
from sffr_gym import ConfigError
from sffr_gym.compile.threads import available_cores
from sffr_gym.config.files import check_target, to_json, write_whole
from sffr_gym.config.provenance import git_state, package_version
from sffr_gym.config.reading import read_text
from sffr_gym.config.run_folder import RunFolder
from sffr_workbench.common import describe_versions, markdown_table, terminal_table
from sffr_workbench.common.numbers import format_measurement
from sffr_workbench.speed.measure import Row, Section
from sffr_workbench.speed.precision import PICTURE, draw_picture
from sffr_workbench.speed.targets import Target

RESULT_FILE, DRAWN = "bench.json", "precision"  # the latter is the section with a picture
IMAGES = "images"  # folder of a Markdown file's pictures, beside it
PACKAGES = ("numpy", "numba", "scipy", "gymnasium", "mujoco", "sffr-gym")
COLUMNS = ("", "median", "unit", "lowest", "highest", "ours is", "")
TEXTS = (0, 2, 6)  # columns; the others hold numbers
BEGIN, END = "<!-- written by sffr bench -->", "<!-- end -->"
MOST_DOC = 10_000_000  # bytes of a Markdown file

DocWriter = Callable[[Sequence[Section], Sequence[Target], Sequence[str]], None]


def section_table(section: Section) -> Table:
    """Return a section for the terminal."""
    table, rows = terminal_table(section.title), list(_cells(section))
    shown = [k for k in range(len(COLUMNS)) if any(cells[k] for cells in rows)]
    for k in shown:
        table.add_column(COLUMNS[k], justify="left" if k in TEXTS else "right", no_wrap=k not in TEXTS)
    for cells in rows:
        table.add_row(*(Text(cells[k]) for k in shown))
    return table


def target_table(targets: Sequence[Target]) -> Table:
    """Return targets for the terminal."""
    table = terminal_table("Targets")
    for name in ("", "measured", "required", ""):
        table.add_column(name, justify="right" if name else "left")
    for target in targets:
        verdict = Text("met", style="green") if target.met else Text("missed", style="bold red")
        table.add_row(*map(Text, _target_cells(target)[:-1]), verdict)
    return table


def result_json(
    sections: Sequence[Section],
    targets: Sequence[Target],
    repeats: int,
    quick: bool,
    command: Sequence[str],
) -> str:
    """Return everything that was measured as JSON, with machine, versions and command."""
    result = {
        "command": shlex.join(command),
        "quick": quick,
        "repeats": repeats,
        "machine": machine(),
        "targets": [target._asdict() | {"met": target.met} for target in targets],
        "sections": {
            section.name: {
                "title": section.title,
                "rows": [_row_entry(section, row) for row in section.rows],
                "remarks": section.remarks,
            }
            for section in sections
        },
    }
    return to_json(result)


def picture(sections: Sequence[Section]) -> dict[str, bytes]:
    """Return the picture of what was measured by its name; none if there is nothing to draw."""
    drawn = [section for section in sections if section.name == DRAWN]
    return {PICTURE: draw_picture(drawn[0])} if drawn else {}


def machine() -> dict[str, Any]:
    """Return processor, system and versions."""
    return {
        "processor": _processor(),
        "cores": available_cores(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "versions": {name: package_version(name) for name in PACKAGES},
        "git": git_state(Path(sffr_gym.__file__).parent),
    }


@contextmanager
def claimed_doc(file: Path, drawn: bool) -> Iterator[DocWriter]:
    """Keep a Markdown file's folder for tables and picture of this run, and return what writes them.

    Args:
        file: has the markers between which the tables go.
        drawn: whether there will be a picture, which goes into the folder ``images`` beside the file.

    Raises:
        ConfigError: if the file is missing, cannot be written or has no markers, or something of others is where the
            picture would go; nothing has changed then.
    """
    check_doc(file)
    check_target(file, overwrite=True)
    if not drawn:
        yield partial(_write_tables, file)
        return
    with RunFolder.claim(file.absolute().parent, "pages", resume=True, shared=True) as pages:
        pages.check_names([f"{IMAGES}/{PICTURE}"])

        def write(sections: Sequence[Section], targets: Sequence[Target], command: Sequence[str]) -> None:
            pages.replace({f"{IMAGES}/{name}": content for name, content in picture(sections).items()})
            _write_tables(file, sections, targets, command)

        yield write


def check_doc(file: Path) -> str:
    """Read a Markdown file that has the markers.

    Raises:
        ConfigError: if it is missing or has none.
    """
    text = read_text(file, MOST_DOC)
    if not 0 <= text.find(BEGIN) < text.find(END):
        raise ConfigError(f"{file}: must hold the lines {BEGIN!r} and {END!r}, between which the tables go")
    return text


def _write_tables(file: Path, sections: Sequence[Section], targets: Sequence[Target], command: Sequence[str]) -> None:
    """Replace what stands between the markers of a Markdown file by the tables of this run."""
    text = check_doc(file)
    head, tail = text[: text.index(BEGIN)], text[text.index(END) :]
    body = "\n".join(_markdown(sections, targets, command))
    write_whole(file, f"{head}{BEGIN}\n\n{body}\n\n{tail}".encode())


def _markdown(sections: Sequence[Section], targets: Sequence[Target], command: Sequence[str]) -> Iterator[str]:
    about = machine()
    where = f"{about['processor']}, {about['cores']} cores"
    yield f"`{shlex.join(command)}` on {where}, Python {about['python']}, {describe_versions(about['versions'])}."
    if targets:
        yield "\n" + markdown_table(["target", "measured", "required", ""], map(_target_cells, targets), texts=(0, 3))
    for section in sections:
        yield f"\n### {section.title}\n"
        yield markdown_table(COLUMNS, _cells(section), TEXTS)
        yield from (f"\n{remark}" for remark in section.remarks)
        if section.name == DRAWN:
            yield f"\n![Error at the end of the circle over time]({IMAGES}/{PICTURE})"


def _cells(section: Section) -> Iterator[list[str]]:
    """Return what, median, unit, lowest, highest, ratio and note of each row."""
    for row in section.rows:
        spread = (
            [format_measurement(end) for end in (min(row.samples), max(row.samples))]
            if len(row.samples) > 1
            else ["", ""]
        )
        ratio = f"{format_measurement(section.ratio(row))} times" if row.versus else ""
        yield [row.what, format_measurement(row.median), row.unit, *spread, ratio, row.note]


def _target_cells(target: Target) -> list[str]:
    bound = (
        f"{'at least' if target.at_least else 'at most'} {format_measurement(target.required)} {target.unit}".rstrip()
    )
    return [
        target.what,
        f"{format_measurement(target.value)} {target.unit}".rstrip(),
        bound,
        "met" if target.met else "missed",
    ]


def _row_entry(section: Section, row: Row) -> dict[str, Any]:
    return row.to_dict() | ({"ours_is_times": section.ratio(row)} if row.versus else {})


def _processor() -> str:
    """Return the processor's name where the system tells it, else its architecture."""
    file = Path("/proc/cpuinfo")
    if file.is_file():
        for line in file.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
