"""Memory of kernels: arrays of described shapes, one after another in a block that is handed in.

A *description* is a named tuple, nested at will, whose leaves are shapes: ``Work(c=(n_l,), inverse=(3, 3))``.
:func:`workspace` turns it into the same tuple of arrays over a block of numbers, and copies nothing. The block says of
which kind the numbers are: a block (size,) holds plain ones, a block (size, WIDTH) numbers in lanes. Blocks are made
once, by :func:`allocate`, so that kernels neither take nor free memory. Kernels fill what they read: what a block held
before does not matter.

Numbers that somebody filled can be read in the same way, by :func:`structure` whole ones as well from a second block:
the shape ``()`` stands for a single number, and ``Integers(shape)`` for whole ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numba import config
from numba.core import types
from numba.core.types.containers import BaseNamedTuple, BaseTuple
from numba.extending import intrinsic, overload
from numba.np.arrayobj import make_array, populate_array

from sffr_gym.compile.lanes import ALIGNMENT, WIDTH, LaneArray, lane_pointer
from sffr_gym.compile.lanes import lanes as LANES
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


class Constant(NamedTuple):
    """A value that stands in a description as it is."""

    value: Any


def allocate(shapes: Any, count: int = 1, *, lanes: bool = False) -> Array:
    """Return ``count`` blocks that hold what a description describes, of plain numbers or of numbers in lanes.

    Returns:
        (count, size) or (count, size, WIDTH), each block aligned as vector registers like it.
    """
    size = sum(prod(shape) for shape in _leaves(shapes))
    shape = (count, -(-size // ALIGNED) * ALIGNED, *([WIDTH] if lanes else []))
    block = np.zeros(prod(shape) + ALIGNED)
    start = -block.ctypes.data // 8 % ALIGNED
    return block[start : start + prod(shape)].reshape(shape)


def workspace(block: Array, shapes: Any) -> Any:
    """Return the described arrays and numbers over a block; in kernels also over an array (size,) of lanes."""
    return _python_view(shapes, _Cursor(block), None)


def new_workspace(shapes: Any) -> Any:
    """Return the described arrays over a block of their own, for Python."""
    return workspace(allocate(shapes)[0], shapes)


def structure(numbers: Array, integers: IntArray, shapes: Any) -> Any:
    """Return the described numbers and arrays over a row of numbers and one of whole numbers."""
    return _python_view(shapes, _Cursor(numbers), _Cursor(integers))


class _Cursor:
    """A block and how much of it is in use, for kernels that run as plain Python."""

    def __init__(self, block: Any) -> None:
        self.block, self.used = block, 0

    def take(self, shape: tuple[int, ...]) -> Any:
        start = self.used
        self.used += prod(shape)
        taken = self.block[start : self.used]
        return taken.reshape(shape) if shape else taken[0]


def _leaves(shapes: Any) -> Iterator[tuple[int, ...]]:
    """Shapes of a description, depth first."""
    for entry in shapes:
        if hasattr(entry, "_fields"):
            yield from _leaves(entry)
        else:
            yield entry


def _python_view(shapes: Any, numbers: _Cursor, integers: _Cursor | None) -> Any:
    if isinstance(shapes, Constant):
        return shapes.value
    if isinstance(shapes, Integers):
        assert integers is not None
        return integers.take(shapes.shape)
    if isinstance(shapes, Interleaved):
        leaves = list(_leaves(shapes.fields))
        rows = numbers.take((*leaves[0], len(leaves)))
        return _filled(shapes.fields, iter(rows.T))
    if hasattr(shapes, "_fields"):
        return type(shapes)(*(_python_view(entry, numbers, integers) for entry in shapes))
    return numbers.take(shapes)


def _filled(shapes: Any, arrays: Iterator[Any]) -> Any:
    """A description with the next of some arrays for each of its leaves."""
    if not hasattr(shapes, "_fields"):
        return next(arrays)
    return type(shapes)(*(_filled(entry, arrays) for entry in shapes))


def _count_leaves(kind: Any) -> int:
    """Number of shapes in a description of some type."""
    return sum(map(_count_leaves, kind.types)) if _is_named(kind) else 1


def _is_named(kind: Any, name: type | None = None) -> bool:
    return isinstance(kind, BaseNamedTuple) and (name is None or kind.instance_class is name)


def _result_type(kind: Any, lanes: bool, layout: Any = "C") -> Any:
    """Type of what a description of some type describes; ``layout`` as numba has it, C or any."""
    if _is_named(kind, Constant):
        return kind.types[0]
    if _is_named(kind, Interleaved):
        return _result_type(kind.types[0], lanes, "A")
    whole = _is_named(kind, Integers)
    if _is_named(kind) and not whole:
        members = [_result_type(member, lanes, layout) for member in kind.types]
        return BaseTuple.from_types(members, kind.instance_class)
    ndim = len(kind.types[0]) if whole else len(kind)
    dtype = types.int64 if whole else types.float64
    if ndim == 0:
        return LANES if lanes and not whole else dtype
    return LaneArray(ndim, layout) if lanes and not whole else types.Array(dtype, ndim, layout)


class _Layout:
    """Emits the code that lays arrays over blocks, one after another."""

    def __init__(self, context: Any, builder: Any, numbers: Any, integers: Any, itemsize: int) -> None:
        self._context, self._builder = context, builder
        self._pointers = {False: numbers, True: integers}
        self._used = {whole: context.get_constant(types.intp, 0) for whole in self._pointers}
        self._itemsize = {False: itemsize, True: 8}

    def view(self, kind: Any, value: Any, result: Any) -> Any:
        """What the description ``value`` of type ``kind`` describes, of type ``result``."""
        context, builder = self._context, self._builder
        if _is_named(kind, Constant):
            return builder.extract_value(value, 0)
        if _is_named(kind, Integers):
            return self._take(kind.types[0], builder.extract_value(value, 0), result, whole=True)
        if _is_named(kind, Interleaved):
            return self._interleaved(kind.types[0], builder.extract_value(value, 0), result)
        if not _is_named(kind):
            return self._take(kind, value, result, whole=False)
        members = [
            self.view(member, builder.extract_value(value, i), result.types[i]) for i, member in enumerate(kind.types)
        ]
        return context.make_tuple(builder, result, members)

    def _interleaved(self, kind: Any, value: Any, result: Any) -> Any:
        """The next arrays of one length, entry by entry."""
        context, builder, width = self._context, self._builder, _count_leaves(kind)
        first = builder.gep(self._pointers[False], [self._used[False]])
        itemsize, column, length = self._itemsize[False], 0, None

        def fill(kind: Any, value: Any, result: Any) -> Any:
            nonlocal column, length
            if _is_named(kind):
                members = [
                    fill(member, builder.extract_value(value, i), result.types[i])
                    for i, member in enumerate(kind.types)
                ]
                return context.make_tuple(builder, result, members)
            length = context.cast(builder, builder.extract_value(value, 0), kind.types[0], types.intp)
            array = make_array(result)(context, builder)
            populate_array(
                array, data=builder.gep(first, [context.get_constant(types.intp, column)]), shape=[length],
                strides=[context.get_constant(types.intp, width * itemsize)],
                itemsize=context.get_constant(types.intp, itemsize), meminfo=None,
            )  # fmt: skip
            column += 1
            return array._getvalue()

        filled = fill(kind, value, result)
        size = builder.mul(length, context.get_constant(types.intp, width))
        self._used[False] = builder.add(self._used[False], size)
        return filled

    def _take(self, kind: Any, shape: Any, result: Any, whole: bool) -> Any:
        """The next array of a shape, or the next number."""
        context, builder = self._context, self._builder
        place = builder.gep(self._pointers[whole], [self._used[whole]])
        sides = [
            context.cast(builder, builder.extract_value(shape, i), member, types.intp)
            for i, member in enumerate(kind.types)
        ]
        count = context.get_constant(types.intp, 1)
        strides: list[Any] = []
        for side in reversed(sides):
            strides.insert(0, builder.mul(count, context.get_constant(types.intp, self._itemsize[whole])))
            count = builder.mul(count, side)
        self._used[whole] = builder.add(self._used[whole], count)
        if not sides:
            return builder.load(place)
        array = make_array(result)(context, builder)
        populate_array(
            array, data=place, shape=sides, strides=strides,
            itemsize=context.get_constant(types.intp, self._itemsize[whole]), meminfo=None,
        )  # fmt: skip
        return array._getvalue()


if not config.DISABLE_JIT:

    @intrinsic
    def _workspace(typingctx: Any, block: Any, shapes: Any) -> Any:
        lanes = block.ndim == 2 or isinstance(block, LaneArray)
        result = _result_type(shapes, lanes)

        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            pointer = make_array(block)(context, builder, arguments[0]).data
            if block.ndim == 2:
                pointer = lane_pointer(builder, pointer)
            layout = _Layout(context, builder, pointer, None, 8 * WIDTH if lanes else 8)
            return layout.view(shapes, arguments[1], result)

        return result(block, shapes), codegen

    @intrinsic
    def _structure(typingctx: Any, numbers: Any, integers: Any, shapes: Any) -> Any:
        result = _result_type(shapes, lanes=False)

        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            pointers = [
                make_array(kind)(context, builder, row).data
                for kind, row in zip((numbers, integers), arguments[:2], strict=True)
            ]
            return _Layout(context, builder, pointers[0], pointers[1], 8).view(shapes, arguments[2], result)

        return result(numbers, integers, shapes), codegen

    @overload(workspace, jit_options={"forceinline": True, "_nrt": False})
    def _workspace_overload(block, shapes):
        return lambda block, shapes: _workspace(block, shapes)

    @overload(structure, jit_options={"forceinline": True, "_nrt": False})
    def _structure_overload(numbers, integers, shapes):
        return lambda numbers, integers, shapes: _structure(numbers, integers, shapes)
