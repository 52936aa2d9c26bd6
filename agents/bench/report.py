"""The figures for people and machines: tables of the terminal, JSON, and the generated part of ``docs/speed.md``."""

from __future__ import annotations

import os
import platform
import shlex
from collections.abc import Iterator, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

import sffr_gym
from agents.bench.measure import Row, Section
from agents.bench.precision import PICTURE, save_picture
from agents.bench.targets import Target
from agents.files import to_json, write_whole
from agents.run_folder import git_state, package_version
from sffr_gym import ConfigError

RESULT = "bench.json"
IMAGES = "images"  # folder of a Markdown file's pictures, beside it
PACKAGES = ("numpy", "numba", "scipy", "gymnasium", "mujoco", "sffr-gym")
COLUMNS = ("", "median", "unit", "lowest", "highest", "ours is", "")
NUMBERS = (1, 3, 4, 5)
BEGIN, END = "<!-- written by sffr bench -->", "<!-- end -->"


def section_table(section: Section) -> Table:
    """A section for the terminal."""
    table, rows = _table(section.title), list(_cells(section))
    shown = [k for k in range(len(COLUMNS)) if any(cells[k] for cells in rows)]
    for k in shown:
        table.add_column(COLUMNS[k], justify="right" if k in NUMBERS else "left", no_wrap=k in NUMBERS)
    for cells in rows:
        table.add_row(*(Text(cells[k]) for k in shown))
    return table


def target_table(targets: Sequence[Target]) -> Table:
    """Targets for the terminal."""
    table = _table("Targets")
    for name in ("", "measured", "wanted", ""):
        table.add_column(name, justify="right" if name else "left")
    for target in targets:
        verdict = Text("met", style="green") if target.met else Text("missed", style="bold red")
        table.add_row(*map(Text, _target_cells(target)[:-1]), verdict)
    return table


def write_result(
    folder: Path,
    sections: Sequence[Section],
    targets: Sequence[Target],
    repeats: int,
    quick: bool,
    command: Sequence[str],
) -> Path:
    """Write everything that was measured as JSON, with machine, versions and command."""
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
    folder.mkdir(parents=True, exist_ok=True)
    return write_whole(folder / RESULT, to_json(result).encode())


def machine() -> dict[str, Any]:
    """Processor, system and versions."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "processor": _processor(),
        "cores": cores,
        "system": platform.platform(),
        "python": platform.python_version(),
        "versions": {name: package_version(name) for name in PACKAGES},
        "git": git_state(Path(sffr_gym.__file__).parent),
    }


def write_doc(file: Path, sections: Sequence[Section], targets: Sequence[Target], command: Sequence[str]) -> None:
    """Replace what stands between the markers of a Markdown file by the tables of this run, and its picture.

    Raises:
        ConfigError: if the file is missing or has no markers.
    """
    text = check_doc(file)
    head, tail = text[: text.index(BEGIN)], text[text.index(END) :]
    body = "\n".join(_markdown(sections, targets, command))
    for section in sections:
        if section.name == "precision":
            (file.parent / IMAGES).mkdir(exist_ok=True)
            save_picture(section, file.parent / IMAGES)
    write_whole(file, f"{head}{BEGIN}\n\n{body}\n\n{tail}".encode())


def check_doc(file: Path) -> str:
    """The text of a Markdown file that has the markers; raises ConfigError if it has not."""
    if not file.is_file():
        raise ConfigError(f"{file}: no such file")
    text = file.read_text(encoding="utf-8")
    if not 0 <= text.find(BEGIN) < text.find(END):
        raise ConfigError(f"{file}: must hold the lines {BEGIN!r} and {END!r}, between which the tables go")
    return text


def number(value: float) -> str:
    """Four significant digits, thousands separated."""
    if not isfinite(value):
        return "-"
    if value == 0.0 or 1e-3 <= abs(value) < 1e4:
        return f"{value:.4g}"
    return f"{value:,.0f}" if abs(value) >= 1e4 else f"{value:.1e}"


def _markdown(sections: Sequence[Section], targets: Sequence[Target], command: Sequence[str]) -> Iterator[str]:
    about = machine()
    versions = ", ".join(f"{name} {version}" for name, version in about["versions"].items() if version)
    where = f"{about['processor']}, {about['cores']} cores"
    yield f"`{shlex.join(command)}` on {where}, Python {about['python']}, {versions}."
    if targets:
        yield "\n| target | measured | wanted | |\n|---|--:|--:|---|"
        yield from (_line(_target_cells(target)) for target in targets)
    for section in sections:
        yield f"\n### {section.title}\n"
        yield _line(COLUMNS)
        yield _line(["--:" if k in NUMBERS else "---" for k in range(len(COLUMNS))])
        yield from (_line(cells) for cells in _cells(section))
        yield from (f"\n{remark}" for remark in section.remarks)
        if section.name == "precision":
            yield f"\n![Error at the end of the circle over time]({IMAGES}/{PICTURE})"


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _cells(section: Section) -> Iterator[list[str]]:
    """What, median, unit, lowest, highest, ratio and note of each row."""
    for row in section.rows:
        spread = [number(end) for end in (min(row.samples), max(row.samples))] if len(row.samples) > 1 else ["", ""]
        ratio = f"{number(section.ratio(row))} times" if row.versus else ""
        yield [row.what, number(row.median), row.unit, *spread, ratio, row.note]


def _target_cells(target: Target) -> list[str]:
    bound = f"{'at least' if target.at_least else 'at most'} {number(target.wanted)} {target.unit}".rstrip()
    return [target.what, f"{number(target.value)} {target.unit}".rstrip(), bound, "met" if target.met else "missed"]


def _row_entry(section: Section, row: Row) -> dict[str, Any]:
    return row.to_dict() | ({"ours_is_times": section.ratio(row)} if row.versus else {})


def _table(title: str) -> Table:
    return Table(title=Text(title), box=box.SIMPLE_HEAD, show_edge=False, title_style="bold", title_justify="left")


def _processor() -> str:
    """The processor's name where the system tells it, else its architecture."""
    file = Path("/proc/cpuinfo")
    if file.is_file():
        for line in file.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
