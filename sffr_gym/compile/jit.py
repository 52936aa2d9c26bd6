"""The two decorators of compiled code, with every numba setting; the module ``cache`` keeps what is compiled."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numba
from numba.extending import register_jitable

from sffr_gym.compile.cache import KernelCache, folder_of


def kernel(function: Callable[..., Any] | None = None, *, nogil: bool = False) -> Any:
    """Compile a function of plain arrays and scalars for Python, cached on disk if its package is one of those hashed.

    Strict IEEE arithmetic: no ``fastmath``, so that ``isfinite`` sees NaN and a kernel gives the same bits wherever it
    is inlined. Division by zero gives inf, as in NumPy. Kernels never raise.

    Kernels own no memory (see :mod:`sffr_gym.compile.workspace`), so numba's reference counting is off, which takes
    longer than their arithmetic: they neither make arrays nor return such that Python could see.

    Args:
        function: the function, when used as a plain decorator.
        nogil: release the interpreter's lock, for threads.
    """
    if function is None:
        return functools.partial(kernel, nogil=nogil)
    compiled: Any = numba.njit(error_model="numpy", _nrt=False, nogil=nogil)(function)
    folder = folder_of(function.__module__)
    if folder is not None and not numba.config.DISABLE_JIT and function.__closure__ is None:
        compiled._cache = KernelCache(function, folder)  # what cache=True would set to numba's own
    return compiled


def inline(function: Callable[..., Any]) -> Callable[..., Any]:
    """Paste a function into the kernels that call it; Python calls it as it is written.

    For all that kernels call, since a call would cost more than its arithmetic, descriptions of memory among it. What
    would let Python call it compiled is not made: that takes as long as to compile all else.
    """
    pasted: Callable[..., Any] = register_jitable(error_model="numpy", forceinline=True, _nrt=False)(function)
    return pasted
