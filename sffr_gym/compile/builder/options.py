"""The settings of the compiler, for everything that it compiles.

Strict IEEE arithmetic: no ``fastmath``, so that ``isfinite`` sees NaN and a kernel gives the same bits wherever it is
inlined. Division by zero gives inf, as in NumPy. Kernels never raise, and they own no memory (see
:mod:`sffr_gym.compile.workspace`), so that reference counting is off. Python calls none of what is compiled but through
the library's own interface, so that no wrappers for it are made.
"""

OPTIONS = {
    "error_model": "numpy", "_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "forceinline": True,
}  # fmt: skip
