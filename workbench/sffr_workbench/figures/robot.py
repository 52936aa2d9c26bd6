"""The figure of the robot on its path."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sffr_baselines.rollout import Trajectory
from sffr_gym.config.params import Params
from sffr_gym.physics.kinematics import rotation, tip_deflections
from sffr_gym.physics.model import Model, object_slice
from sffr_gym.render.geometry import CORNERS, arm_line, in_base_axes, panel_line, path_points, track_of
from sffr_gym.task.reference import on_circle
from sffr_gym.types import Array
from sffr_workbench.figures.style import SHORT, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BODY, EDGE, LINK, LEADER = "#E3E6EA", "#343A40", "#6C757D", "#9AA3AD"
PANEL, CELL, FLAT, OBJECT, CIRCLE = "#1F4E9C", "#9DB8E8", "#8FA3C4", "#D55E00", "#D5D9DE"
FACTORS = (1, 2, 3, 5, 10, 20, 50, 100)  # by which deflections may be enlarged
LARGEST = 0.3  # of a panel's length: how far an enlarged tip may be drawn from the straight panel
APART = 10.0  # m of path between two drawn robots
MAX_ROBOTS = 8
TOGETHER = 1.0  # m between robots that would hide each other


def path_figure(trajectory: Trajectory, model: Model, params: Params) -> Figure:
    """Draw the path, the robot at several times, and one of them, whose panels bend well, at large."""
    from matplotlib.figure import Figure

    bends = np.abs(tip_deflections(model, trajectory.p)).max(axis=1, initial=0.0)
    longest = max((panel.length for panel in params.panel.each), default=params.panel.length)
    largest = LARGEST * longest
    factor = max(n for n in FACTORS if n == 1 or n * bends.max() <= largest)
    way = np.hypot(*np.diff(trajectory.p[:, :2], axis=0).T).sum()
    count, rows = int(np.clip(way / APART, 1, MAX_ROBOTS)), len(trajectory.p)
    shown = np.linspace(0, rows, count, endpoint=False).astype(int) if count > 1 else np.array([rows - 1])
    # At large: of those that bend well, the one nearest to the right.
    chosen = max(shown[bends[shown] >= 0.8 * bends[shown].max()], key=lambda row: trajectory.p[row, 0])

    figure = Figure(figsize=(10.2, 6.9), layout="constrained")
    whole, zoom = figure.subplots(1, 2, width_ratios=[2.0, 1.0])
    _draw_paths(whole, trajectory, model, params)
    for rows_there in _meetings(trajectory, shown):  # a path that crosses itself has several
        draw_robot(whole, model, params, trajectory.p[rows_there[0]], factor, size=0.55)
        _write_times(whole, trajectory, model, rows_there)
    whole.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    room = max(3.6, 0.1 * whole.dataLim.height)  # for what is written beside the outermost robots
    whole.set_xlim(whole.dataLim.x0 - room, whole.dataLim.x1 + room)
    whole.grid(False)
    title = f"{plain(trajectory.policy)}, {plain(trajectory.scenario)}"
    title += f"\npanel deflections \u00d7{factor}" if params.panel.mounts else ""
    reference = trajectory.reference
    if on_circle(reference) and reference.radius > 2.5 * longest:  # there is room in the middle
        whole.legend(loc="center", title=title)
    else:
        figure.legend(*whole.get_legend_handles_labels(), loc="outside upper left", ncols=3, title=title)

    low, high = _label(zoom, draw_robot(zoom, model, params, in_base_axes(model, trajectory.p[chosen]), factor))
    zoom.text(0.0, 0.0, "base", color=EDGE, ha="center", va="center", zorder=9)
    zoom.plot([high[0] - 1.0, high[0]], [low[1] - 0.45] * 2, color=EDGE, linewidth=2.0)
    zoom.text(high[0] - 0.5, low[1] - 0.37, "1 m", color=EDGE, ha="center")
    zoom.set(aspect="equal", title=f"t = {trajectory.t[chosen]:.1f} s", xticks=[], yticks=[])
    zoom.spines[:].set(visible=True, color=LEADER, linewidth=0.8)
    _connect(figure, trajectory.p[chosen], low, high)
    return figure


def draw_robot(
    axes: Axes, model: Model, params: Params, p: Array, factor: float, size: float = 1.0
) -> list[tuple[str, Array]]:
    """Draw the robot in a state ``p`` (n,), its panels' deflections enlarged by ``factor``; at full size with cells.

    Returns:
        Its parts: name, and a point (2,) on it.
    """
    from matplotlib.patches import Polygon

    parts = []
    for i, mount in enumerate(params.panel.mounts):
        straight, line = (panel_line(model, params, p, i, enlarged) for enlarged in (0.0, factor))
        axes.plot(*straight[[0, -1]].T, color=FLAT, linewidth=1.1 * size, linestyle=(0, (3, 3)), zorder=3)
        across = np.gradient(line, axis=0) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
        across *= 0.1 / np.hypot(*across.T)[:, None]
        band = np.vstack([line + across, (line - across)[::-1]])
        axes.add_patch(Polygon(band, facecolor=PANEL, edgecolor=EDGE, linewidth=0.9 * size, zorder=4))
        if size == 1.0:
            for point, side in zip(line[2:-1:2], across[2:-1:2], strict=True):
                axes.plot(*np.array([point - side, point + side]).T, color=CELL, linewidth=0.8, zorder=5)
        parts.append((f"{plain(mount.name, SHORT)} panel", line[2 * len(line) // 3]))
    for i, arm in enumerate(params.arms):
        line = arm_line(model, p, i)
        for colour, width in (EDGE, 6.0), (BODY, 3.6):
            axes.plot(*line.T, color=colour, linewidth=width * size, solid_capstyle="round", zorder=6)
        axes.plot(*line[:-1].T, "o", color=EDGE, markersize=4.5 * size, zorder=7)
        parts.append((plain(arm.name, SHORT), line[-2:].mean(axis=0)))
    square = p[:2] + params.base.side / 2 * CORNERS @ rotation(p[2]).T
    axes.add_patch(Polygon(square, facecolor=BODY, edgecolor=EDGE, linewidth=1.8 * size, zorder=5))
    if params.object is not None:
        pose = p[object_slice(model)]
        reach = float(np.abs(model.grasp_point).max(initial=0.1))
        square = pose[:2] + reach * CORNERS @ rotation(pose[2]).T
        axes.add_patch(Polygon(square, facecolor=OBJECT, edgecolor=EDGE, linewidth=1.3 * size, zorder=8))
        parts.append(("object", pose[:2]))
    return parts


def _draw_paths(axes: Axes, trajectory: Trajectory, model: Model, params: Params) -> None:
    """Draw the desired path, and what object and base did."""
    name = "circle" if on_circle(trajectory.reference) else "desired path"
    axes.plot(*_desired(trajectory).T, color=CIRCLE, linewidth=5.0, label=name, zorder=1)
    if params.object is not None:
        carried = trajectory.p[:, object_slice(model)][:, :2]
        axes.plot(*carried.T, color=OBJECT, linewidth=1.4, label="path of the object", zorder=2)
    base = trajectory.p[:, :2]
    axes.plot(*base.T, color=LINK, linewidth=0.9, linestyle=(0, (4, 3)), label="path of the base", zorder=2)


def _desired(trajectory: Trajectory) -> Array:
    """Return the whole path (361, 2) [m], from the start of the motion on."""
    return path_points(trajectory.reference, np.linspace(0.0, track_of(trajectory.reference).span, 361))


def _meetings(trajectory: Trajectory, shown: Array) -> list[list[int]]:
    """Return the rows at which a robot is drawn, those together in which it is at the same place."""
    found: list[list[int]] = []
    for row in shown.tolist():
        near = (rows for rows in found if np.hypot(*(trajectory.p[row] - trajectory.p[rows[0]])[:2]) < TOGETHER)
        if rows := next(near, None):
            rows.append(row)
        else:
            found.append([row])
    return found


def _write_times(axes: Axes, trajectory: Trajectory, model: Model, rows: list[int]) -> None:
    """Write the times beside a robot, where its arms, its panels and the path leave room."""
    p = trajectory.p[rows[0]]
    track = track_of(trajectory.reference)
    outward = (p[:2] - track.centre) / track.reach
    arms = [arm_line(model, p, arm)[:, 0].max() for arm in range(len(model.arm_mount))]
    place, side = np.array([max([p[0], *arms]) + 0.6, p[1] + 0.9 * outward[1]]), "left"
    if trajectory.reference.turning:  # between the arms and the outer panel, which turn too
        place, side = p[:2] + rotation(p[2]) @ np.array([1.6, -3.0]), "center"
    elif outward[0] < -0.2:
        place, side = p[:2] - np.array([1.5, 0.0]), "right"
    axes.text(place[0], place[1], ", ".join(f"{t:.1f} s" for t in trajectory.t[rows]), color=EDGE, ha=side, va="center")


def _label(axes: Axes, parts: list[tuple[str, Array]]) -> tuple[Array, Array]:
    """Write the names of parts in columns left and right of what is drawn; return the corners of that."""
    low, high = np.asarray(axes.dataLim.min) - 0.15, np.asarray(axes.dataLim.max) + 0.15
    middle = (low[0] + high[0]) / 2
    for side, x in (-1, low[0] - 0.25), (1, high[0] + 0.25):
        y = -np.inf
        for name, point in sorted(parts, key=lambda part: part[1][1]):
            if (point[0] < middle) == (side < 0):
                y = max(y + 0.45, point[1])
                axes.plot([point[0], x], [point[1], y], color=LEADER, linewidth=0.8, zorder=9)
                axes.plot(*point, "o", color=LEADER, markersize=2.5, zorder=9)
                axes.text(x + 0.08 * side, y, name, color=EDGE, ha="left" if side > 0 else "right", va="center")
    axes.set_xlim(low[0] - 1.7, high[0] + 1.4)
    return low, high


def _connect(figure: Figure, p: Array, low: Array, high: Array) -> None:
    """Frame the robot of the zoom, between ``low`` and ``high`` in base axes, and lead from there to the zoom."""
    from matplotlib.patches import ConnectionPatch, Polygon

    whole, zoom = figure.axes
    corners = p[:2] + ((low + high) / 2 + (high - low) / 2 * CORNERS) @ rotation(p[2]).T
    whole.add_patch(Polygon(corners, facecolor="none", edgecolor=LEADER, linewidth=0.8, zorder=3))
    bottom, top = whole.get_ylim()
    whole.set_ylim(min(bottom, corners[:, 1].min() - 0.2), max(top, corners[:, 1].max() + 0.2))
    for up, end in (1.0, (0.0, 1.0)), (-1.0, (0.0, 0.0)):
        start = max(corners, key=lambda corner: (round(up * corner[1], 2), corner[0]))
        line = ConnectionPatch(tuple(start), end, whole.transData, zoom.transAxes, color=LEADER, linewidth=0.8)
        figure.add_artist(line)
