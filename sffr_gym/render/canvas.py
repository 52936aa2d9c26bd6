"""A picture under construction: shapes drawn finer than its pixels and averaged, text on top; the same everywhere.

Pillow with its built-in font, so that nothing depends on the machine's fonts or display.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from math import ceil, floor
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from sffr_gym.types import Array

FARTHEST = 1.0e4  # pixels; what lies beyond is drawn there, since Pillow's coordinates are integers of the machine
LARGER = 4  # times the size in which texts are written
LONGEST = 80  # letters of a text, more than fit into a picture; names of users may have any length
FINER = 2  # times as many pixels in each direction while shapes are drawn

Colour = tuple[int, int, int] | tuple[int, int, int, int]  # red, green, blue and perhaps opacity, 0 to 255
Points = Array | Sequence[Any]


class Canvas:
    """A picture of ``width`` by ``height`` pixels; places and widths are in pixels from the upper left corner.

    Args:
        width, height: of the picture.
        background: its colour.
    """

    def __init__(self, width: int, height: int, background: Colour) -> None:
        self._image = Image.new("RGB", (FINER * width, FINER * height), background)
        self._solid, self._glass = ImageDraw.Draw(self._image), ImageDraw.Draw(self._image, "RGBA")
        self._texts: list[tuple[tuple[float, float], str, float, Colour, str]] = []

    def line(self, points: Points, colour: Colour, width: float = 1.0) -> None:
        """Draw an open line through points (k, 2); for gentle bends, since corners stay open."""
        self._pen(colour).line(_fine(points), colour, max(round(FINER * width), 1))

    def tube(self, points: Points, colour: Colour, width: float) -> None:
        """Draw an open line through points (k, 2) with round ends and corners."""
        self.line(points, colour, width)
        for point in points:
            self.disc(point, width / 2.0, colour)

    def polygon(self, points: Points, fill: Colour, edge: Colour | None = None, width: float = 1.0) -> None:
        """Draw an area within points (k, 2), with an edge if it has a colour."""
        self._pen(fill).polygon(_fine(points), fill)
        if edge is not None:
            self.tube(np.vstack([points, points[:1]]), edge, width)

    def disc(self, centre: Sequence[float] | Array, radius: float, fill: Colour) -> None:
        """Draw a filled circle."""
        x, y = centre
        ends = (FINER * (x - radius), FINER * (y - radius), FINER * (x + radius), FINER * (y + radius))
        self._pen(fill).ellipse(ends, fill)

    def box(self, left: float, top: float, right: float, bottom: float, fill: Colour) -> None:
        """Draw a filled rectangle."""
        ends = (FINER * left, FINER * top, FINER * right - 1, FINER * bottom - 1)
        self._pen(fill).rectangle(ends, fill)

    def text(self, place: tuple[float, float], text: str, size: float, colour: Colour, anchor: str = "lm") -> None:
        """Write a line on top of everything; the anchor is Pillow's: l, m, r, then a (top), m, s (baseline), d.

        What is too long is cut; letters that the font does not have are boxes.
        """
        line = " ".join(text.split())
        line = line if len(line) <= LONGEST else line[: LONGEST - 3] + "..."
        self._texts.append((place, line, size, colour, anchor))

    def pixels(self) -> np.ndarray:
        """Return the picture (height, width, 3), uint8."""
        image = self._image.reduce(FINER)
        for (x, y), text, size, colour, anchor in self._texts:
            mask, left, top = _stamp(text, size, anchor)
            image.paste(colour, (round(x) + left, round(y) + top), mask)
        return np.array(image)

    def _pen(self, colour: Colour) -> ImageDraw.ImageDraw:
        """Return what draws in a colour: opaque ones take a fifth of the time."""
        return self._solid if len(colour) == 3 else self._glass


@functools.lru_cache(maxsize=512)  # most texts of a picture are those of the one before
def _stamp(text: str, size: float, anchor: str) -> tuple[Image.Image, int, int]:
    """Return a written text as opacities, and where its upper left corner lies relative to the anchor [pixels].

    Written larger and averaged, since letters otherwise stand at whole pixels, with gaps within words.
    """
    font, pen = ImageFont.load_default(LARGER * size), ImageDraw.Draw(Image.new("L", (1, 1)))
    left, top, right, bottom = pen.textbbox((0, 0), text, font, anchor)
    left, top = floor(left / LARGER), floor(top / LARGER)
    width, height = ceil(right / LARGER) - left, ceil(bottom / LARGER) - top
    mask = Image.new("L", (LARGER * max(width, 1), LARGER * max(height, 1)))
    ImageDraw.Draw(mask).text((-LARGER * left, -LARGER * top), text, 255, font, anchor)
    return mask.reduce(LARGER), left, top


def _fine(points: Points) -> list[tuple[float, float]]:
    """Return points of the picture in the finer pixels that are drawn."""
    within = np.clip(np.asarray(points, dtype=np.float64), -FARTHEST, FARTHEST)
    return [(x, y) for x, y in (FINER * within).tolist()]
