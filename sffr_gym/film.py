"""Pictures of environments while they run: what a row of a batch went through, and its renderer."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from sffr_gym.batch import Batch
from sffr_gym.beam import Array
from sffr_gym.episode import Episode
from sffr_gym.geometry import tip_deflections
from sffr_gym.render import Renderer, Snapshot
from sffr_gym.task import ERROR, REASONS, VIBRATION
from sffr_gym.trace import Trace
from sffr_gym.window import Window


class Film:
    """The pictures of ``count`` environments.

    Args:
        period: control period [s].
        n_panels: number of panels.
        count: rows of the batch.
    """

    def __init__(self, period: float, n_panels: int, count: int = 1) -> None:
        self._period = period
        self._traces = [Trace(period, n_panels) for _ in range(count)]
        self._renderers: dict[int, Renderer] = {}
        self._window = Window(period)

    def start(self, i: int, episode: Episode, title: str, subtitle: str = "") -> None:
        """Begin an episode of environment ``i``."""
        self._renderers[i] = Renderer(episode.plant, episode.reference, title, subtitle)
        self._traces[i].clear()

    def note(self, batch: Batch, rows: Iterable[int]) -> None:
        """Keep of the present moment of these environments what later pictures show; call after a step or a reset."""
        for i in rows:
            tick = int(batch.tick[i])
            if self._traces[i].is_due(tick):
                tips = tip_deflections(self._renderers[i].model, batch.p[[i]])[0]
                signals = batch.signals[i]
                self._traces[i].append((tick * self._period, signals[ERROR], signals[VIBRATION], *tips))

    def picture(self, batch: Batch, i: int) -> np.ndarray:
        """The picture (size, size, 3) of environment ``i``, uint8; a pure function of state and trace."""
        t, failure = float(batch.tick[i] * self._period), REASONS[int(batch.status[i])]
        snapshot = Snapshot(t, batch.p[i], batch.v[i], batch.applied[i], self._traces[i].rows(), failure)
        return self._renderers[i](snapshot)

    def trace(self, i: int) -> Array:
        """What was kept of environment ``i`` (k, columns); a part of its state."""
        return self._traces[i].rows()

    def restore(self, i: int, trace: Array) -> None:
        """Put back what :meth:`trace` returned."""
        self._traces[i].clear()
        for row in trace.tolist():
            self._traces[i].append(tuple(row))

    def show(self, batch: Batch, always: bool = False) -> None:
        """Show the first environment in a window, at ``Window.FPS`` pictures for a second of simulated time."""
        if always or self._window.is_due(int(batch.tick[0])):
            self._window.show(self.picture(batch, 0))

    def close(self) -> None:
        """Close the window, if there is one."""
        self._window.close()
