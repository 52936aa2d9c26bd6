"""What all kinds of trials share: what a trial is, how its files are laid out, and what counts as a violation."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from hypothesis.strategies import SearchStrategy

WORKED, REFUSED = "worked", "refused"
MOST_LINE = 2000  # characters of an error; nobody reads more
CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f\x80-\x9f]")  # would steer the reader's terminal


class Special(NamedTuple):
    """What lies in a file's place."""

    kind: str  #: "folder", "pipe", "link" or "sparse"
    what: str = ""  #: where the link leads, or the size in bytes


Content = bytes | Special
Tree = Mapping[str, Content]


@dataclass(frozen=True)
class Trial:
    """One hostile input."""

    story: str  #: what is wrong with it, in a line
    target: str  #: what gets it
    tree: Tree = field(default_factory=dict)  #: the files, by their names


class Violation(Exception):
    """The product neither did what it should nor said in a line why not."""


class Kind(Protocol):
    """A kind of hostile inputs; a worker process has one."""

    name: str
    most_seconds: float  #: of a trial
    most_memory: float  #: bytes that a trial may add

    def make_exemplars(self, folder: Path) -> None:
        """Write the valid inputs that are tampered with, once for all workers."""

    def load(self, folder: Path) -> None:
        """Read the exemplars, and let everything be compiled that trials need."""

    def trials(self) -> SearchStrategy[Trial]:
        """Return what draws the trials."""

    def attempt(self, trial: Trial, folder: Path) -> tuple[str, dict[str, int]]:
        """Give the product a trial, whose files lie in a folder of its own.

        Returns:
            WORKED or REFUSED, and counts for the report.

        Raises:
            Violation: if it did something else; every other exception is one too.
        """


def read_tree(folder: Path) -> dict[str, bytes]:
    """Return the files below a folder."""
    return {
        file.relative_to(folder).as_posix(): file.read_bytes() for file in sorted(folder.rglob("*")) if file.is_file()
    }


def lay_out(tree: Tree, folder: Path) -> None:
    """Write files; what cannot be written because another entry is in its way is left out."""
    for name, content in sorted(tree.items()):
        place = folder / name
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            if isinstance(content, bytes):
                place.write_bytes(content)
            elif content.kind == "folder":
                place.mkdir(exist_ok=True)
            elif content.kind == "pipe":
                os.mkfifo(place)
            elif content.kind == "link":
                place.symlink_to(content.what)
            else:
                with place.open("wb") as file:
                    file.truncate(int(content.what))
        except OSError:
            continue


def fingerprint(folder: Path, without: Collection[str] = ()) -> dict[str, Any]:
    """Return what lies below a folder, links as links, to see later whether anything changed."""
    found: dict[str, Any] = {}
    for place in sorted(folder.rglob("*")):
        name = place.relative_to(folder).as_posix()
        if any(name == each or name.startswith(f"{each}/") for each in without):
            continue
        about = place.lstat()
        small = place.is_file() and not place.is_symlink() and about.st_size < 10**8
        found[name] = os.readlink(place) if place.is_symlink() else place.read_bytes() if small else about.st_mode
    return found


def check_unchanged(before: Mapping[str, Any], after: Mapping[str, Any], whose: str) -> None:
    """Raise Violation if files went, came or changed."""
    for what, names in (
        ("removed", before.keys() - after.keys()), ("left", after.keys() - before.keys()),
        ("changed", {name for name in before.keys() & after.keys() if before[name] != after[name]}),
    ):  # fmt: skip
        if names:
            raise Violation(f"{what} {whose}: {', '.join(sorted(names)[:5])}")


def check_refusal(text: str, places: Collection[str], prefix: str = "") -> None:
    """Raise Violation unless a refusal is lines that each name one of the places, and no more than that."""
    lines = [line for line in text.splitlines() if line.strip()]
    if not lines:
        raise Violation("refused without a word")
    for line in lines:
        if not line.startswith(prefix):
            raise Violation(f"refused by a line that is no error: {line[:200]!r}")
        if not any(place in line for place in places):
            raise Violation(f"refused without naming {' or '.join(sorted(places))}: {line[:300]!r}")
        if len(line) > MOST_LINE:
            raise Violation(f"refused by a line of {len(line)} characters: {line[:200]!r}")
        if CONTROL.search(line):
            raise Violation(f"refused by a line that steers the terminal: {line[:200]!r}")
