"""What a check returns, and the few measures that several checks share."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike


class CheckFigure(NamedTuple):
    """A figure for the page, drawn when that is written."""

    title: str  #: heading
    caption: str  #: what to see
    draw: Callable[[], Any]  #: returns a Matplotlib figure


class Check(NamedTuple):
    """The outcome of one comparison."""

    name: str  #: what was checked
    against: str  #: what it was compared with
    error: float  #: measured, in ``unit``
    allowed: float  #: largest error that passes
    unit: str  #: of both; empty for a ratio
    passed: bool  #: whether ``error <= allowed`` (a NaN fails)
    seconds: float  #: time that it took [s]
    note: str  #: the reason of the allowance and what else was found
    figures: tuple[CheckFigure, ...] = ()  #: for the page
    section: str = ""  #: heading under which the page lists it


def make_check(
    name: str, against: str, error: float, allowed: float, unit: str, note: str, *figures: CheckFigure
) -> Check:
    """Make a check of a measured error; its time is filled in by whoever runs it."""
    error = float(error)
    passed = bool(error <= allowed) and not math.isnan(error)
    return Check(name, against, error, allowed, unit, passed, 0.0, note, figures)


def rms(values: ArrayLike) -> float:
    """Return the root mean square of all entries."""
    return float(np.sqrt(np.mean(np.square(values))))


def relative(value: ArrayLike, reference: ArrayLike) -> float:
    """Return the largest difference of two arrays over the largest entry of the reference."""
    reference = np.asarray(reference, dtype=float)
    return float(np.abs(np.asarray(value, dtype=float) - reference).max() / np.abs(reference).max())
