"""Entries of the tests' own, small enough to be compiled with them, and the library that they make."""

import sys
from concurrent.futures import ProcessPoolExecutor
from math import cos, exp, isfinite, sin, sqrt
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np

from sffr_gym.compile.arguments import Block, Structures
from sffr_gym.compile.kernels import Entry, kernel
from sffr_gym.compile.lanes import WIDTH, any_lane, columns, floor, gather, put, take, where
from sffr_gym.compile.library import Library, own_levels
from sffr_gym.compile.workspace import Interleaved, allocate, workspace

N_RESULTS = 21


class Operands(NamedTuple):
    """Two numbers and what is computed of them."""

    x: Any
    y: Any
    out: Any


class Inner(NamedTuple):
    matrix: Any
    vector: Any


class Outer(NamedTuple):
    first: Any
    inner: Inner
    last: Any


class Robot(NamedTuple):
    """Numbers of each kind, and arrays."""

    gain: float
    count: int
    flag: bool
    vector: Any
    wholes: Any


def operands(lanes):
    shapes = Operands((1,), (1,), (N_RESULTS,))
    return workspace(allocate(shapes, lanes=lanes)[0], shapes)


def links(n, lanes=False):
    """Arrays that lie entry by entry, after a matrix, and the block that holds both."""
    shapes = Inner((2, 2), Interleaved(Outer((n,), Inner((n,), (n,)), (n,))))
    block = allocate(shapes, lanes=lanes)[0]
    return workspace(block, shapes), block


def robot(gain=0.5, count=3, flag=True):
    return Robot(gain, count, flag, np.arange(1.0, 4.0), np.array([5, 7]))


@kernel
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


@Entry
def compute_rows(rows, others, results, work):
    """Compute all rows, in numbers of the kind of the memory."""
    width = columns(work.x).shape[1]
    for i in range(0, len(rows), width):
        gather(rows, i, work.x)
        gather(others, i, work.y)
        compute(work.x, work.y, work.out)
        for lane in range(width):
            take(work.out, lane, results[i + lane])


@Entry
def find(rows, threshold, found, work):
    """Say for each group of rows whether any exceeds the threshold."""
    width = columns(work.x).shape[1]
    for i in range(0, len(rows), width):
        gather(rows, i, work.x)
        found[i // width] = 1.0 if any_lane(work.x[0] > threshold) else 0.0


@Entry
def swap(rows, lane, work, row):
    """Gather rows into lanes, take one out and put in another one; work: with vectors as long as a row."""
    gather(rows, 0, work.out)
    take(work.out, lane, row[0])
    put(row[1], work.out, lane)


@Entry
def fill_links(work):
    """Write the place of each number into it."""
    fields = work.vector
    for k in range(len(fields.first)):
        fields.first[k], fields.inner.matrix[k] = 4 + 4 * k, 5 + 4 * k
        fields.inner.vector[k], fields.last[k] = 6 + 4 * k, 7 + 4 * k


@Entry
def add_up(robots, out):
    """Write a number that shows every field of each robot."""
    for i in range(len(robots)):
        one = robots[i]
        total = one.gain + 10 * one.count + (1000.0 if one.flag else 2000.0)
        for k in range(len(one.vector)):
            total += one.vector[k] * 0.001
        for k in range(len(one.wholes)):
            total += 100000 * one.wholes[k]
        out[i] = total


@Entry
def multiply(matrix, number, whole, flag, flags, out):
    """Multiply a matrix, of any layout, by a number and a whole one, where it is flagged, if it shall be."""
    for i in range(matrix.shape[0]):
        for k in range(matrix.shape[1]):
            out[i, k] = matrix[i, k] * number * whole if flag and flags[k] else -1.0


@Entry
def divide(a, b, out):
    out[0] = a / b


def exemplars():
    """Yield entries, and arguments of each form in which they are compiled."""
    rows, found = np.zeros((WIDTH, 1)), np.zeros(1)
    for lanes in (False, True):
        yield compute_rows, (rows, rows, np.zeros((WIDTH, N_RESULTS)), operands(lanes))
        yield find, (rows, 1.0, found, operands(lanes))
        yield swap, (np.zeros((WIDTH, N_RESULTS)), 0, operands(lanes), np.zeros((2, N_RESULTS)))
        yield fill_links, (links(2, lanes)[0],)
    yield add_up, (Structures([robot()]), found)
    strided, flags, out = np.zeros((4, 6))[::2, ::3], np.zeros(2, dtype=bool), np.zeros((2, 2))
    for matrix in (out, strided):
        yield multiply, (matrix, 1.0, 1, True, flags, out)
    yield divide, (1.0, 1.0, found)


def make_libraries(folder):
    """Return a library for each level of this machine, by level, compiled in a process of its own."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        symbols = pool.submit(_build, folder, own_levels()).result()
    return {level: Library(folder / f"{level}.so", symbols) for level in own_levels()}


def _build(folder, levels):
    from sffr_gym.compile.builder.emission import emit, link
    from sffr_gym.compile.builder.frontend import Frontend, register_kernels

    assert "small_kernels" in sys.modules
    register_kernels()
    frontend = Frontend("small")
    for entry, arguments in exemplars():
        frontend.add(entry, arguments)
    bitcode = frontend.module().as_bitcode()
    for level in levels:
        link([emit(bitcode, level)], folder / f"{level}.so")
    return frontend.symbols


def call(library, entry, *arguments):
    """Call an entry of a library."""
    block = Block(arguments)
    library.function(entry.name, block.form)(block.address)
