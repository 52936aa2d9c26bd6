"""The one ``kernel`` decorator: every numba setting of the project; the module ``cache`` keeps what it compiles."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numba
from numba.extending import register_jitable

from sffr_gym.compile.cache import KernelCache, folder_of


def kernel(function: Callable[..., Any] | None = None, *, inline: bool = False, nogil: bool = False) -> Any:
    """Compile a function of plain arrays and scalars, cached on disk if its package is one of those hashed.

    Strict IEEE arithmetic: no ``fastmath``, so that ``isfinite`` sees NaN and a kernel gives the same bits wherever it
    is inlined. Division by zero gives inf, as in NumPy. Kernels never raise.

    Kernels own no memory (see :mod:`sffr_gym.compile.workspace`), so numba's reference counting is off, which takes
    longer than their arithmetic: they neither make arrays nor return such that Python could see.

    Args:
        function: the function, when used as a plain decorator.
        inline: paste it into its callers; for the inner ones, whose calls would cost more than their arithmetic.
        nogil: release the interpreter's lock, for threads.
    """
    if function is None:
        return functools.partial(kernel, inline=inline, nogil=nogil)
    compiled: Any = numba.njit(error_model="numpy", forceinline=inline, _nrt=False, nogil=nogil)(function)
    folder = folder_of(function.__module__)
    if folder is not None and not numba.config.DISABLE_JIT and function.__closure__ is None:
        compiled._cache = KernelCache(function, folder)  # what cache=True would set to numba's own
    return compiled


def inline(function: Callable[..., Any]) -> Callable[..., Any]:
    """Paste a function into the kernels that call it; Python calls it as it is written.

    For functions that return descriptions or arrays: a compiled kernel must not hand arrays to Python, see above.
    """
    pasted: Callable[..., Any] = register_jitable(forceinline=True, _nrt=False)(function)
    return pasted
