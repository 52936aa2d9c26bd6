"""What a check returns, and the few measures that several checks share."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


class Picture(NamedTuple):
    """A figure for the report, drawn when the page is written.

    Attributes:
        title: heading.
        caption: what to see.
        draw: returns a Matplotlib figure.
    """

    title: str
    caption: str
    draw: Callable[[], Any]


class Check(NamedTuple):
    """The outcome of one comparison.

    Attributes:
        name: what was checked.
        against: what it was compared with.
        error: measured, in ``unit``.
        allowed: largest error that passes.
        unit: of both; empty for a ratio.
        passed: whether ``error <= allowed`` (a NaN fails).
        seconds: time that it took [s].
        note: the reason of the allowance and what else was found.
        pictures: for the report.
        section: heading under which the report lists it.
    """

    name: str
    against: str
    error: float
    allowed: float
    unit: str
    passed: bool
    seconds: float
    note: str
    pictures: tuple[Picture, ...] = ()
    section: str = ""


def judge(name: str, against: str, error: float, allowed: float, unit: str, note: str, *pictures: Picture) -> Check:
    """Make a check of a measured error; its time is filled in by whoever runs it."""
    error = float(error)
    passed = bool(error <= allowed) and not math.isnan(error)
    return Check(name, against, error, allowed, unit, passed, 0.0, note, pictures)


def rms(values: ArrayLike) -> float:
    """Root mean square of all entries."""
    return float(np.sqrt(np.mean(np.square(values))))


def relative(value: ArrayLike, reference: ArrayLike) -> float:
    """Largest difference of two arrays over the largest entry of the reference."""
    reference = np.asarray(reference, dtype=float)
    return float(np.abs(np.asarray(value, dtype=float) - reference).max() / np.abs(reference).max())
