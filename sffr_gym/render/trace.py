"""The last seconds of an episode, kept for pictures: a part of the environment's state, so that pictures are one too.

Rows of time [s], tracking error [m], vibration energy [J], each panel's transverse tip deflection [m] and, if it is
recorded, each panel's virtual damping of it [N s/m].
"""

from __future__ import annotations

from collections import deque

import numpy as np

from sffr_gym.types import Array

TIME, ERROR, ENERGY, TIPS = range(4)  # first columns of a row


class Trace:
    """Rows of the last ``SPAN`` seconds, ``EVERY`` so many seconds apart.

    Args:
        period: control period [s].
        n_panels: number of panels [-].
        damped: whether rows have the damping, too.
    """

    SPAN, EVERY = 20.0, 0.05

    def __init__(self, period: float, n_panels: int, damped: bool = False) -> None:
        self._stride = max(round(self.EVERY / period), 1)
        self._columns = TIPS + n_panels * (1 + damped)
        self._rows: deque[tuple[float, ...]] = deque(maxlen=round(self.SPAN / (self._stride * period)) + 1)

    def clear(self) -> None:
        """Forget everything, at the start of an episode."""
        self._rows.clear()

    def is_due(self, tick: int) -> bool:
        """Return whether a row is kept of this control period."""
        return tick % self._stride == 0

    def append(self, row: tuple[float, ...]) -> None:
        """Keep a row."""
        self._rows.append(row)

    def restore(self, rows: Array) -> None:
        """Put back what :meth:`rows` returned."""
        self._rows = deque(map(tuple, rows.tolist()), self._rows.maxlen)

    def rows(self) -> Array:
        """Return what is kept (k, columns)."""
        return np.array(self._rows, dtype=np.float64).reshape(len(self._rows), self._columns)
