"""How fast the machine adds, multiplies, divides and so on: nanoseconds per operation of small compiled loops."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sffr_gym.compile.kernels import Entry
from sffr_workbench.speed.kernels.loops import cosine, divide, multiply_add, multiply_add_chain, square_root
from sffr_workbench.speed.measure import seconds

LENGTH = 256  # of an array, which stays in the first-level cache
PASSES = 20_000


def operation_times(passes: int = PASSES) -> dict[str, float]:
    """Measure nanoseconds of each operation: ``multiply_add``, ``chain``, ``divide``, ``sqrt``, ``cos``."""
    loops: Mapping[str, tuple[Entry, int]] = {
        "multiply_add": (multiply_add, 2), "chain": (multiply_add_chain, 2),
        "divide": (divide, 1), "sqrt": (square_root, 1), "cos": (cosine, 1),
    }  # fmt: skip
    times = {}
    for name, (loop, operations) in loops.items():
        x = np.linspace(1.0, 2.0, LENGTH)
        loop(x, 0.999, 0.001, 1)
        elapsed = seconds(loop.bind(x, 0.999, 0.001, passes))
        times[name] = 1e9 * elapsed / (passes * LENGTH * operations)
    return times
