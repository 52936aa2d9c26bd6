"""Numbers in lanes: a kernel that is written for one environment steps ``WIDTH`` of them at once.

A lane array holds a vector register of as many numbers in place of each, one for each environment. Kernels are written
for plain numbers; for arrays of lanes they are compiled a second time, with the same operations in the same order, so
that every lane is bitwise identical to a run with plain numbers. What differs is choice: a lane cannot take a branch by
itself, hence :func:`where` and :func:`any_lane` in place of ``if`` on a number that differs between environments.

Only compiled kernels know lanes. As Python, a kernel runs for a single environment.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sffr_gym.compile.kernels import kernel

WIDTH = 8  # of AVX-512; narrower machines take two or four instructions for one
ALIGNMENT = 64  # bytes


def where(condition: Any, a: Any, b: Any) -> Any:
    """``a`` where the condition holds, else ``b``; both are computed."""
    return a if condition else b


def any_lane(condition: Any) -> bool:
    """Whether a condition holds for any lane."""
    return bool(condition)


def floor(x: Any) -> Any:
    """Largest whole number that is not above ``x``, as a float."""
    return np.floor(x)


def columns(array: Any) -> Any:
    """A vector (n,) as its numbers (n, 1); in lanes as (n, WIDTH), a column for each."""
    return array.reshape(-1, 1)


@kernel
def gather(rows, i, target):
    """Copy row ``i`` of (n, k) into a vector (k,), or as many rows from ``i`` on as it has lanes, one into each."""
    numbers = columns(target)
    for lane in range(numbers.shape[1]):
        for k in range(len(numbers)):
            numbers[k, lane] = rows[i + lane, k]


@kernel
def take(source, lane, row):
    """Copy a lane of a vector (k,) into a row (k,)."""
    numbers = columns(source)
    for k in range(len(row)):
        row[k] = numbers[k, lane]


@kernel
def put(row, target, lane):
    """Copy a row (k,) into a lane of a vector (k,)."""
    numbers = columns(target)
    for k in range(len(row)):
        numbers[k, lane] = row[k]
