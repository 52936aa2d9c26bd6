"""How everything here is measured: contenders in turns, medians with their spread, one core where one is meant."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from statistics import median
from time import perf_counter
from typing import Any

Contender = Callable[[], float]


@dataclass(frozen=True)
class Row:
    """One measured figure."""

    key: str  #: its name in the JSON, unique within a section
    what: str  #: its name for people
    unit: str  #: of the figure
    samples: tuple[float, ...]  #: the figure in every round
    versus: str = ""  #: key of the row of the same section that this one is to be compared with; empty for none
    note: str = ""  #: what a reader has to know besides
    extra: dict[str, float] = field(default_factory=dict)  #: further figures for the JSON

    @property
    def median(self) -> float:
        """Median of the rounds."""
        return median(self.samples)

    def to_dict(self) -> dict[str, Any]:
        """Return the row for the JSON, its median, lowest and highest figure included."""
        return vars(self) | {"median": self.median, "low": min(self.samples), "high": max(self.samples)}


@dataclass(frozen=True)
class Section:
    """The rows of one subject."""

    name: str  #: short name, as ``--only`` takes it
    title: str  #: for people, conditions included
    rows: list[Row]  #: what was measured
    remarks: list[str] = field(default_factory=list)  #: lines under the table

    def __getitem__(self, key: str) -> Row:
        return next(row for row in self.rows if row.key == key)

    def ratio(self, row: Row) -> float:
        """Return how many times the figure of ``row`` the row is that it is compared with."""
        return self[row.versus].median / row.median


def rounds(contenders: Mapping[str, Contender], repeats: int) -> dict[str, tuple[float, ...]]:
    """Run contenders in turns and collect the figure of each in every round.

    Each runs once beforehand, to warm up. What disturbs the machine for a while hits all of them alike; each round
    starts with another one.
    """
    for run in contenders.values():
        run()
    names = list(contenders)
    samples: dict[str, list[float]] = {name: [] for name in names}
    for k in range(repeats):
        first = k % len(names)
        for name in names[first:] + names[:first]:
            samples[name].append(contenders[name]())
    return {name: tuple(figures) for name, figures in samples.items()}


def seconds(action: Callable[[], Any]) -> float:
    """Measure how long an action takes [s]."""
    start = perf_counter()
    action()
    return perf_counter() - start


@contextmanager
def one_core() -> Iterator[None]:
    """Keep the calling thread, and those that it starts, on one core where the system allows to say so."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(allowed)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)
