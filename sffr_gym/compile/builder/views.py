"""The compiler's types for arguments: views of their words, see :mod:`sffr_gym.compile.arguments`.

A named tuple becomes the address of its words. Reading a field of it loads what the words say there, which never
changes during a call: the compiler is told so, and loads it once.
"""

from __future__ import annotations

import itertools
import operator
from collections.abc import Iterator
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types as _types
from numba.core.datamodel import PrimitiveModel, register_default
from numba.core.imputils import lower_builtin, lower_getattr_generic
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_getattr, infer_global, signature
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from sffr_gym.compile.arguments import KINDS, LaneArray, Structures, interleaved
from sffr_gym.compile.builder.lanes import LaneArray as LaneArrayType
from sffr_gym.compile.lanes import WIDTH

types: Any = _types  # whose annotations do not know all that it has
WORD = ir.IntType(64)
_NUMBERS = itertools.count()  # of types, whose names tell them apart
DTYPES = {"f": types.float64, "i": types.int64, "b": types.boolean}


class View(types.Type):
    """A named tuple in memory.

    Attributes:
        fields: type and place [words] of each field.
        words: how many it takes.
    """

    def __init__(self, name: str, fields: dict[str, tuple[Any, int]], words: int) -> None:
        self.fields, self.words = fields, words
        super().__init__(name=name)


class Columns(types.Type):
    """A named tuple of arrays that lie entry by entry.

    Attributes:
        fields: of each its column, or the :class:`Columns` of a tuple.
        array: the type of all arrays.
        width: how many columns there are.
    """

    def __init__(self, name: str, fields: dict[str, Any], array: Any, width: int) -> None:
        self.fields, self.array, self.width = fields, array, width
        super().__init__(name=name)


class Views(types.Type):
    """Named tuples of one form one after another."""

    def __init__(self, element: View) -> None:
        self.element = element
        super().__init__(name=f"views({element.name})")


class _Pointer(PrimitiveModel):
    def __init__(self, manager: Any, type_: Any) -> None:
        super().__init__(manager, type_, WORD.as_pointer())


register_default(View)(_Pointer)
register_default(Columns)(_Pointer)


@register_default(Views)
class _Counted(PrimitiveModel):
    """Address, number and words of each, by the address of these three."""

    def __init__(self, manager: Any, type_: Any) -> None:
        super().__init__(manager, type_, WORD.as_pointer())


class TypeMaker:
    """Makes types of values, the same one for the same form."""

    def __init__(self) -> None:
        self._views: dict[Any, View] = {}
        self._columns: dict[Any, Columns] = {}

    def type_of(self, value: Any) -> tuple[Any, int]:
        """Return the type of a value, and how many words it takes."""
        if isinstance(value, np.ndarray):
            return self._array(value)
        if isinstance(value, Structures):
            element, _ = self.type_of(value[0])
            return Views(element), 3
        if isinstance(value, tuple) and (columns := interleaved(value)) is not None:
            array, _ = self._array(columns[0])
            return self._make_columns(value, array, len(columns), itertools.count()), 2
        if hasattr(value, "_fields"):
            view = self._view(value)
            return view, view.words
        if isinstance(value, tuple):
            parts = [self.type_of(part) for part in value]
            return types.Tuple([kind for kind, _ in parts]), sum(words for _, words in parts)
        if isinstance(value, bool | np.bool_):
            return types.boolean, 1
        return (types.int64 if isinstance(value, int | np.integer) else types.float64), 1

    def _array(self, value: np.ndarray) -> tuple[Any, int]:
        layout = "C" if value.flags.c_contiguous else "A"
        if isinstance(value, LaneArray):
            return LaneArrayType(value.ndim - 1, layout), 2 * value.ndim - 1
        return types.Array(DTYPES[KINDS[value.dtype]], value.ndim, layout), 2 * value.ndim + 1

    def _make_columns(self, value: Any, array: Any, width: int, column: Iterator[int]) -> Columns:
        fields = {
            name: self._make_columns(part, array, width, column) if isinstance(part, tuple) else next(column)
            for name, part in zip(value._fields, value, strict=True)
        }
        key = (type(value), array, width, *fields.items())
        if key not in self._columns:
            self._columns[key] = Columns(f"{type(value).__name__}Columns{next(_NUMBERS)}", fields, array, width)
        return self._columns[key]

    def _view(self, value: Any) -> View:
        fields, place = {}, 0
        for name, part in zip(value._fields, value, strict=True):
            kind, words = self.type_of(part)
            fields[name] = kind, place
            place += words
        key = (type(value), *fields.items())
        if key not in self._views:
            self._views[key] = View(f"{type(value).__name__}{next(_NUMBERS)}", fields, place)
        return self._views[key]


