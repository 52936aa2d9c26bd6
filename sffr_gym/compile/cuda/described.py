"""What a kernel is given in a CUDA thread: a description of each argument, nested as the arguments are.

A kernel is compiled for arguments whose shapes are known, so that loops over links, panels and modes have a known
length and a thread's memory can lie in registers. Plain numbers and arrays become constants of the code. In the place
of others stand the kinds of this module. An array with a row for each environment has its rows across, (n, ...) with
strides ``(1, ..., n)``, so that what threads beside each other read lies together; see :func:`rows`.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import prod
from typing import Any, NamedTuple

import numpy as np

from sffr_gym.compile.arguments import KINDS

DTYPES = {kind: dtype for dtype, kind in KINDS.items()}


class Rows(NamedTuple):
    """An array with a row for each environment, as the kernel takes it: with all its rows."""

    array: Any  #: (n, ...) on the device


class Row(NamedTuple):
    """The same, but the kernel sees the row of the thread's environment alone, (1, ...)."""

    array: Any


class Fixed(NamedTuple):
    """An array that all threads share, of a shape that stays."""

    array: Any  #: contiguous


class Own(NamedTuple):
    """Structures of which each environment has its own, seen as the thread's alone; their whole numbers are alike."""

    exemplar: Any
    array: Any  #: (n, k) floats of each, in the order of :func:`numbers_of`


class Memory(NamedTuple):
    """Memory of a thread: the shapes of a workspace, see :mod:`sffr_gym.compile.workspace`."""

    shapes: Any


class Place(NamedTuple):
    """A whole number that the thread knows: its environment, or one beyond."""

    beyond: int


FIRST, LAST = Place(0), Place(1)


class Shape(NamedTuple):
    """Stands for an array in a description that is compiled."""

    shape: tuple[int, ...]  #: of a row where there are rows
    kind: str  #: see ``arguments.KINDS``


class Thread(NamedTuple):
    """A kernel and what it is given in each thread.

    Attributes:
        name: in the program.
        function: an entry, or a kernel.
        arguments: described.
    """

    name: str
    function: Any
    arguments: tuple[Any, ...]


def rows(xp: Any, n: int, shape: tuple[int, ...], kind: str) -> Any:
    """Return an array (n, ...) of zeros whose rows lie across, by the array module ``xp``."""
    return across(xp.zeros((prod(shape), n), dtype=DTYPES[kind]), shape)


def across(columns: Any, shape: tuple[int, ...]) -> Any:
    """Return columns (k, n) as rows (n, ...); a view."""
    return columns.reshape(*shape, columns.shape[1]).transpose(len(shape), *range(len(shape)))


def stripped(value: Any) -> Any:
    """Return a description without its arrays: what code is compiled for."""
    if isinstance(value, Rows | Row):
        return type(value)(Shape(tuple(value.array.shape[1:]), KINDS[np.dtype(value.array.dtype)]))
    if isinstance(value, Fixed):
        return Fixed(Shape(tuple(value.array.shape), KINDS[np.dtype(value.array.dtype)]))
    if isinstance(value, Own):
        return Own(_blank(value.exemplar), None)
    if hasattr(value, "_fields") and not isinstance(value, Memory):
        return type(value)(*map(stripped, value))
    return value


def _blank(value: Any) -> Any:
    """Return a structure whose floats are 0: what all that differ in numbers alone have in common."""
    if isinstance(value, tuple):
        return type(value)(*map(_blank, value))
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return np.zeros(value.shape)
    return 0.0 if isinstance(value, float) else value


def arrays_of(value: Any) -> Iterator[Any]:
    """Yield the arrays of a description, in the order in which compiled code takes them."""
    if isinstance(value, Rows | Row | Fixed | Own):
        yield value.array
    elif isinstance(value, tuple) and not isinstance(value, Memory):
        for part in value:
            yield from arrays_of(part)


def numbers_of(value: Any) -> list[float]:
    """Return the floats of a structure, depth first."""
    if isinstance(value, tuple):
        return [number for part in value for number in numbers_of(part)]
    array = np.asarray(value)
    return list(array.ravel().tolist()) if array.dtype == np.float64 else []
