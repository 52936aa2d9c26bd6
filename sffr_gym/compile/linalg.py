"""Vectors and small matrices of a fixed size."""

from __future__ import annotations

from math import sqrt

from sffr_gym.compile.kernels import kernel


@kernel
def assign(target, source):
    """Copy a vector (n,) into another; kernels that own no memory cannot use ``target[:] = source``."""
    for k in range(len(source)):
        target[k] = source[k]


@kernel
def length(x, y):
    """Length of a vector in the plane."""
    return sqrt(x * x + y * y)


@kernel
def symmetric_inverse(A, out):
    """Invert a symmetric 3 x 3 matrix given as ``(xx, xy, xz, yy, yz, zz)`` by its adjugate."""
    xx, xy, xz, yy, yz, zz = A
    cxx, cxy, cxz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    det = 1.0 / (xx * cxx + xy * cxy + xz * cxz)
    out[0, 0], out[1, 1], out[2, 2] = cxx * det, (xx * zz - xz * xz) * det, (xx * yy - xy * xy) * det
    out[0, 1] = out[1, 0] = cxy * det
    out[0, 2] = out[2, 0] = cxz * det
    out[1, 2] = out[2, 1] = (xy * xz - xx * yz) * det


@kernel
def times(A, x, y, z):
    """Product of a 3 x 3 matrix and a vector."""
    return (
        A[0, 0] * x + A[0, 1] * y + A[0, 2] * z,
        A[1, 0] * x + A[1, 1] * y + A[1, 2] * z,
        A[2, 0] * x + A[2, 1] * y + A[2, 2] * z,
    )


@kernel
def times_transposed(A, x, y, z):
    """Product of the transpose of a 3 x 3 matrix and a vector."""
    return (
        A[0, 0] * x + A[1, 0] * y + A[2, 0] * z,
        A[0, 1] * x + A[1, 1] * y + A[2, 1] * z,
        A[0, 2] * x + A[1, 2] * y + A[2, 2] * z,
    )
