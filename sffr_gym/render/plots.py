"""Small plots of the last seconds under the picture of the robot."""

from __future__ import annotations

from math import ceil, floor, isfinite, log10
from typing import NamedTuple

import numpy as np

from sffr_gym.render.canvas import Canvas, Colour
from sffr_gym.types import Array

GROUND: Colour = (17, 24, 42)
GRID: Colour = (44, 54, 80)
INK: Colour = (226, 232, 240)
FAINT: Colour = (139, 152, 178)
GUTTER = 50  # for the numbers beside a plot
DECADES = 3  # of a logarithmic axis at most
TINY = 1e-290  # smaller magnitudes are drawn as nothing, which keeps powers of ten within the range of floats
ROOM = 92  # of a plot's head for its title, in front of the names
PREFIXES = {0: "", -1: "m", -2: "u", -3: "n", -4: "p"}  # the built-in font has no Greek letters


class Axis(NamedTuple):
    """What a plot shows vertically: from ``low`` to ``high`` in plain units, logarithmic or not."""

    low: float
    high: float
    log: bool = False


class Plot(NamedTuple):
    """One plot."""

    title: str  #: what it shows
    unit: str  #: plain SI unit of the values
    values: Array  #: (k, lines) one column for each line; NaN where there is nothing
    colours: tuple[Colour, ...]  #: of the lines
    axis: Axis  #: its range
    names: tuple[str, ...] = ()  #: of the lines, if there are several


def linear(*values: Array, signed: bool = False) -> Axis:
    """Return an axis from zero, or about zero if ``signed``, whose end is 1, 2 or 5 times a power of ten."""
    everything = np.concatenate([np.ravel(each) for each in values])
    largest = float(np.max(np.abs(everything[np.isfinite(everything)]), initial=0.0))
    if largest < TINY:
        return Axis(-float(signed), 1.0)
    power = 10.0 ** floor(log10(largest))
    end = next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= 0.999 * largest)
    return Axis(-end if signed else 0.0, end)


def logarithmic(*values: Array) -> Axis:
    """Return an axis of whole powers of ten, as many as the values need but no more than ``DECADES``."""
    everything = np.concatenate([np.ravel(each) for each in values])
    positive = everything[np.isfinite(everything) & (everything > TINY)]
    if not positive.size:
        return Axis(1e-6, 1e-5, log=True)
    top = ceil(log10(positive.max()) - 1e-9)
    bottom = min(max(floor(log10(positive.min())), top - DECADES), top - 1)
    return Axis(10.0**bottom, 10.0**top, log=True)


def draw_plot(canvas: Canvas, box: tuple[float, float, float, float], unit: float, t: Array, plot: Plot) -> None:
    """Draw a plot.

    Args:
        canvas: to draw on.
        box: left, top, right, bottom [pixels].
        unit: pixels for a line of width 1; texts are so many of it high as their sizes say.
        t: (k,) places of the values across the box, 0 to 1 [-].
        plot: what to draw.
    """
    left, top, right, bottom = box
    canvas.text((left, top + 7 * unit), plot.title, 13 * unit, INK)
    at = right
    for name, colour in list(zip(plot.names, plot.colours, strict=False))[::-1]:
        width = 6.5 * len(name) * unit
        if at - width < left + ROOM * unit:
            break  # the robot's own picture has the colours, too
        canvas.text((at, top + 7 * unit), name, 12 * unit, colour, "rm")
        at -= width + 8.0 * unit
    frame = (left + GUTTER * unit, top + 23 * unit, right, bottom)
    canvas.box(*frame, GROUND)
    for value in _marks(plot.axis):
        y = float(_height(plot.axis, np.array([value]), frame)[0])
        canvas.line([[frame[0], y], [right, y]], GRID)
        if value in (plot.axis.low, plot.axis.high, 0.0):
            canvas.text((frame[0] - 4 * unit, y), with_unit(value, plot.unit), 11 * unit, FAINT, "rm")
    x = frame[0] + t * (right - frame[0])
    for values, colour in zip(plot.values.T, plot.colours, strict=False):
        shown = np.isfinite(values)
        if shown.any():
            heights = np.clip(_height(plot.axis, values[shown], frame), frame[1], frame[3])
            places = np.column_stack([x[shown], heights])
            canvas.line(places, colour, 1.6 * unit)
            canvas.disc(places[-1], 2.2 * unit, colour)
    if not np.isfinite(plot.values).any():
        canvas.text(((frame[0] + right) / 2, (frame[1] + bottom) / 2), "none", 12 * unit, FAINT, "mm")


def _height(axis: Axis, values: Array, frame: tuple[float, float, float, float]) -> Array:
    """Return the vertical places of values in a frame [pixels]."""
    low, high = axis.low, axis.high
    if axis.log:
        values = np.log10(np.maximum(values, low))
        low, high = log10(low), log10(high)
    placed: Array = frame[3] - (values - low) / (high - low) * (frame[3] - frame[1])
    return placed


def _marks(axis: Axis) -> list[float]:
    """Return the values of the grid lines."""
    if axis.log:
        return [axis.low, *(10.0**n for n in range(round(log10(axis.low)) + 1, round(log10(axis.high)))), axis.high]
    return [axis.low, (axis.low + axis.high) / 2, axis.high]


def with_unit(value: float, unit: str) -> str:
    """Return a number with three digits, or a round one as it is, with its unit's SI prefix; "-" for none."""
    if not isfinite(value):
        return "-"
    if abs(value) < TINY:
        return "0"
    power = floor(log10(abs(value)) / 3 + 1e-9)
    power = min(0, max(power, min(PREFIXES)))
    return f"{float(f'{value / 1000.0**power:.3g}'):g} {PREFIXES[power]}{unit}"
