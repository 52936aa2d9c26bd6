"""The compiler's types for a thread's arguments: structures whose shapes and whole numbers are constants of the code.

A thread has a frame of words: how many environments there are, which one is its own, and where each array begins. A
structure is the address of the frame, and its type knows where in it each field is.
"""

from __future__ import annotations

import itertools
import operator
from collections.abc import Callable
from math import prod
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils
from numba.core import types as _types
from numba.core.datamodel import PrimitiveModel, register_default
from numba.core.imputils import lower_builtin, lower_getattr_generic
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_getattr, infer_global, signature
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from sffr_gym.compile.arguments import KINDS, Structures
from sffr_gym.compile.builder.views import DTYPES, WORD
from sffr_gym.compile.cuda.described import Fixed, Memory, Own, Place, Row, Rows
from sffr_gym.compile.workspace import Interleaved

types: Any = _types
_NUMBERS = itertools.count()
COUNT, INDEX, POINTERS = 0, 1, 2  # words of a frame
SIZES = {"f": 8, "i": 8, "b": 1}
Sourced = tuple[Any, Callable[..., Any]]  # a type, and what emits a value of it from the frame


class Part(types.Type):
    """A structure.

    Attributes:
        fields: type and source of each.
    """

    def __init__(self, name: str, fields: dict[str, tuple[Any, Any]]) -> None:
        self.fields = fields
        super().__init__(name=f"{name}Part{next(_NUMBERS)}")


class Only(types.Type):
    """Structures of which a thread sees one."""

    def __init__(self, element: Part) -> None:
        self.element = element
        super().__init__(name=f"only({element.name})")


class _Frame(PrimitiveModel):
    def __init__(self, manager: Any, type_: Any) -> None:
        super().__init__(manager, type_, WORD.as_pointer())


register_default(Part)(_Frame)
register_default(Only)(_Frame)


class Describer:
    """Finds types and sources of described arguments, and lays out the frame.

    Attributes:
        arrays: for each pointer to an array of the caller its kind.
        memory: for each array of the thread itself how many numbers it has.
    """

    def __init__(self) -> None:
        self.arrays: list[str] = []
        self.memory: list[int] = []
        self._column = 0
        self._own: int | None = None

    def describe(self, value: Any) -> Sourced:
        """Return the type of an argument, and what emits its value from the frame."""
        if isinstance(value, Rows | Row | Fixed):
            return self._shared(value)
        if isinstance(value, Memory):
            return self._memory(value.shapes)
        if isinstance(value, Place):
            return types.int64, lambda context, builder, frame: builder.add(
                _load(builder, frame, INDEX), WORD(value.beyond)
            )
        if isinstance(value, Own):
            self._own, self._column = self._pointer("f"), 0
            element, _ = self._part(value.exemplar)
            self._own = None
            return Only(element), _same
        if isinstance(value, Structures):
            return Only(self.describe(value[0])[0]), _same
        if isinstance(value, tuple):
            return self._part(value)
        return self._array(value) if isinstance(value, np.ndarray) else self._number(value)

    def _part(self, value: Any) -> Sourced:
        fields = {name: self.describe(each) for name, each in zip(value._fields, value, strict=True)}
        return Part(type(value).__name__, fields), _same

    def _pointer(self, kind: str) -> int:
        self.arrays.append(kind)
        return len(self.arrays) - 1

    def _shared(self, value: Rows | Row | Fixed) -> Sourced:
        shape, sort = value.array
        place, size = self._pointer(sort), SIZES[sort]
        if isinstance(value, Fixed):
            fixed = types.Array(DTYPES[sort], len(shape), "C")
            return fixed, lambda context, builder, frame: _contiguous(
                context, builder, fixed, _pointer(builder, frame, place), shape, size
            )
        kind = types.Array(DTYPES[sort], 1 + len(shape), "A" if shape else "C")

        def emit(context: Any, builder: Any, frame: Any) -> Any:
            count, data = _load(builder, frame, COUNT), _pointer(builder, frame, place)
            steps = [builder.mul(count, WORD(step)) for step in _steps(shape, size)]
            if isinstance(value, Rows):
                return _make(context, builder, kind, data, [count, *map(WORD, shape)], [WORD(size), *steps], size)
            data = builder.gep(
                builder.bitcast(data, ir.IntType(8).as_pointer()),
                [builder.mul(_load(builder, frame, INDEX), WORD(size))],
            )
            return _make(context, builder, kind, data, [WORD(1), *map(WORD, shape)], [WORD(size), *steps], size)

        return kind, emit

    def _memory(self, shapes: Any) -> Sourced:
        if isinstance(shapes, Interleaved):
            shapes = shapes.fields
        if hasattr(shapes, "_fields"):
            fields = {name: self._memory(each) for name, each in zip(shapes._fields, shapes, strict=True)}
            return Part(type(shapes).__name__, fields), _same
        self.memory.append(prod(shapes))
        own, kind = len(self.memory) - 1, types.Array(types.float64, len(shapes), "C")

        def emit(context: Any, builder: Any, frame: Any) -> Any:
            data = _pointer(builder, frame, len(self.arrays) + own)  # all are known when code is emitted
            return _contiguous(context, builder, kind, data, shapes, 8)

        return kind, emit

    def _array(self, array: np.ndarray) -> Sourced:
        sort, shape = KINDS[array.dtype], array.shape
        kind, size = types.Array(DTYPES[sort], array.ndim, "C"), SIZES[sort]
        if self._own is not None and sort == "f":
            place, column = self._own, self._column
            self._column += array.size
            kind = types.Array(types.float64, array.ndim, "A")

            def emit_own(context: Any, builder: Any, frame: Any) -> Any:
                count, data = _load(builder, frame, COUNT), _column(builder, frame, place, column)
                steps = [builder.mul(count, WORD(step)) for step in _steps(shape, 8)]
                return _make(context, builder, kind, data, list(map(WORD, shape)), steps, 8)

            return kind, emit_own
        element = {"f": ir.DoubleType(), "i": WORD, "b": ir.IntType(8)}[sort]
        values = array.ravel().tolist() if array.size else [0]

        def emit(context: Any, builder: Any, frame: Any) -> Any:
            constant = ir.Constant(ir.ArrayType(element, len(values)), [element(value) for value in values])
            held = cgutils.global_constant(builder, "constant", constant)
            return _contiguous(context, builder, kind, builder.bitcast(held, element.as_pointer()), shape, size)

        return kind, emit

    def _number(self, value: Any) -> Sourced:
        if isinstance(value, bool | np.bool_):
            return types.boolean, lambda context, builder, frame: ir.Constant(ir.IntType(1), int(value))
        if isinstance(value, int | np.integer):
            return types.int64, lambda context, builder, frame: WORD(int(value))
        if self._own is not None:
            place, column = self._own, self._column
            self._column += 1
            return types.float64, lambda context, builder, frame: builder.load(_column(builder, frame, place, column))
        return types.float64, lambda context, builder, frame: ir.DoubleType()(float(value))


