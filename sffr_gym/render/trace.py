"""What is kept of an episode for pictures: a part of the environment's state, so that pictures are one too.

The trace of the last seconds has rows of time [s], tracking error [m], vibration energy [J], each panel's transverse
tip deflection [m] and, if it is recorded, each panel's virtual damping of it [N s/m].
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple, Self

import numpy as np

from sffr_gym.types import Array

TIME, ERROR, ENERGY, TIPS = range(4)  # first columns of a row


class Moment(NamedTuple):
    """What is drawn of an environment's state."""

    tick: int  #: control periods since the start [-]
    p: Array  #: (n,) positions of the plant
    v: Array  #: (n,) its velocities
    applied: Array  #: (n_u,) command after the limits
    status: float  #: why the episode ended, a key of ``REASONS``

    def copy(self) -> Self:
        """Return one that later steps do not change."""
        return self._replace(p=self.p.copy(), v=self.v.copy(), applied=self.applied.copy())


class Past(NamedTuple):
    """What pictures show beside the episode's plant and path."""

    title: str  #: written above
    rows: Array  #: (k, columns) of the trace
    moment: Moment  #: the one that is drawn


class Trace:
    """Rows of the last ``SPAN`` seconds, ``EVERY`` so many seconds apart, or one for each step where these are longer.

    Args:
        period: control period [s].
        n_panels: number of panels [-].
        damped: whether rows have the damping, too.
        reserve: how long after a moment its rows are still asked for [s].

    Attributes:
        columns: of a row.
    """

    SPAN, EVERY = 20.0, 0.05

    def __init__(self, period: float, n_panels: int, damped: bool = False, reserve: float = 0.0) -> None:
        self._period = period
        self._stride = max(round(self.EVERY / period), 1)
        self.columns = TIPS + n_panels * (1 + damped)
        most = round((self.SPAN + reserve) / (self._stride * period)) + 2
        self._rows: deque[tuple[float, ...]] = deque(maxlen=most)

    def clear(self) -> None:
        """Forget everything, at the start of an episode."""
        self._rows.clear()

    def is_due(self, tick: int) -> bool:
        """Return whether a row is kept of this control period: the first one, and the first of each interval."""
        if not self._rows:
            return True
        return tick // self._stride != round(self._rows[-1][TIME] / self._period) // self._stride

    def append(self, row: tuple[float, ...]) -> None:
        """Keep a row."""
        self._rows.append(row)

    def restore(self, rows: Array) -> None:
        """Put back what :meth:`rows` returned."""
        self._rows = deque(map(tuple, rows.tolist()), self._rows.maxlen)

    def rows(self) -> Array:
        """Return what is kept (k, columns)."""
        return np.array(self._rows, dtype=np.float64).reshape(len(self._rows), self.columns)

    def rows_at(self, t: float) -> Array:
        """Return the rows (k, columns) of the ``SPAN`` before a time [s], whatever came after it."""
        rows, half = self.rows(), 0.5 * self._period
        return rows[(rows[:, TIME] > t - self.SPAN - half) & (rows[:, TIME] < t + half)]
