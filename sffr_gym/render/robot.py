"""The robot itself in a picture: base with plumes, arms, object with grasp forces, panels with shape and voltages."""

from __future__ import annotations

from math import copysign, log1p
from typing import NamedTuple

import numpy as np

from sffr_gym.config.params import Params
from sffr_gym.physics.kinematics import grasp_points, rotation
from sffr_gym.physics.model import Model, object_slice
from sffr_gym.render.canvas import Canvas, Colour
from sffr_gym.render.geometry import CORNERS, arm_line, panel_line, place_in_panel
from sffr_gym.types import Array

BODY: Colour = (214, 220, 230)
EDGE: Colour = (15, 20, 34)
LINK: Colour = (164, 174, 192)
GOLD: Colour = (201, 162, 90)
OBJECT: Colour = (236, 112, 60)
FORCE: Colour = (255, 122, 198)
PANEL = (44, 82, 160)
POSITIVE, NEGATIVE = (255, 176, 32), (64, 236, 220)
CELL: Colour = (120, 152, 220, 150)
FLAT: Colour = (110, 124, 156)
PLUME: Colour = (255, 150, 60, 130)
CORE: Colour = (255, 232, 170, 220)

HALF_WIDTH = 0.13  # m, of a drawn panel
VISIBLE = 0.01  # V, about the smallest voltage whose colour can be told from none; the scale is logarithmic above it
NOZZLES = 0.3  # m from the base's axis, on each side
LONGEST = 2.2  # m, of a plume or an arrow
LEAST = 0.02  # m, shorter ones are not drawn


class Viewport(NamedTuple):
    """From metres to pixels."""

    centre: Array  #: (2,) inertial point [m] that lies in the middle
    middle: Array  #: (2,) its place in the picture [pixels]
    scale: float  #: pixels for a metre
    unit: float  #: pixels for a line of width 1

    def __call__(self, points: Array) -> Array:
        """Return the places (k, 2) [pixels] of inertial points (k, 2) [m]."""
        placed: Array = self.middle + self.scale * (points - self.centre) * np.array([1.0, -1.0])
        return placed


def draw_panel(
    canvas: Canvas, viewport: Viewport, model: Model, params: Params, p: Array, panel: int, factor: float, volts: Array
) -> None:
    """Draw a panel with its deflections ``factor`` times as large, in the colours of its channels' voltages (n_c,).

    Bands from the root outwards stand for the channels; with bonded pairs the two faces of a band stand for a pair.
    """
    u = viewport.unit
    line = panel_line(model, params, p, panel, factor)
    across = np.gradient(line, axis=0) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    across *= HALF_WIDTH / np.hypot(*across.T)[:, None]
    faces = 1 if params.actuators.piezo.array == "generalized" else 2
    bands = np.array([voltage_colour(v, params.actuators.piezo.voltage) for v in volts]).reshape(-1, faces, 3)
    ends = np.linspace(0, len(line) - 1, len(bands) + 1).round().astype(int)
    upper, lower = line + across, line - across  # on the panel's +y and -y side
    for band, first, last in zip(bands, ends, ends[1:], strict=False):
        at = slice(first, last + 1)
        edges = [upper[at], lower[at]] if faces == 1 else [upper[at], line[at], lower[at]]
        for colour, one, other in zip(band.tolist(), edges, edges[1:], strict=False):
            canvas.polygon(viewport(np.vstack([one, other[::-1]])), tuple(colour))
    for k in range(2, len(line) - 1, 2):
        canvas.line(viewport(np.array([upper[k], lower[k]])), CELL, 0.8 * u)
    outline = viewport(np.vstack([upper, lower[::-1], upper[:1]]))
    canvas.line(outline, (170, 192, 240), 1.1 * u)


def draw_dashed_panel(
    canvas: Canvas, viewport: Viewport, model: Model, params: Params, p: Array, panel: int, factor: float
) -> None:
    """Draw a panel's line as dashes, its deflections ``factor`` times as large."""
    line = viewport(panel_line(model, params, p, panel, factor, points=36))
    for k in range(0, len(line) - 1, 2):
        canvas.line(line[k : k + 2], FLAT, 1.4 * viewport.unit)


def draw_swing(
    canvas: Canvas, viewport: Viewport, model: Model, p: Array, panel: int, ends: Array, colour: Colour
) -> None:
    """Draw a bar beyond a panel's tip from the one to the other of the drawn deflections ``ends`` (2,) [m]."""
    beyond = model.panel_length[panel] + 0.25
    bar = np.array([[beyond, ends[0]], [beyond, ends[1]]])
    across = np.array([[-0.11, 0.0], [0.11, 0.0]])
    for points, width in (bar, 4.0), (bar[0] + across, 2.5), (bar[1] + across, 2.5):
        canvas.line(viewport(place_in_panel(model, p, panel, points)), colour, width * viewport.unit)


