"""Arrays that kernels take one after the other out of a single block, which costs as much as allocating one array."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import config
from numba.core import cgutils, types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from sffr_gym._jit import kernel
from sffr_gym.beam import Array
from sffr_gym.model import IntArray


class Tape(NamedTuple):
    """A block of numbers and the place from which the next ones are taken; what is taken lives as long as the block."""

    data: Array
    at: IntArray  # (1,)


@kernel(allocates=True)
def make_tape(size):
    """Allocate a tape of zeros; one of size 0 measures how much is taken, and may be neither read nor written."""
    return Tape(np.zeros(size), np.zeros(1, dtype=np.int64))


@kernel(inline=True, allocates=True)
def number(tape):
    """Take the next number."""
    at = tape.at[0]
    tape.at[0] = at + 1
    return tape.data[at]


@kernel(inline=True, allocates=True)
def vector(tape, n):
    """Take the next ``n`` numbers."""
    at = tape.at[0]
    tape.at[0] = at + n
    return _borrow(tape.data, at, (n,))


@kernel(inline=True, allocates=True)
def matrix(tape, n, m):
    """Take the next ``n m`` numbers."""
    at = tape.at[0]
    tape.at[0] = at + n * m
    return _borrow(tape.data, at, (n, m))


@kernel(inline=True, allocates=True)
def tensor(tape, n, m, k):
    """Take the next ``n m k`` numbers."""
    at = tape.at[0]
    tape.at[0] = at + n * m * k
    return _borrow(tape.data, at, (n, m, k))


if config.DISABLE_JIT:

    def _borrow(data: Any, at: Any, shape: Any) -> Any:
        return data[at : at + int(np.prod(shape))].reshape(shape)

else:

    @intrinsic
    def _borrow(typingctx: Any, data: Any, at: Any, shape: Any) -> Any:
        """An array of a shape over ``data`` (1-D, contiguous) from an index on, without a share in its ownership."""
        result = types.Array(data.dtype, len(shape), "C")

        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            source = make_array(data)(context, builder, arguments[0])
            dims = cgutils.unpack_tuple(builder, arguments[2])
            size = context.get_abi_sizeof(context.get_data_type(data.dtype))
            strides: list[Any] = []
            step = context.get_constant(types.intp, size)
            for dim in reversed(dims):
                strides.insert(0, step)
                step = builder.mul(step, dim)
            array = make_array(result)(context, builder)
            populate_array(
                array, data=builder.gep(source.data, [arguments[1]]), shape=dims, strides=strides,
                itemsize=context.get_constant(types.intp, size), meminfo=None,
            )  # fmt: skip
            return array._getvalue()

        return result(data, at, shape), codegen
