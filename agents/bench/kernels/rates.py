"""How fast the machine adds, multiplies, divides and so on: nanoseconds per operation of small compiled loops."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from math import cos, sqrt
from typing import Any

import numpy as np

from agents.bench.measure import seconds
from sffr_gym._jit import kernel

LENGTH = 256  # of an array, which stays in the first-level cache
PASSES = 20_000


@kernel
def multiply_add(x, a, b, passes):
    """Two operations on each of many independent numbers: what the machine can do at best."""
    for _ in range(passes):
        for i in range(len(x)):
            x[i] = x[i] * a + b


@kernel
def multiply_add_chain(x, a, b, passes):
    """Two operations on one number, each of which waits for the one before."""
    y = x[0]
    for _ in range(passes):
        for _ in range(len(x)):
            y = y * a + b
    x[0] = y


@kernel
def divide(x, a, b, passes):
    """One division of each of many numbers."""
    for _ in range(passes):
        for i in range(len(x)):
            x[i] = a / x[i]


@kernel
def square_root(x, a, b, passes):
    """One square root of each of many numbers."""
    for _ in range(passes):
        for i in range(len(x)):
            x[i] = sqrt(x[i])


@kernel
def cosine(x, a, b, passes):
    """One cosine of each of many numbers."""
    for _ in range(passes):
        for i in range(len(x)):
            x[i] = cos(x[i])


def operation_times(passes: int = PASSES) -> dict[str, float]:
    """Nanoseconds of each operation: ``multiply_add``, ``chain``, ``divide``, ``sqrt``, ``cos``."""
    loops: Mapping[str, tuple[Callable[..., Any], int]] = {
        "multiply_add": (multiply_add, 2), "chain": (multiply_add_chain, 2),
        "divide": (divide, 1), "sqrt": (square_root, 1), "cos": (cosine, 1),
    }  # fmt: skip
    times = {}
    for name, (loop, operations) in loops.items():
        x = np.linspace(1.0, 2.0, LENGTH)
        loop(x, 0.999, 0.001, 1)
        elapsed = seconds(partial(loop, x, 0.999, 0.001, passes))
        times[name] = 1e9 * elapsed / (passes * LENGTH * operations)
    return times