def _same(context: Any, builder: Any, frame: Any) -> Any:
    return frame


def _load(builder: Any, frame: Any, k: int) -> Any:
    return builder.load(builder.gep(frame, [WORD(k)]))


def _pointer(builder: Any, frame: Any, place: int) -> Any:
    """Emit the load of the address of an array: those of the caller, then those of the thread itself."""
    return builder.inttoptr(_load(builder, frame, POINTERS + place), ir.DoubleType().as_pointer())


def _column(builder: Any, frame: Any, place: int, column: int) -> Any:
    """Emit the address of a number in a column of those that each environment has of its own."""
    at = builder.add(builder.mul(_load(builder, frame, COUNT), WORD(column)), _load(builder, frame, INDEX))
    return builder.gep(_pointer(builder, frame, place), [at])


def _contiguous(context: Any, builder: Any, kind: Any, data: Any, shape: tuple[int, ...], size: int) -> Any:
    return _make(context, builder, kind, data, list(map(WORD, shape)), list(map(WORD, _steps(shape, size))), size)


def _steps(shape: tuple[int, ...], size: int) -> list[int]:
    """Bytes between neighbours along each side of an array of numbers of a size, where these lie close together."""
    return [size * prod(shape[k + 1 :]) for k in range(len(shape))]


def _make(context: Any, builder: Any, kind: Any, data: Any, shape: Any, strides: Any, size: int) -> Any:
    array = make_array(kind)(context, builder)
    pointer = builder.bitcast(data, context.get_data_type(kind.dtype).as_pointer())
    populate_array(array, data=pointer, shape=shape, strides=strides, itemsize=WORD(size), meminfo=None)
    return array._getvalue()


@infer_getattr
class _PartAttributes(AttributeTemplate):
    key = Part

    def generic_resolve(self, part: Any, name: str) -> Any:
        """Numba's way to the type of an attribute."""
        return part.fields[name][0] if name in part.fields else None


@lower_getattr_generic(Part)
def _part_field(context: Any, builder: Any, part: Any, value: Any, name: str) -> Any:
    return part.fields[name][1](context, builder, value)


@infer_global(operator.getitem)
class _OnlyItem(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(args[0].element, args[0], types.int64) if isinstance(args[0], Only) else None


@lower_builtin(operator.getitem, Only, types.int64)
def _only_item(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return arguments[0]


@infer_global(len)
class _OnlyLength(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(types.int64, *args) if len(args) == 1 and isinstance(args[0], Only) else None


@lower_builtin(len, Only)
def _only_length(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return WORD(1)


def unpacker(sources: list[tuple[Any, Any]]) -> Any:
    """Return the intrinsic that makes arguments of a frame."""

    @intrinsic
    def unpack(typingctx: Any, frame: Any) -> Any:
        result = types.Tuple([kind for kind, _ in sources])

        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return context.make_tuple(builder, result, [emit(context, builder, arguments[0]) for _, emit in sources])

        return result(frame), codegen

    return unpack
