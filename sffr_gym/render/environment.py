"""Pictures of an environment while it runs: the moments that are drawn, the trace before them, and the window."""

from __future__ import annotations

from typing import Any

import numpy as np

from sffr_gym.config.params import Params
from sffr_gym.config.template import conform
from sffr_gym.physics.kinematics import tip_deflections
from sffr_gym.render.renderer import Renderer, Snapshot
from sffr_gym.render.trace import Moment, Past, Trace
from sffr_gym.render.window import Window
from sffr_gym.task.reference import Reference
from sffr_gym.task.signals import ERROR, VIBRATION
from sffr_gym.task.status import REASONS, RUNNING
from sffr_gym.types import Array

FAR = 1.0e12  # m, rad, J, N, ... and their rates; what a state from outside may have that is drawn


class EnvironmentRenderer:
    """The pictures of one environment: one for every ``every`` seconds, and one of the episode's end.

    Between two of them :meth:`render` returns the same array, which is read-only for that reason: a recorder that
    keeps a picture of each step keeps few of them.

    Args:
        period: control period [s].
        n_panels: number of panels [-].
        every: time between two pictures [s].
        human: whether they are shown in a window.
        damped: whether the panels' virtual damping is recorded, and drawn.
    """

    def __init__(self, period: float, n_panels: int, every: float, human: bool = False, damped: bool = False) -> None:
        self._period = period
        self._stride = max(round(every / period), 1)
        self._trace = Trace(period, n_panels, damped, reserve=every)
        self._window = Window() if human else None
        self._renderer: Renderer
        self._moment: Moment | None = None  # the one that is drawn
        self._drawn: np.ndarray | None = None  # its picture

    def start(self, plant: Params, reference: Reference, title: str, subtitle: str = "") -> None:
        """Begin an episode, or go on with another one; call before everything else."""
        self._renderer = Renderer(plant, reference, title, subtitle)
        self._trace.clear()
        self._moment = self._drawn = None
        if self._window is not None:
            self._window.begin()

    def record(self, moment: Moment, signals: Array, damping: Array) -> None:
        """Keep what later pictures show, and show one in the window if it is due; call after every step and reset.

        Args:
            moment: the present one; copied if it is kept.
            signals: (N_SIGNALS,) in the order of ``SIGNALS``.
            damping: (n_p,) virtual damping of each panel's tip displacement [N s/m]; empty if it is not drawn.
        """
        tick = moment.tick
        if self._trace.is_due(tick):
            tips = tip_deflections(self._renderer.model, moment.p[None])[0]
            self._trace.append((tick * self._period, signals[ERROR], signals[VIBRATION], *tips, *damping))
        last = self._moment
        if last is None or tick // self._stride != last.tick // self._stride or moment.status != RUNNING:
            self._moment, self._drawn = moment.copy(), None
            if self._window is not None and self._window.is_awake(tick):
                self._window.show(self._picture(), tick * self._period)

    def render(self) -> np.ndarray | None:
        """Return the picture (size, size, 3), uint8, of the last moment that is drawn; None if a window shows it."""
        picture = self._picture()
        if self._window is None:
            return picture
        assert self._moment is not None
        self._window.wake()
        self._window.show(picture, self._moment.tick * self._period)
        return None

    def past(self) -> Past:
        """Return what pictures show beside plant and path, for :meth:`restore`."""
        assert self._moment is not None  # there is one since the first reset
        return Past(self._renderer.title, self._trace.rows(), self._moment)

    def check(self, past: Any, present: Moment, where: str = "state.trace") -> None:
        """Make sure that what came from outside can be drawn.

        Args:
            past: what should be of the form of :meth:`past`.
            present: the state that it belongs to, which is sound.
            where: its place, for messages.

        Raises:
            ValueError: if it is of another robot or damaged.
        """
        rows, columns = np.shape(getattr(past, "rows", ()))[:1], self._trace.columns
        conform(past, Past("", np.zeros((*rows, columns)), present), where)
        limits = {"tick": (0, present.tick), "p": (-FAR, FAR), "v": (-FAR, FAR), "applied": (-FAR, FAR)}
        for name, (low, high) in limits.items():
            if not np.all((low <= (values := getattr(past.moment, name))) & (values <= high)):
                raise ValueError(f"{where}.moment.{name}: must lie from {low:g} to {high:g}")
        if past.moment.status not in REASONS:
            raise ValueError(f"{where}.moment.status: is {past.moment.status}; known: {sorted(REASONS)}")
        if not (np.abs(past.rows) <= FAR).all():
            raise ValueError(f"{where}.rows: must lie from {-FAR:g} to {FAR:g}")

    def restore(self, past: Past | None, present: Moment) -> None:
        """Put back what :meth:`past` returned, if there is something; call between :meth:`start` and :meth:`record`.

        Args:
            past: as :meth:`check` lets it through; None for a state whose past is not known.
            present: the state that it belongs to, which is what is drawn if it is the moment to draw.
        """
        if past is not None:
            self._trace.restore(past.rows)
            self._moment = (present if past.moment.tick == present.tick else past.moment).copy()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()

    def __getstate__(self) -> dict[str, object]:
        return self.__dict__ | {"_drawn": None}  # a copy of it would not be read-only

    def _picture(self) -> np.ndarray:
        """Return the picture of the moment to draw: a pure function of that and of the trace before it."""
        if self._drawn is None:
            assert self._moment is not None
            tick, p, v, applied, status = self._moment
            t = tick * self._period
            self._drawn = self._renderer(Snapshot(t, p, v, applied, self._trace.rows_at(t), REASONS[int(status)]))
            self._drawn.flags.writeable = False
        return self._drawn
