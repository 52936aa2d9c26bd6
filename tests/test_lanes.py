"""Numbers in lanes: each lane computes what a plain number computes, bit for bit."""

from math import cos, exp, isfinite, sin, sqrt
from typing import NamedTuple

import numpy as np
import pytest

from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.lanes import WIDTH, any_lane, columns, floor, gather, take, where
from sffr_gym.compile.workspace import allocate, workspace
from sffr_gym.types import Array

SPECIAL = (0.0, -0.0, 1.0, -1.5, 1e300, -1e-300, 5e-324, np.inf, -np.inf, np.nan)


@kernel(inline=True)
def compute(x, y, out):
    """Every operation of lanes; ``x, y`` (1,), ``out`` (21,)."""
    a, b = x[0], y[0]
    out[0], out[1], out[2], out[3] = a + b, a - b, a * b, a / b
    out[4], out[5], out[6], out[7] = -a, abs(a), sqrt(a), floor(a)
    out[8], out[9], out[10] = cos(a), sin(a), exp(a)
    out[11], out[12] = min(a, b), max(a, b)
    out[13], out[14] = where(a < b, a, b), where((a >= b) | (a == 2.0), 1.0, b)
    out[15], out[16] = where(isfinite(a) & (a != b), a, 3), where(a <= b, 2.0 * a, 1 - b)
    total = 0.0
    for _ in range(3):
        total += a
        total *= b
        total -= 0.5
        total /= 3
    out[17], out[18] = total, where(a > b, 1.0, 0.0)
    out[19], out[20] = max(a, 0.5), min(2.0, b)


class Operands(NamedTuple):
    """Two numbers and what is computed of them."""

    x: Array
    y: Array
    out: Array


def operand_shapes():
    return Operands((1,), (1,), (21,))


@kernel
def run(rows, others, results, block):
    """Compute all rows, in numbers of the kind of the block."""
    work = workspace(block, operand_shapes())
    width = columns(work.x).shape[1]
    for i in range(0, len(rows), width):
        gather(rows, i, work.x)
        gather(others, i, work.y)
        compute(work.x, work.y, work.out)
        for lane in range(width):
            take(work.out, lane, results[i + lane])


@pytest.fixture(scope="module")
def pairs():
    """All pairs of special numbers, and random ones of all sizes; a multiple of the width."""
    rng = np.random.default_rng(0)
    special = [(a, b) for a in SPECIAL for b in SPECIAL]
    numbers = rng.normal(size=(900, 2)) * 10.0 ** rng.uniform(-8, 8, (900, 2))
    both = np.concatenate([special, numbers])
    return both[: len(both) // WIDTH * WIDTH]


def test_each_lane_has_the_bits_of_a_plain_number(pairs):
    """Arithmetic, comparisons, choice and functions, with zeros of both signs, infinities and what is not a number."""
    rows, others = pairs[:, :1].copy(), pairs[:, 1:].copy()
    plain, lanes = np.zeros((len(rows), 21)), np.zeros((len(rows), 21))
    with np.errstate(all="ignore"):
        run(rows, others, plain, allocate(operand_shapes())[0])
        run(rows, others, lanes, allocate(operand_shapes(), lanes=True)[0])
    assert (np.isnan(plain) == np.isnan(lanes)).all()
    there = ~np.isnan(plain)
    np.testing.assert_array_equal(plain[there].view(np.int64), lanes[there].view(np.int64))
    assert np.ptp(plain[there]) > 0.0


@kernel
def find(rows, threshold, found, block):
    """Say for each group of rows whether any exceeds the threshold."""
    work = workspace(block, operand_shapes())
    width = columns(work.x).shape[1]
    for i in range(0, len(rows), width):
        gather(rows, i, work.x)
        found[i // width] = 1.0 if any_lane(work.x[0] > threshold) else 0.0


def test_any_lane_sees_each_lane():
    """A condition that holds in one lane alone is seen, whichever it is, and one that holds in none is not."""
    rows = np.zeros((WIDTH * (WIDTH + 1), 1))
    for lane in range(WIDTH):
        rows[lane * WIDTH + lane] = 2.0
    found = np.full(WIDTH + 1, np.nan)
    find(rows, 1.0, found, allocate(operand_shapes(), lanes=True)[0])
    assert list(found) == [1.0] * WIDTH + [0.0]
