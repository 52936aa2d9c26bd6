"""The picture of a moment: the robot on its path, its panels' swing, its forces, and small plots of the last seconds.

:class:`Renderer` is a pure function of a :class:`Snapshot`: the same snapshot gives the same pixels on every machine
with the same Pillow. It needs the extra ``render``; nothing else imports it before a picture is asked for.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sffr_gym import strip
from sffr_gym.beam import Array
from sffr_gym.canvas import Canvas, Colour
from sffr_gym.geometry import force_scales, resting_amplitudes, tip_deflections
from sffr_gym.model import N_BASE, Model, mode_slice, object_slice
from sffr_gym.params import Params
from sffr_gym.portrait import (
    FORCE,
    View,
    draw_arm,
    draw_base,
    draw_object,
    draw_panel,
    draw_plumes,
    draw_rest,
    draw_swing,
    voltage_colour,
)
from sffr_gym.reference import Reference
from sffr_gym.simulator import Simulator
from sffr_gym.strip import FAINT, INK, Axis, Plot, with_unit
from sffr_gym.trace import ENERGY, ERROR, Trace

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
SWING = 10.0  # s over which the bars beyond the tips show how far they went, about a period of the first mode
MARGIN = 0.55  # m around the robot


class Snapshot(NamedTuple):
    """What a picture shows.

    Attributes:
        t: time [s].
        p, v: (n,) the plant's positions and velocities.
        applied: (n_u,) command after the limits.
        trace: (k, columns) what has been; see :mod:`sffr_gym.trace`.
        failure: why the episode ended; empty if it goes on.
    """

    t: float
    p: Array
    v: Array
    applied: Array
    trace: Array
    failure: str = ""


class Look(NamedTuple):
    """How a picture looks.

    Attributes:
        size: pixels of either side.
        exaggeration: factor of the drawn deflections.
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
        look: how it looks.
    """

    def __init__(
        self, params: Params, reference: Reference, title: str, subtitle: str = "", look: Look | None = None
    ) -> None:
        self.params, self.reference, self.title, self.subtitle = params, reference, title, subtitle
        self.look = look or Look()
        self._sim = Simulator(params)
        self._scales = force_scales(params, self._sim.model)
        self._u = self.look.size / SIZE
        self._top, self._bottom = 52 * self._u, 452 * self._u  # of the view between title and plots

    @property
    def model(self) -> Model:
        """The robot as arrays."""
        return self._sim.model

    def __call__(self, snapshot: Snapshot) -> np.ndarray:
        """The picture (size, size, 3), uint8."""
        canvas = Canvas(self.look.size, self.look.size, SPACE)
        view, grasp, tips = self._view(snapshot.p), self._grasp(snapshot), self._recent_tips(snapshot)
        self._draw_path(canvas, view, snapshot.t)
        self._draw_robot(canvas, view, snapshot, grasp, tips)
        for top, bottom in (0.0, self._top), (self._bottom, float(self.look.size)):
            canvas.box(0.0, top, self.look.size, bottom, SPACE)
        self._draw_title(canvas, snapshot, tips)
        self._draw_map(canvas, snapshot)
        self._draw_keys(canvas, view, snapshot, grasp)
        self._draw_plots(canvas, snapshot)
        return canvas.pixels()

    def plots(self, snapshot: Snapshot) -> list[Plot]:
        """The small plots: tips, tracking error, and the virtual damping, or without one the vibration energy."""
        trace, n_p = snapshot.trace, len(self.model.panel_root)
        names, colours = tuple(mount.name for mount in self.params.panel.mounts), SIDES[:n_p]
        tips, damping = trace[:, 3 : 3 + n_p], trace[:, 3 + n_p :]
        error, energy = trace[:, [1 + ERROR]], trace[:, [1 + ENERGY]]
        listed = [
            Plot("tip deflection", "m", tips, colours, strip.linear(tips, signed=True), names),
            Plot("tracking error", "m", error, (INK,), strip.logarithmic(error)),
            Plot("virtual damping", "N s/m", damping, colours, strip.linear(damping), names)
            if damping.size
            else Plot("vibration energy", "J", energy, (INK,), strip.linear(energy)),
        ]
        return [plot._replace(axis=self.look.axes.get(plot.title, plot.axis)) for plot in listed]

    def _view(self, p: Array) -> View:
        """The robot in the middle, and room for its panels in every direction."""
        model = self.model
        arms = [np.hypot(*mount[:2]) for mount in model.arm_mount] or [0.0]
        panels = np.hypot(*model.panel_root.T) + self.params.panel.length if len(model.panel_root) else [0.0]
        reach = max(np.max(panels), np.max(arms) + 1.0, self.params.base.side)
        height = self._bottom - self._top
        middle = np.array([self.look.size / 2, self._top + height / 2])
        return View(p[:2], middle, float(height / (2.0 * (reach + MARGIN))), self._u)

    def _draw_path(self, canvas: Canvas, view: View, t: float) -> None:
        """Dots that stand still in space, two metres apart, and the path."""
        reach = self.look.size / view.scale / 2
        first, last = np.floor((view.centre - reach) / 2), np.ceil((view.centre + reach) / 2)
        columns, rows = np.meshgrid(*(np.arange(a, b + 1.0) for a, b in zip(first, last, strict=True)))
        dots: Array = np.column_stack([columns.ravel(), rows.ravel()])
        for dot in view(2.0 * dots):
            canvas.disc(dot, 1.3 * self._u, DOT)
        now = self.reference.phase + self.reference.rate * t
        away = reach / self.reference.radius * 1.6
        for colour, start, stop in (AHEAD, now, now + away), (COVERED, max(now - away, self.reference.phase), now):
            canvas.line(view(_on_path(self.reference, np.linspace(start, stop, 60))), colour, 4.0 * self._u)
        x, y = view(_on_path(self.reference, np.array([now])))[0]
        for way in np.array([[1.0, 0.0], [0.0, 1.0]]):
            canvas.line([(x, y) - 16 * self._u * way, (x, y) + 16 * self._u * way], COVERED, 1.2 * self._u)

    def _draw_robot(self, canvas: Canvas, view: View, snapshot: Snapshot, grasp: Array, tips: Array) -> None:
        model, params, p = self.model, self.params, snapshot.p
        n_p, n_c = len(model.panel_root), self._sim.actuators.K_PZ.shape[2]
        volts = snapshot.applied[: n_p * n_c].reshape(n_p, n_c)
        factor, rest = self.look.exaggeration, self._at_rest(snapshot)
        draw_plumes(canvas, view, params, p, self._thrust(snapshot), self._scales.thrust)
        for i in range(n_p):
            ends = factor * np.array([tips[:, i].min(), tips[:, i].max()])
            draw_rest(canvas, view, model, params, rest, i, factor)
            draw_swing(canvas, view, model, p, i, params.panel.length, ends, SIDES[i % len(SIDES)])
            draw_panel(canvas, view, model, params, p, i, factor, volts[i])
        draw_base(canvas, view, params, p)
        for i, arm in sorted(enumerate(params.arms), key=lambda each: each[0] in model.grasp_arm):
            draw_arm(canvas, view, model, p, i, arm.name)
        if params.object is not None:
            draw_object(canvas, view, model, p, grasp, self._scales.grasp)

    def _draw_title(self, canvas: Canvas, snapshot: Snapshot, tips: Array) -> None:
        u, right = self._u, self.look.size - 14 * self._u
        canvas.text((14 * u, 20 * u), self.title, 24 * u, self.look.colour)
        below = "   ".join(text for text in (self.subtitle, f"t = {snapshot.t:.1f} s") if text)
        canvas.text((14 * u, 42 * u), below, 13 * u, FAINT)
        if tips.size:
            canvas.text((right, 20 * u), f"{1000.0 * np.ptp(tips, axis=0).max():.0f} mm", 24 * u, INK, "rm")
            canvas.text((right, 42 * u), f"swing of the tips, last {SWING:g} s", 13 * u, FAINT, "rm")
        if snapshot.failure:
            canvas.text((self.look.size / 2, self._top + 16 * u), f"failed: {snapshot.failure}", 16 * u, ALARM, "mm")

    def _draw_map(self, canvas: Canvas, snapshot: Snapshot) -> None:
        """The whole path at small, what was covered of it, and where the robot is."""
        u, reference = self._u, self.reference
        centre: Array = np.mean(_on_path(reference, np.array([0.0, np.pi])), axis=0)
        view = View(centre, np.array([66 * u, self._top + 58 * u]), 42 * u / reference.radius, u)
        now = reference.phase + reference.rate * snapshot.t
        canvas.line(view(_on_path(reference, np.linspace(0.0, 2.0 * np.pi, 91))), AHEAD, 3.0 * u)
        start = max(reference.phase, now - 2.0 * np.pi)
        canvas.line(view(_on_path(reference, np.linspace(start, now, 91))), COVERED, 3.0 * u)
        at = object_slice(self.model) if self.params.object is not None else slice(0, N_BASE)
        canvas.disc(view(snapshot.p[at][None, :2])[0], 4.0 * u, self.look.colour)
        share = 100.0 * min((now - reference.phase) / (2.0 * np.pi), 1.0)
        canvas.text((66 * u, self._top + 58 * u), f"{share:.0f} %", 13 * u, FAINT, "mm")

    def _draw_keys(self, canvas: Canvas, view: View, snapshot: Snapshot, grasp: Array) -> None:
        """What lengths and colours mean: deflections, a metre, plumes, arrows, voltages."""
        u, left, right = self._u, 14 * self._u, self.look.size - 14 * self._u
        line = self._bottom - 14 * u
        for start, stop in (0.0, left + 146 * u), (right - 126 * u, float(self.look.size)):
            canvas.box(start, line - 47 * u if start == 0.0 else line - 25 * u, stop, self._bottom, SHADE)
        if len(self.model.panel_root):
            canvas.text((left, line - 36 * u), f"deflections drawn {self.look.exaggeration:g}x", 13 * u, INK)
            canvas.text((left, line - 18 * u), "dashed: without swing", 13 * u, FAINT)
            self._draw_voltage_key(canvas, right, line)
        canvas.line([[left, line], [left + view.scale, line]], FAINT, 2.0 * u)
        canvas.text((left + view.scale + 6 * u, line), "1 m", 12 * u, FAINT)
        thrust = np.hypot(*self._thrust(snapshot)[:2])
        lines: list[tuple[str, Colour]] = [(f"thrust {with_unit(thrust, 'N')}", THRUST)]
        if len(grasp):
            lines.append((f"grasp {with_unit(np.hypot(*grasp.T).max(), 'N')}", FORCE))
        energy = snapshot.trace[-1, 1 + ENERGY] if len(snapshot.trace) else np.nan
        if np.isfinite(energy):
            lines.append((f"vibration {with_unit(energy, 'J')}", FAINT))
        for k, (text, colour) in enumerate(lines):
            canvas.text((right, self._top + (16 + 18 * k) * u), text, 13 * u, colour, "rm")

    def _draw_voltage_key(self, canvas: Canvas, right: float, line: float) -> None:
        """Bands from the most negative to the most positive voltage, the scale logarithmic on both sides."""
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
        canvas.text((right, line - 14 * u), f"{limit:g} V", 12 * u, FAINT, "rm")

    def _draw_plots(self, canvas: Canvas, snapshot: Snapshot) -> None:
        u, plots = self._u, self.plots(snapshot)
        gap, edge = 12 * u, 14 * u
        width = (self.look.size - 2 * edge - gap * (len(plots) - 1)) / len(plots)
        start = max(snapshot.t - self.look.span, 0.0)
        t = (snapshot.trace[:, 0] - start) / self.look.span
        shown = t >= 0.0
        for k, plot in enumerate(plots):
            left = edge + k * (width + gap)
            box = (left, self._bottom + 8 * u, left + width, self.look.size - 22 * u)
            strip.draw_plot(canvas, box, u, t[shown], plot._replace(values=plot.values[shown]))
            canvas.text((left + strip.GUTTER * u, self.look.size - 12 * u), f"{start:.0f}", 12 * u, FAINT)
            canvas.text((left + width, self.look.size - 12 * u), f"{start + self.look.span:.0f} s", 12 * u, FAINT, "rm")

    def _at_rest(self, snapshot: Snapshot) -> Array:
        """The positions (n,) with the panels in the shape that the path alone bends them to."""
        model, reference, p = self.model, self.reference, snapshot.p.copy()
        turn = reference.turning * reference.rate
        angle = reference.phase + reference.rate * snapshot.t - turn * snapshot.t  # in the reference axes
        a = reference.radius * reference.rate**2 * np.array([[-np.sin(angle), np.cos(angle)]])
        p[mode_slice(model)] = resting_amplitudes(model, reference, a, np.array([turn])).ravel()
        return p

    def _recent_tips(self, snapshot: Snapshot) -> Array:
        """Transverse tip deflections (k, n_p) [m] of the last ``SWING`` seconds, the present ones last."""
        recent = snapshot.trace[snapshot.trace[:, 0] >= snapshot.t - SWING, 3 : 3 + len(self.model.panel_root)]
        return np.vstack([recent, tip_deflections(self.model, snapshot.p[None])])

    def _thrust(self, snapshot: Snapshot) -> Array:
        """Thrust (3,) along the base axes [N, N, N m]."""
        n_p, _, n_c = self._sim.actuators.K_PZ.shape
        return snapshot.applied[n_p * n_c : n_p * n_c + N_BASE]

    def _grasp(self, snapshot: Snapshot) -> Array:
        """Forces (n_g, 2) of the object on each gripper, inertial axes [N], under the applied command."""
        if not len(self.model.grasp_arm):
            return np.zeros((0, 2))
        n_p, _, n_c = self._sim.actuators.K_PZ.shape
        volts, rest = np.split(snapshot.applied, [n_p * n_c])
        state = self._sim.unflatten(snapshot.t, snapshot.p, snapshot.v)
        return self._sim.grasp_forces(
            state, base=rest[:N_BASE], joints=rest[N_BASE:], piezo_volts=volts.reshape(n_p, n_c)
        )


def _on_path(reference: Reference, angles: Array) -> Array:
    """Points (k, 2) of the path at angles on the circle [rad]."""
    x = reference.x0 + reference.radius * (np.sin(angles) - np.sin(reference.phase))
    y = reference.y0 + reference.radius * (np.cos(reference.phase) - np.cos(angles))
    return np.column_stack([x, y])
