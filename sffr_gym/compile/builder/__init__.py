"""Compiles the kernels into a library, when the package is built; needs numba, which nothing needs at run time."""
