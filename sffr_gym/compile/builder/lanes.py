"""The compiler's kind of number for lanes: a type like ``float64``, but a vector register of ``WIDTH`` of them."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import PrimitiveModel, register_default
from numba.core.datamodel.models import ArrayModel
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, overload
from numba.np.arrayobj import make_array, populate_array

from sffr_gym.compile.builder.options import OPTIONS
from sffr_gym.compile.lanes import WIDTH, any_lane, columns, floor, where

DOUBLES = ir.VectorType(ir.DoubleType(), WIDTH)
BITS = ir.VectorType(ir.IntType(1), WIDTH)
SCALARS = (types.Float, types.Integer)


class Lanes(types.Type):
    """Numbers side by side; a plain number becomes lanes that are all alike."""

    def __init__(self) -> None:
        super().__init__(name=f"lanes{WIDTH}")

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """Numba's rule of conversion."""
        return Conversion.safe if isinstance(other, SCALARS) else None


class Mask(types.Type):
    """Truth values side by side, of a comparison of lanes."""

    def __init__(self) -> None:
        super().__init__(name=f"mask{WIDTH}")

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """Numba's rule of conversion."""
        return Conversion.safe if isinstance(other, types.Boolean) else None


class LaneArray(types.Array):
    """An array of lanes, known to kernels alone."""

    def __init__(self, ndim: int, layout: Any = "C") -> None:
        super().__init__(lanes, ndim, layout, aligned=False, name=f"array({lanes.name}, {ndim}d, {layout})")

    def copy(self, dtype: Any = None, ndim: Any = None, layout: Any = None, readonly: Any = None) -> Any:
        """Numba's way to the type of a part."""
        return LaneArray(self.ndim if ndim is None else ndim, self.layout if layout is None else layout)


lanes, mask = Lanes(), Mask()
NUMBERS = types.float64


def _splat(builder: Any, value: Any) -> Any:
    """Lanes that all have one value."""
    single = builder.insert_element(ir.Constant(DOUBLES, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    everywhere = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(single, ir.Constant(DOUBLES, ir.Undefined), everywhere)


@register_default(Lanes)
class _LanesModel(PrimitiveModel):
    def __init__(self, manager: Any, type_: Any) -> None:
        super().__init__(manager, type_, DOUBLES)


@register_default(Mask)
class _MaskModel(PrimitiveModel):
    def __init__(self, manager: Any, type_: Any) -> None:
        super().__init__(manager, type_, BITS)


register_default(LaneArray)(ArrayModel)


@lower_cast(types.Float, Lanes)
@lower_cast(types.Integer, Lanes)
def _number_to_lanes(context: Any, builder: Any, source: Any, target: Any, value: Any) -> Any:
    return _splat(builder, context.cast(builder, value, source, NUMBERS))


@lower_cast(types.Boolean, Mask)
def _truth_to_mask(context: Any, builder: Any, source: Any, target: Any, value: Any) -> Any:
    return builder.select(value, ir.Constant(BITS, [1] * WIDTH), ir.Constant(BITS, [0] * WIDTH))


def _define(function: Any, count: int, kind: Any, result: Any, emit: Callable[..., Any]) -> None:
    """Teach numba a function of ``count`` arguments of a kind, any but one of which may be plain."""
    plain = SCALARS if kind is lanes else (types.Boolean,)

    class Template(AbstractTemplate):
        key = function

        def generic(self, args: Any, kws: Any) -> Any:
            if len(args) != count or kind not in args:
                return None
            return signature(result, *[kind] * count) if all(a == kind or isinstance(a, plain) for a in args) else None

    infer_global(function)(Template)
    lower_builtin(function, *[type(kind)] * count)(
        lambda context, builder, signature, arguments: emit(context, builder, *arguments)
    )


def _vector_instruction(name: str) -> Callable[..., Any]:
    """A function that LLVM knows for vectors."""

    def emit(context: Any, builder: Any, x: Any) -> Any:
        kind = ir.FunctionType(DOUBLES, [DOUBLES])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"{name}.v{WIDTH}f64"), [x])

    return emit


def _lane_by_lane(function: Any) -> Callable[..., Any]:
    """The function of plain numbers, one lane after the other: the same bits."""

    def emit(context: Any, builder: Any, *arguments: Any) -> Any:
        kind = signature(NUMBERS, *[NUMBERS] * len(arguments))
        call, result = context.get_function(function, kind), ir.Constant(DOUBLES, ir.Undefined)
        for k in range(WIDTH):
            at = ir.Constant(ir.IntType(32), k)
            value = call(builder, [builder.extract_element(x, at) for x in arguments])
            result = builder.insert_element(result, value, at)
        return result

    return emit


