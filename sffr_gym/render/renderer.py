"""The picture of a moment: the robot on its path, its panels' swing, its forces, and small plots of the last seconds.

:class:`Renderer` is a pure function of a :class:`Snapshot`: the same snapshot gives the same pixels on every machine
with the same Pillow. It needs the extra ``render``, and is imported when a picture is asked for.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sffr_gym.config.params import Params
from sffr_gym.physics.kinematics import modal_tip_deflections, tip_deflections
from sffr_gym.physics.model import N_BASE, mode_slice, object_slice
from sffr_gym.physics.simulator import Simulator
from sffr_gym.render.canvas import Canvas, Colour
from sffr_gym.render.geometry import force_scales, path_points, track_of
from sffr_gym.render.plots import FAINT, GUTTER, INK, Axis, Plot, draw_plot, linear, logarithmic, with_unit
from sffr_gym.render.robot import (
    FORCE,
    Viewport,
    draw_arm,
    draw_base,
    draw_dashed_panel,
    draw_object,
    draw_panel,
    draw_plumes,
    draw_swing,
    voltage_colour,
)
from sffr_gym.render.trace import ENERGY, ERROR, TIME, TIPS, Trace
from sffr_gym.task.quasi_static import quasi_static_at
from sffr_gym.task.reference import Reference
from sffr_gym.types import Array

SIZE = 600  # pixels of either side
EXAGGERATION = 5.0  # times the true deflections
SPACE: Colour = (11, 16, 32)
SHADE: Colour = (*SPACE[:3], 190)
DOT: Colour = (48, 58, 84)
AHEAD: Colour = (52, 64, 96)
COVERED: Colour = (122, 142, 190)
ALARM: Colour = (255, 110, 110)
ACCENT: Colour = (120, 180, 255)
THRUST: Colour = (255, 176, 96)
SIDES: tuple[Colour, ...] = ((120, 200, 255), (255, 190, 90), (150, 230, 140), (240, 140, 220))  # a panel's line each
SWING = 10.0  # s over which the bars beyond the tips show how far they swung, about a period of the first mode
LEAST_PACE = 1.0e-3  # m/s; slower, all of a path is near
MARGIN = 0.55  # m around the robot
DOTS = 8  # from the middle to an edge at most


class Snapshot(NamedTuple):
    """What a picture shows."""

    t: float  #: time [s]
    p: Array  #: (n,) the plant's positions and velocities
    v: Array  #: (n,)
    applied: Array  #: (n_u,) command after the limits
    trace: Array  #: (k, columns) what has been; see :mod:`sffr_gym.render.trace`
    failure: str = ""  #: why the episode ended; empty if it goes on


class Style(NamedTuple):
    """How pictures look.

    Attributes:
        size: pixels of either side.
        exaggeration: factor of the drawn deflections [-].
        span: time that the small plots show [s].
        colour: of the title.
        axes: ranges of the plots by their titles, instead of what suits each picture; for pictures side by side.
    """

    size: int = SIZE
    exaggeration: float = EXAGGERATION
    span: float = Trace.SPAN
    colour: Colour = ACCENT
    axes: dict[str, Axis] = {}


class Renderer:
    """Draws a robot in an episode.

    Args:
        params: the robot as it is.
        reference: the desired motion.
        title, subtitle: what is written above.
        style: how pictures look.
    """

    def __init__(
        self, params: Params, reference: Reference, title: str, subtitle: str = "", style: Style | None = None
    ) -> None:
        self.params, self.reference, self.title, self.subtitle = params, reference, title, subtitle
        self.style = style or Style()
        self._sim = Simulator(params)
        self.model = self._sim.model
        self._scales, self._track = force_scales(params, self.model), track_of(reference)
        self._tips = slice(TIPS, TIPS + len(params.panel.mounts))  # of a trace
        self._u = self.style.size / SIZE
        self._top, self._bottom = 52 * self._u, 452 * self._u  # of the robot's part between title and plots

    def __call__(self, snapshot: Snapshot) -> np.ndarray:
        """Return the picture (size, size, 3), uint8."""
        canvas = Canvas(self.style.size, self.style.size, SPACE)
        viewport, grasp, swing = self._viewport(snapshot.p), self._grasp(snapshot), self._swing(snapshot)
        self._draw_path(canvas, viewport, snapshot.t)
        self._draw_robot(canvas, viewport, snapshot, grasp, swing)
        for top, bottom in (0.0, self._top), (self._bottom, float(self.style.size)):
            canvas.box(0.0, top, self.style.size, bottom, SPACE)
        self._draw_title(canvas, snapshot, swing)
        self._draw_map(canvas, snapshot)
        self._draw_keys(canvas, viewport, snapshot, grasp)
        self._draw_plots(canvas, snapshot)
        return canvas.pixels()

    def plots(self, snapshot: Snapshot) -> list[Plot]:
        """Return the small plots: tips, tracking error, and the virtual damping or else the vibration energy."""
        trace, names = snapshot.trace, tuple(mount.name for mount in self.params.panel.mounts)
        colours = tuple(SIDES[i % len(SIDES)] for i in range(len(names)))
        tips, damping = trace[:, self._tips], trace[:, self._tips.stop :]
        error, energy = trace[:, [ERROR]], trace[:, [ENERGY]]
        listed = [
            Plot("tip deflection", "m", tips, colours, linear(tips, signed=True), names),
            Plot("tracking error", "m", error, (INK,), logarithmic(error)),
            Plot("virtual damping", "N s/m", damping, colours, linear(damping), names)
            if damping.size
            else Plot("vibration energy", "J", energy, (INK,), linear(energy)),
        ]
        return [plot._replace(axis=self.style.axes.get(plot.title, plot.axis)) for plot in listed]

    def _viewport(self, p: Array) -> Viewport:
        """Return the viewport with the robot in the middle, and room for its panels in every direction."""
        model = self.model
        arms = [np.hypot(*mount) for mount in model.arm_mount] or [0.0]
        panels = np.hypot(*model.panel_root.T) + model.panel_length if len(model.panel_root) else [0.0]
        reach = max(np.max(panels), np.max(arms) + 1.0, self.params.base.side)
        height = self._bottom - self._top
        middle = np.array([self.style.size / 2, self._top + height / 2])
        return Viewport(p[:2], middle, float(height / (2.0 * (reach + MARGIN))), self._u)

    def _draw_path(self, canvas: Canvas, viewport: Viewport, t: float) -> None:
        """Draw dots that stand still in space, two metres apart or as far as a large robot needs, and the path."""
        reach = self.style.size / viewport.scale / 2
        apart = max(2.0, linear(np.array([reach / DOTS])).high)
        first, last = np.floor((viewport.centre - reach) / apart), np.ceil((viewport.centre + reach) / apart)
        columns, rows = np.meshgrid(*(np.arange(a, b + 1.0) for a, b in zip(first, last, strict=True)))
        dots: Array = np.column_stack([columns.ravel(), rows.ravel()])
        for dot in viewport(apart * dots):
            canvas.disc(dot, 1.3 * self._u, DOT)
        track = self._track
        away = min(1.6 * reach / max(track.pace, LEAST_PACE), track.span / 2.0)
        for colour, start, stop in (AHEAD, t, min(t + away, track.ahead(t))), (COVERED, max(t - away, 0.0), t):
            canvas.line(viewport(path_points(self.reference, np.linspace(start, stop, 60))), colour, 4.0 * self._u)
        x, y = viewport(path_points(self.reference, np.array([t])))[0]
        for way in np.array([[1.0, 0.0], [0.0, 1.0]]):
            canvas.line([(x, y) - 16 * self._u * way, (x, y) + 16 * self._u * way], COVERED, 1.2 * self._u)

    def _draw_robot(self, canvas: Canvas, viewport: Viewport, snapshot: Snapshot, grasp: Array, swing: Array) -> None:
        model, params, p = self.model, self.params, snapshot.p
        volts, thrust, _ = self._sim.split(snapshot.applied)
        factor, calm = self.style.exaggeration, self._quasi_static(snapshot)
        ends = factor * (tip_deflections(model, calm[None]) + np.array([swing.min(axis=0), swing.max(axis=0)]))
        draw_plumes(canvas, viewport, params, p, thrust, self._scales.thrust)
        for i in range(len(model.panel_root)):
            draw_dashed_panel(canvas, viewport, model, params, calm, i, factor)
            draw_swing(canvas, viewport, model, p, i, ends[:, i], SIDES[i % len(SIDES)])
            draw_panel(canvas, viewport, model, params, p, i, factor, volts[i])
        draw_base(canvas, viewport, params, p)
        for i, arm in sorted(enumerate(params.arms), key=lambda each: each[0] in model.grasp_arm):
            draw_arm(canvas, viewport, model, p, i, arm.name)
        if params.object is not None:
            draw_object(canvas, viewport, model, p, grasp, self._scales.grasp)

    def _draw_title(self, canvas: Canvas, snapshot: Snapshot, swing: Array) -> None:
        u, right = self._u, self.style.size - 14 * self._u
        canvas.text((14 * u, 20 * u), self.title, 24 * u, self.style.colour)
        below = " · ".join(text for text in (self.subtitle, f"t = {snapshot.t:.1f} s") if text)
        canvas.text((14 * u, 42 * u), below, 13 * u, FAINT)
        if swing.size:
            canvas.text((right, 20 * u), f"{1000.0 * np.ptp(swing, axis=0).max():.0f} mm", 24 * u, INK, "rm")
            canvas.text((right, 42 * u), f"swing of the tips, last {SWING:g} s", 13 * u, FAINT, "rm")
        if snapshot.failure:
            canvas.text((self.style.size / 2, self._top + 16 * u), f"failed: {snapshot.failure}", 16 * u, ALARM, "mm")

    def _draw_map(self, canvas: Canvas, snapshot: Snapshot) -> None:
        """Draw the whole path at small, what was covered of it, and where the robot is."""
        u, reference, track, t = self._u, self.reference, self._track, snapshot.t
        middle = np.array([66 * u, self._top + 58 * u])
        viewport = Viewport(track.centre, middle, 42 * u / track.reach, u)
        whole = viewport(path_points(reference, np.linspace(0.0, track.span, 91)))
        canvas.line(whole, AHEAD, 3.0 * u)
        start = max(0.0, t - track.span) if track.closed else 0.0
        canvas.line(viewport(path_points(reference, np.linspace(start, t, 91))), COVERED, 3.0 * u)
        at = object_slice(self.model) if self.params.object is not None else slice(0, N_BASE)
        canvas.disc(viewport(snapshot.p[at][None, :2])[0], 4.0 * u, self.style.colour)
        share = 100.0 * min(t / track.span, 1.0)
        canvas.text(label_place(whole, middle, 20 * u), f"{share:.0f} %", 13 * u, FAINT, "mm")

    def _draw_keys(self, canvas: Canvas, viewport: Viewport, snapshot: Snapshot, grasp: Array) -> None:
        """Draw what lengths and colours mean: deflections, a metre, plumes, arrows, voltages."""
        u, left, right = self._u, 14 * self._u, self.style.size - 14 * self._u
        line = self._bottom - 14 * u
        for start, stop in (0.0, left + 146 * u), (right - 126 * u, float(self.style.size)):
            canvas.box(start, line - 47 * u if start == 0.0 else line - 25 * u, stop, self._bottom, SHADE)
        if len(self.model.panel_root):
            canvas.text((left, line - 36 * u), f"deflections drawn {self.style.exaggeration:g}x", 13 * u, INK)
            canvas.text((left, line - 18 * u), "dashed: without swing", 13 * u, FAINT)
            self._draw_voltage_key(canvas, right, line)
        canvas.line([[left, line], [left + viewport.scale, line]], FAINT, 2.0 * u)
        canvas.text((left + viewport.scale + 6 * u, line), "1 m", 12 * u, FAINT)
        thrust = np.hypot(*self._sim.split(snapshot.applied)[1][:2])
        lines: list[tuple[str, Colour]] = [(f"thrust {with_unit(thrust, 'N')}", THRUST)]
        if len(grasp):
            lines.append((f"grasp {with_unit(np.hypot(*grasp.T).max(), 'N')}", FORCE))
        energy = snapshot.trace[-1, ENERGY] if len(snapshot.trace) else np.nan
        if np.isfinite(energy):
            lines.append((f"vibration {with_unit(energy, 'J')}", FAINT))
        for k, (text, colour) in enumerate(lines):
            canvas.text((right, self._top + (16 + 18 * k) * u), text, 13 * u, colour, "rm")

    def _draw_voltage_key(self, canvas: Canvas, right: float, line: float) -> None:
        """Draw bands from the most negative to the most positive voltage, logarithmic on both sides of zero."""
        u, limit = self._u, self._scales.volts
        steps = [-limit, -limit / 10, -limit / 100, -limit / 1000, 0.0, limit / 1000, limit / 100, limit / 10, limit]
        width = 13 * u
        left = right - width * len(steps)
        for k, volts in enumerate(steps):
            canvas.box(
                left + k * width, line - 4 * u, left + (k + 1) * width, line + 5 * u, voltage_colour(volts, limit)
            )
        canvas.text((left, line - 14 * u), f"-{limit:g}", 12 * u, FAINT)
        canvas.text(((left + right) / 2, line - 14 * u), "piezo", 12 * u, FAINT, "mm")
        canvas.text((right, line - 14 * u), with_unit(limit, "V"), 12 * u, FAINT, "rm")

    def _draw_plots(self, canvas: Canvas, snapshot: Snapshot) -> None:
        u, plots = self._u, self.plots(snapshot)
        gap, edge = 12 * u, 14 * u
        width = (self.style.size - 2 * edge - gap * (len(plots) - 1)) / len(plots)
        start = max(snapshot.t - self.style.span, 0.0)
        t = (snapshot.trace[:, TIME] - start) / self.style.span
        shown = t >= 0.0
        for k, plot in enumerate(plots):
            left = edge + k * (width + gap)
            box = (left, self._bottom + 8 * u, left + width, self.style.size - 22 * u)
            draw_plot(canvas, box, u, t[shown], plot._replace(values=plot.values[shown]))
            below = self.style.size - 12 * u
            canvas.text((left + GUTTER * u, below), f"{start:.0f}", 12 * u, FAINT)
            canvas.text((left + width, below), f"{start + self.style.span:.0f} s", 12 * u, FAINT, "rm")

    def _quasi_static(self, snapshot: Snapshot) -> Array:
        """Return the positions (n,) with the panels in the quasi-static shape, to which the path alone bends them."""
        p = snapshot.p.copy()
        p[mode_slice(self.model)] = quasi_static_at(self.model, self.reference, np.array([snapshot.t])).ravel()
        return p

    def _swing(self, snapshot: Snapshot) -> Array:
        """Return the tips' deflections (k, n_p) [m] about that shape over the last ``SWING`` seconds."""
        model, trace = self.model, snapshot.trace
        recent = trace[trace[:, TIME] >= snapshot.t - SWING]
        tips = np.vstack([recent[:, self._tips], tip_deflections(model, snapshot.p[None])])
        t = np.append(recent[:, TIME], snapshot.t)
        swing: Array = tips - modal_tip_deflections(model, quasi_static_at(model, self.reference, t))
        return swing

    def _grasp(self, snapshot: Snapshot) -> Array:
        """Return the forces (n_g, 2) of the object on each gripper, inertial axes [N], under the applied command."""
        if not len(self.model.grasp_arm):
            return np.zeros((0, 2))
        volts, base, joints = self._sim.split(snapshot.applied)
        state = self._sim.unflatten(snapshot.t, snapshot.p, snapshot.v)
        return self._sim.grasp_forces(state, base=base, joints=joints, piezo_volts=volts)


def label_place(line: Array, middle: Array, room: float) -> tuple[float, float]:
    """Return where a label of a path is drawn: in its middle (2,), or below a path (k, 2) that has no such room."""
    free = np.linalg.norm(line - middle, axis=1).min() > room
    x, y = middle if free else (middle[0], line[:, 1].max() + room)
    return float(x), float(y)
