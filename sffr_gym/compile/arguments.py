"""The interface of compiled code: a block of words that says where each array lies and what each number is.

An argument is a named tuple, nested at will, of arrays and numbers. In the block its parts follow one another, depth
first: a number takes a word, an array of ``n`` dimensions its address, ``n`` lengths and ``n`` strides, a named tuple
of arrays that lie entry by entry an address and a length, and :class:`Structures` the address of their own words, how
many they are and how many words each has. What kinds of parts there are is the *form* of the arguments, for which an
entry is compiled; how long its arrays are is not a part of it.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

KINDS = {np.dtype(np.float64): "f", np.dtype(np.int64): "i", np.dtype(np.bool_): "b"}


class LaneArray(np.ndarray):
    """An array (..., WIDTH) whose last axis are lanes; see :mod:`sffr_gym.compile.lanes`."""


class Structures(Sequence[Any]):
    """Named tuples of one form, which a kernel indexes, such as the robots of a batch.

    Args:
        items: of one form; at least one.

    Raises:
        TypeError: for items of several forms.
    """

    def __init__(self, items: Iterable[Any]) -> None:
        self._items = list(items)
        self._rows: np.ndarray | None = None
        self._form = ""

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._items)

    def __getitem__(self, i: Any) -> Any:
        """Return one of them."""
        return self._items[i]

    def __setitem__(self, i: int, item: Any) -> None:
        """Put another one of the same form in a place; prepared calls see it."""
        rows = self.rows  # first, since the form that an item must have comes with them
        rows[i] = self._words(item)
        self._items[i] = item

    def __iter__(self) -> Iterator[Any]:
        """Iterate over them."""
        return iter(self._items)

    def __reduce__(self) -> Any:
        """Copy them, not where they lie."""
        return Structures, (self._items,)

    @property
    def rows(self) -> np.ndarray:
        """Their words (n, words)."""
        if self._rows is None:
            self._form = "".join(_Writer().add(self._items[0]).form)
            self._rows = np.array([self._words(item) for item in self._items], dtype=np.int64)
        return self._rows

    @property
    def form(self) -> str:
        """The form of one of them."""
        self.rows  # noqa: B018
        return self._form

    def _words(self, item: Any) -> list[int]:
        written = _Writer().add(item)
        if (form := "".join(written.form)) != self._form:
            raise TypeError(f"a structure of the form {form} among such of the form {self._form}")
        return written.words


class Block:
    """The words of some arguments.

    Attributes:
        form: of the arguments.
        address: of the first word.

    Raises:
        TypeError: for what is no array, number or named tuple of such, and arrays of other types or another layout
            than kernels know.
    """

    def __init__(self, arguments: tuple[Any, ...]) -> None:
        written = _Writer()
        for argument in arguments:
            written.add(argument)
        self._words = np.array(written.words, dtype=np.int64)
        self._kept = arguments  # as long as their addresses are known here
        self.form = "".join(written.form)
        self.address = self._words.ctypes.data


class _Writer:
    """Writes words and form."""

    def __init__(self) -> None:
        self.words: list[int] = []
        self.form: list[str] = []

    def add(self, value: Any) -> _Writer:
        """Write a value."""
        if isinstance(value, np.ndarray):
            self._add_array(value)
        elif isinstance(value, tuple):
            if (columns := interleaved(value)) is not None:
                kind = "l" if isinstance(columns[0], LaneArray) else "f"
                self.form.append(f"{kind}x{len(columns)}")
                self.words += (_address(columns[0]), len(columns[0]))
            else:
                for part in value:
                    self.add(part)
        elif isinstance(value, Structures):
            self.form.append(f"({value.form})")
            self.words += (value.rows.ctypes.data, *value.rows.shape)
        elif isinstance(value, bool | np.bool_):
            self.form.append("b0")
            self.words.append(int(value))
        elif isinstance(value, int | np.integer):
            self.form.append("i0")
            self.words.append(int(value))
        elif isinstance(value, float):
            self.form.append("f0")
            self.words.append(struct.unpack("=q", struct.pack("=d", value))[0])
        else:
            raise TypeError(f"kernels know arrays and numbers, got {type(value).__name__}")
        return self

    def _add_array(self, array: np.ndarray) -> None:
        """Write an array."""
        kind, shape, strides, flags = KINDS.get(array.dtype), array.shape, array.strides, array.flags
        if kind is None or not flags.aligned:
            raise TypeError(f"kernels know aligned arrays of float64, int64 and bool, got one of {array.dtype}")
        if isinstance(array, LaneArray):
            kind, shape, strides = "l", shape[:-1], strides[:-1]
        self.form.append(f"{kind if flags.c_contiguous else kind.upper()}{len(shape)}")
        self.words += (_address(array), *shape, *strides)


def interleaved(value: tuple[Any, ...]) -> list[np.ndarray] | None:
    """Return the arrays of a named tuple, nested at will, if they lie entry by entry; see ``workspace.Interleaved``."""
    one = next(_leaves(value), None)
    if not isinstance(one, np.ndarray) or one.dtype != np.float64:
        return None
    shape, strides = one.shape, one.strides
    if len(shape) != 1 + isinstance(one, LaneArray):
        return None
    size = 8 if len(shape) == 1 else strides[1] * shape[1]
    if strides[0] < 2 * size:  # most tuples: told by one of their arrays, without a look at the others
        return None
    leaves = list(_leaves(value))
    if strides[0] != size * len(leaves):
        return None
    if not all(isinstance(leaf, np.ndarray) and leaf.dtype == np.float64 for leaf in leaves):
        return None
    first = _address(one)
    as_one = all(
        leaf.shape == shape and leaf.strides == strides and _address(leaf) == first + k * size
        for k, leaf in enumerate(leaves)
    )
    return leaves if as_one else None


def _leaves(value: Any) -> Iterator[Any]:
    """Parts of nested tuples, depth first."""
    if isinstance(value, tuple):
        for part in value:
            yield from _leaves(part)
    else:
        yield value


def _address(array: np.ndarray) -> int:
    return int(array.__array_interface__["data"][0])