def _instruction(name: str) -> Callable[..., Any]:
    return lambda context, builder, x, y: getattr(builder, name)(x, y)


def _comparison(name: str) -> Callable[..., Any]:
    return lambda context, builder, x, y: builder.fcmp_ordered(name, x, y)


def _define_arithmetic() -> None:
    for name, instruction in ("add", "fadd"), ("sub", "fsub"), ("mul", "fmul"), ("truediv", "fdiv"):
        _define(getattr(operator, name), 2, lanes, lanes, _instruction(instruction))
        _define(getattr(operator, f"i{name}"), 2, lanes, lanes, _instruction(instruction))
    for function, symbol in (operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="):
        _define(function, 2, lanes, mask, _comparison(symbol))
    _define(operator.eq, 2, lanes, mask, _comparison("=="))
    _define(operator.ne, 2, lanes, mask, lambda context, builder, x, y: builder.fcmp_unordered("!=", x, y))
    _define(operator.and_, 2, mask, mask, _instruction("and_"))
    _define(operator.or_, 2, mask, mask, _instruction("or_"))
    # As Python's: the first of two that are equal or cannot be compared.
    _define(max, 2, lanes, lanes, lambda context, builder, x, y: builder.select(builder.fcmp_ordered(">", y, x), y, x))
    _define(min, 2, lanes, lanes, lambda context, builder, x, y: builder.select(builder.fcmp_ordered("<", y, x), y, x))


def _define_functions() -> None:
    _define(operator.neg, 1, lanes, lanes, lambda context, builder, x: builder.fneg(x))
    _define(abs, 1, lanes, lanes, _vector_instruction("llvm.fabs"))
    _define(math.sqrt, 1, lanes, lanes, _vector_instruction("llvm.sqrt"))
    for function in math.cos, math.sin, math.exp, math.log1p:
        _define(function, 1, lanes, lanes, _lane_by_lane(function))
    _define(math.atan2, 2, lanes, lanes, _lane_by_lane(math.atan2))

    def is_finite(context: Any, builder: Any, x: Any) -> Any:
        size = _vector_instruction("llvm.fabs")(context, builder, x)
        return builder.fcmp_ordered("<", size, ir.Constant(DOUBLES, [math.inf] * WIDTH))

    _define(math.isfinite, 1, lanes, mask, is_finite)


_define_arithmetic()
_define_functions()


@intrinsic
def _select(typingctx: Any, condition: Any, a: Any, b: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.select(*arguments)

    return lanes(mask, lanes, lanes), codegen


@intrinsic
def _any(typingctx: Any, condition: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        bits = ir.IntType(WIDTH)
        return builder.icmp_unsigned("!=", builder.bitcast(arguments[0], bits), ir.Constant(bits, 0))

    return types.boolean(mask), codegen


@intrinsic
def _floor(typingctx: Any, x: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _vector_instruction("llvm.floor")(context, builder, *arguments)

    return lanes(lanes), codegen


def _numbers(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """The numbers of a vector as an array (n, width)."""
    width = context.get_constant(types.intp, WIDTH if kind.dtype == lanes else 1)
    source, view = make_array(kind)(context, builder, value), make_array(types.Array(NUMBERS, 2, "C"))(context, builder)
    size = context.get_constant(types.intp, 8)
    populate_array(
        view, data=builder.bitcast(source.data, ir.DoubleType().as_pointer()),
        shape=[*cgutils.unpack_tuple(builder, source.shape), width], strides=[builder.mul(size, width), size],
        itemsize=size, meminfo=None,
    )  # fmt: skip
    return view._getvalue()


@infer_global(columns)
class _ColumnsTemplate(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(types.Array(NUMBERS, 2, "C"), *args) if isinstance(args[0], types.Array) else None


@lower_builtin(columns, types.Array)
def _columns(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return _numbers(context, builder, signature.args[0], arguments[0])


@overload(where, jit_options=OPTIONS)
def _where_overload(condition, a, b):
    if condition == mask:
        return lambda condition, a, b: _select(condition, a, b)
    return lambda condition, a, b: a if condition else b


@overload(any_lane, jit_options=OPTIONS)
def _any_lane_overload(condition):
    return (lambda condition: _any(condition)) if condition == mask else lambda condition: condition


@overload(floor, jit_options=OPTIONS)
def _floor_overload(x):
    return (lambda x: _floor(x)) if x == lanes else lambda x: np.floor(x)
