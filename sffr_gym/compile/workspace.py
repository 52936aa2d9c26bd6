"""Memory of kernels: arrays of described shapes, one after another in a block that is handed in.

A *description* is a named tuple, nested at will, whose leaves are shapes: ``Work(c=(n_l,), inverse=(3, 3))``.
:func:`workspace` turns it into the same tuple of arrays over a block of numbers, and copies nothing. The block says of
which kind the numbers are: a block (size,) holds plain ones, a block (size, WIDTH) numbers in lanes. Blocks are made
once, by :func:`allocate`, and handed to the kernels, which neither take nor free memory. Kernels fill what they read:
what a block held before does not matter.

Numbers that somebody filled can be read in the same way, by :func:`structure` whole ones as well from a second block:
the shape ``()`` stands for a single number, and ``Integers(shape)`` for whole ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import prod
from typing import Any, NamedTuple

import numpy as np

from sffr_gym.compile.arguments import LaneArray
from sffr_gym.compile.lanes import ALIGNMENT, WIDTH
from sffr_gym.types import Array, IntArray

ALIGNED = ALIGNMENT // 8  # numbers


class Integers(NamedTuple):
    """The shape of an array of whole numbers; ``()`` is a single one."""

    shape: tuple[int, ...]


class Interleaved(NamedTuple):
    """A described tuple whose arrays have one length, laid out entry by entry: what belongs to one link lies together.

    Many arrays then share a pointer, of which a processor has few; numbers that are used together come together.
    """

    fields: Any


def allocate(shapes: Any, count: int = 1, *, lanes: bool = False) -> Array:
    """Return ``count`` blocks that hold what a description describes, of plain numbers or of numbers in lanes.

    Returns:
        (count, size) or (count, size, WIDTH), each block aligned as vector registers like it.
    """
    size = sum(prod(shape) for shape in _leaves(shapes))
    shape = (count, -(-size // ALIGNED) * ALIGNED, *([WIDTH] if lanes else []))
    block = np.zeros(prod(shape) + ALIGNED)
    start = -block.ctypes.data // 8 % ALIGNED
    blocks = block[start : start + prod(shape)].reshape(shape)
    return blocks.view(LaneArray) if lanes else blocks


def workspace(block: Array, shapes: Any) -> Any:
    """Return the described arrays and numbers over a block (size,), or (size, WIDTH) of numbers in lanes."""
    return _view(shapes, _Cursor(block), None)


def new_workspace(shapes: Any) -> Any:
    """Return the described arrays over a block of their own."""
    return workspace(allocate(shapes)[0], shapes)


def structure(numbers: Array, integers: IntArray, shapes: Any) -> Any:
    """Return the described numbers and arrays over a row of numbers and one of whole numbers."""
    return _view(shapes, _Cursor(numbers), _Cursor(integers))


class _Cursor:
    """A block and how much of it is in use."""

    def __init__(self, block: Any) -> None:
        self.block, self.used = block, 0

    def take(self, shape: tuple[int, ...]) -> Any:
        start = self.used
        self.used += prod(shape)
        taken = self.block[start : self.used]
        return taken.reshape(*shape, *self.block.shape[1:]) if shape else taken[0].item()


def _leaves(shapes: Any) -> Iterator[tuple[int, ...]]:
    """Shapes of a description, depth first."""
    for entry in shapes:
        if hasattr(entry, "_fields"):
            yield from _leaves(entry)
        else:
            yield entry


def _view(shapes: Any, numbers: _Cursor, integers: _Cursor | None) -> Any:
    if isinstance(shapes, Integers):
        assert integers is not None
        return integers.take(shapes.shape)
    if isinstance(shapes, Interleaved):
        leaves = list(_leaves(shapes.fields))
        rows = numbers.take((*leaves[0], len(leaves)))
        return _filled(shapes.fields, (rows[:, k] for k in range(len(leaves))))
    if hasattr(shapes, "_fields"):
        return type(shapes)(*(_view(entry, numbers, integers) for entry in shapes))
    return numbers.take(shapes)


def _filled(shapes: Any, arrays: Iterator[Any]) -> Any:
    """A description with the next of some arrays for each of its leaves."""
    if not hasattr(shapes, "_fields"):
        return next(arrays)
    return type(shapes)(*(_filled(entry, arrays) for entry in shapes))