def _word(builder: Any, words: Any, k: int) -> Any:
    """Emit the code that loads a word, which does not change during the call."""
    loaded = builder.load(builder.gep(words, [WORD(k)]))
    loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
    return loaded


def load(context: Any, builder: Any, kind: Any, words: Any) -> Any:
    """Emit the code that reads a value of a type from its words."""

    def word(k: int) -> Any:
        return _word(builder, words, k)

    if isinstance(kind, View | Views | Columns):
        return words
    if isinstance(kind, types.Array):
        ndim, lanes = kind.ndim, isinstance(kind, LaneArrayType)
        size = 8 * WIDTH if lanes else 1 if kind.dtype == types.boolean else 8
        shape = [word(1 + k) for k in range(ndim)]
        if kind.layout == "C":
            strides: list[Any] = []
            step = WORD(size)
            for side in reversed(shape):
                strides.insert(0, step)
                step = builder.mul(step, side)
        else:
            strides = [word(1 + ndim + k) for k in range(ndim)]
        array = make_array(kind)(context, builder)
        data = builder.inttoptr(word(0), context.get_data_type(kind.dtype).as_pointer())
        populate_array(array, data=data, shape=shape, strides=strides, itemsize=WORD(size), meminfo=None)
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):
        parts, place = [], 0
        for part in kind.types:
            parts.append(load(context, builder, part, builder.gep(words, [WORD(place)])))
            place += 1
        return context.make_tuple(builder, kind, parts)
    if kind == types.boolean:
        return builder.icmp_signed("!=", word(0), WORD(0))
    return builder.bitcast(word(0), ir.DoubleType()) if kind == types.float64 else word(0)


@infer_getattr
class _ViewAttributes(AttributeTemplate):
    key = View

    def generic_resolve(self, view: Any, name: str) -> Any:
        """Numba's way to the type of an attribute."""
        return view.fields[name][0] if name in view.fields else None


@lower_getattr_generic(View)
def _view_field(context: Any, builder: Any, view: Any, value: Any, name: str) -> Any:
    kind, place = view.fields[name]
    return load(context, builder, kind, builder.gep(value, [WORD(place)]))


@infer_getattr
class _ColumnsAttributes(AttributeTemplate):
    key = Columns

    def generic_resolve(self, columns: Any, name: str) -> Any:
        """Numba's way to the type of an attribute."""
        field = columns.fields.get(name)
        return columns.array if isinstance(field, int) else field


@lower_getattr_generic(Columns)
def _column(context: Any, builder: Any, columns: Any, value: Any, name: str) -> Any:
    column, kind = columns.fields[name], columns.array
    if not isinstance(column, int):
        return value
    size = 8 * WIDTH if isinstance(kind, LaneArrayType) else 8
    first = builder.inttoptr(_word(builder, value, 0), context.get_data_type(kind.dtype).as_pointer())
    array = make_array(kind)(context, builder)
    populate_array(
        array, data=builder.gep(first, [WORD(column)]), shape=[_word(builder, value, 1)],
        strides=[WORD(size * columns.width)], itemsize=WORD(size), meminfo=None,
    )  # fmt: skip
    return array._getvalue()


@infer_global(operator.getitem)
class _ViewsItem(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        views = args[0]
        return signature(views.element, views, types.int64) if isinstance(views, Views) else None


@lower_builtin(operator.getitem, Views, types.int64)
def _views_item(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    views, i = arguments
    first, size = load(context, builder, types.int64, views), signature.args[0].element.words
    return builder.gep(builder.inttoptr(first, WORD.as_pointer()), [builder.mul(i, WORD(size))])


@infer_global(len)
class _ViewsLength(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(types.int64, *args) if len(args) == 1 and isinstance(args[0], Views) else None


@lower_builtin(len, Views)
def _views_length(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return load(context, builder, types.int64, builder.gep(arguments[0], [WORD(1)]))


def unpacker(kinds: Any) -> Any:
    """Return the intrinsic that reads arguments of some types, one after another, from the words at an address."""

    @intrinsic
    def unpack(typingctx: Any, words: Any) -> Any:
        result = types.Tuple([kind for kind, _ in kinds])

        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            parts, place = [], 0
            for kind, count in kinds:
                parts.append(load(context, builder, kind, builder.gep(arguments[0], [WORD(place)])))
                place += count
            return context.make_tuple(builder, result, parts)

        return result(words), codegen

    return unpack