def draw_arm(canvas: Canvas, viewport: Viewport, model: Model, p: Array, arm: int, name: str) -> None:
    """Draw an arm's links and joints, and at its tip what its name says it carries."""
    line, u = viewport(arm_line(model, p, arm)), viewport.unit
    small = arm not in model.grasp_arm
    width = (3.2 if small else 6.0) * u
    ahead = line[-1] - line[-2]
    ahead = ahead / np.hypot(*ahead)
    side = np.array([-ahead[1], ahead[0]])
    if name == "antenna":
        angles = np.linspace(-1.25, 1.25, 13)[:, None]
        dish = line[-1] + 11 * u * (ahead * (1.0 - np.cos(angles)) + side * np.sin(angles))
        canvas.polygon(dish, BODY, EDGE, u)
        canvas.line([line[-1], line[-1] + 9 * u * ahead], BODY, 1.5 * u)
        canvas.disc(line[-1] + 9 * u * ahead, 2.2 * u, GOLD)
    if name == "camera":
        cone = np.array(
            [line[-1], line[-1] + 34 * u * ahead + 13 * u * side, line[-1] + 34 * u * ahead - 13 * u * side]
        )
        canvas.polygon(cone, (150, 200, 255, 42))
    canvas.tube(line, EDGE, width + 2.2 * u)
    canvas.tube(line, LINK, width)
    if name == "camera":
        box = np.array([-3 * ahead + 5 * side, 7 * ahead + 5 * side, 7 * ahead - 5 * side, -3 * ahead - 5 * side])
        canvas.polygon(line[-1] + u * box, (70, 84, 112), EDGE, u)
        canvas.disc(line[-1] + 6 * u * ahead, 2.6 * u, (150, 200, 255))
    for joint in line[:-1]:
        canvas.disc(joint, 0.62 * width, EDGE)
        canvas.disc(joint, 0.36 * width, GOLD)


def draw_base(canvas: Canvas, viewport: Viewport, params: Params, p: Array) -> None:
    """Draw the base as a square with a mark on its front."""
    turn, half, u = rotation(p[2]).T, params.base.side / 2, viewport.unit
    canvas.polygon(viewport(p[:2] + half * CORNERS @ turn), BODY, EDGE, 1.8 * u)
    canvas.polygon(viewport(p[:2] + 0.72 * half * CORNERS @ turn), (187, 195, 210))
    front = half * np.array([[0.62, 0.0], [0.05, 0.42], [0.05, -0.42]])
    canvas.polygon(viewport(p[:2] + front @ turn), (118, 130, 154))


def draw_plumes(canvas: Canvas, viewport: Viewport, params: Params, p: Array, thrust: Array, newtons: float) -> None:
    """Draw the thrusters' plumes for a thrust (3,) along the base axes [N, N, N m]: a metre for so many newtons.

    Two nozzles on each face; the torque comes from those that push along the base's x axis.
    """
    fx, fy, torque = thrust
    couple, half = torque / (2.0 * NOZZLES), params.base.side / 2
    pushes = [
        (np.array([1.0, 0.0]), NOZZLES, fx / 2.0 - couple),
        (np.array([1.0, 0.0]), -NOZZLES, fx / 2.0 + couple),
        (np.array([0.0, 1.0]), 0.02, fy / 2.0),
        (np.array([0.0, 1.0]), 0.32, fy / 2.0),
    ]
    turn = rotation(p[2]).T
    for along, aside, force in pushes:
        length = min(abs(force) / newtons, LONGEST)
        if length < LEAST:
            continue
        out = -copysign(1.0, force) * along
        across = np.array([-along[1], along[0]]) if along[0] else np.array([1.0, 0.0])
        mouth = half * out + aside * across
        for colour, reach, width in (PLUME, length, 0.11), (CORE, 0.55 * length, 0.055):
            tip = mouth + reach * out
            flame = np.array([mouth + 0.7 * width * across, tip, mouth - 0.7 * width * across])
            belly = mouth + 0.35 * reach * out
            flame = np.array([flame[0], belly + width * across, flame[1], belly - width * across, flame[2]])
            canvas.polygon(viewport(p[:2] + flame @ turn), colour)


def draw_object(canvas: Canvas, viewport: Viewport, model: Model, p: Array, grasp: Array, newtons: float) -> None:
    """Draw the object with the grippers' forces on it, ``-grasp`` (n_g, 2) [N]: a metre for so many newtons."""
    pose, u = p[object_slice(model)], viewport.unit
    reach = max(float(np.abs(model.grasp_point).max(initial=0.1)), 5.5 * u / viewport.scale)
    canvas.polygon(viewport(pose[:2] + reach * CORNERS @ rotation(pose[2]).T), OBJECT, EDGE, 1.3 * u)
    for point, force in zip(grasp_points(model, pose), -grasp, strict=True):
        size = np.hypot(*force)
        length = min(size / newtons, LONGEST)
        if length > LEAST:
            _arrow(canvas, viewport(point[None])[0], length * viewport.scale * force / size * [1.0, -1.0], u)


def voltage_colour(volts: float, limit: float) -> tuple[int, int, int]:
    """Return the panels' own colour at 0 V, towards amber for positive and cyan for negative voltages."""
    share = min(log1p(abs(volts) / VISIBLE) / log1p(limit / VISIBLE), 1.0)
    end = POSITIVE if volts > 0.0 else NEGATIVE
    red, green, blue = (round(a + share * (b - a)) for a, b in zip(PANEL, end, strict=True))
    return red, green, blue


def _arrow(canvas: Canvas, start: Array, way: Array, u: float) -> None:
    length = np.hypot(*way)
    ahead = way / length
    head = min(8.0 * u, 0.6 * length)
    side, neck = np.array([-ahead[1], ahead[0]]), start + way - head * ahead
    canvas.line([start, neck], FORCE, 2.4 * u)
    canvas.polygon(np.array([start + way, neck + 0.55 * head * side, neck - 0.55 * head * side]), FORCE)
