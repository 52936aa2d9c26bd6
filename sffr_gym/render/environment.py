"""Pictures of an environment while it runs: what of its past the small plots show, its renderer and its window."""

from __future__ import annotations

import numpy as np

from sffr_gym.physics.kinematics import tip_deflections
from sffr_gym.render.renderer import Renderer, Snapshot
from sffr_gym.render.trace import Trace
from sffr_gym.render.window import Window
from sffr_gym.task.episode import Episode
from sffr_gym.task.signals import ERROR, VIBRATION
from sffr_gym.task.status import REASONS
from sffr_gym.types import Array


class EnvironmentRenderer:
    """The pictures of one environment.

    Args:
        period: control period [s].
        n_panels: number of panels [-].
        damped: whether their virtual damping is recorded, and drawn.

    Attributes:
        trace: what was recorded, a part of the environment's state.
    """

    def __init__(self, period: float, n_panels: int, damped: bool = False) -> None:
        self._period = period
        self.trace = Trace(period, n_panels, damped)
        self._renderer: Renderer
        self._window = Window(period)

    def start(self, episode: Episode, title: str, subtitle: str = "") -> None:
        """Begin an episode; call before everything else."""
        self._renderer = Renderer(episode.plant, episode.reference, title, subtitle)
        self.trace.clear()

    def record(self, tick: int, p: Array, signals: Array, damping: Array) -> None:
        """Keep of a moment what later pictures show; call after every step and reset.

        Args:
            tick: control periods since the start [-].
            p: (n,) positions of the plant.
            signals: (N_SIGNALS,) in the order of ``SIGNALS``.
            damping: (n_p,) virtual damping of each panel's tip displacement [N s/m]; empty if it is not drawn.
        """
        if self.trace.is_due(tick):
            tips = tip_deflections(self._renderer.model, p[None])[0]
            self.trace.append((tick * self._period, signals[ERROR], signals[VIBRATION], *tips, *damping))

    def render(self, tick: int, p: Array, v: Array, applied: Array, status: float) -> np.ndarray:
        """Return the picture (size, size, 3) of a moment, uint8; a pure function of the arguments and the trace.

        Args:
            tick: control periods since the start [-].
            p: (n,) positions of the plant.
            v: (n,) its velocities.
            applied: (n_u,) command after the limits.
            status: why the episode ended, a key of ``REASONS``.
        """
        return self._renderer(Snapshot(tick * self._period, p, v, applied, self.trace.rows(), REASONS[int(status)]))

    def show(self, tick: int, p: Array, v: Array, applied: Array, status: float, always: bool = False) -> None:
        """Show the picture of a moment in a window if one is due, ``Window.FPS`` for a second of simulated time."""
        if always or self._window.is_due(tick):
            self._window.show(self.render(tick, p, v, applied, status))

    def close(self) -> None:
        """Close the window, if there is one."""
        self._window.close()
