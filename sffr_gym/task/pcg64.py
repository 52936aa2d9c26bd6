"""NumPy's PCG64 as a kernel: the numbers that a generator of a seed gives, where there is no NumPy.

The state of a generator is ``STATE`` whole numbers below 2^32, of each number the least significant word first. They
are multiplied word by word, so that nothing overflows.

Source: M. E. O'Neill, "PCG: a family of simple fast space-efficient statistically good algorithms for random number
generation", 2014 (XSL-RR 128/64); whole numbers below a bound by D. Lemire, "Fast random integer generation in an
interval", 2019.
"""

from __future__ import annotations

import numpy as np

from sffr_gym.compile.kernels import kernel
from sffr_gym.types import IntArray

WORDS = 4  # of 32 bits, in a number of 128 bits
INCREMENT, HAS_HALF, HALF_LEFT = WORDS, 2 * WORDS, 2 * WORDS + 1  # places in a state, after the number itself
STATE = HALF_LEFT + 1
MULTIPLIER = tuple(0x2360ED051FC65DA44385DF649FCCF645 >> 32 * k & 0xFFFFFFFF for k in range(WORDS))
LOW = np.uint64(0xFFFFFFFF)
HALF = np.uint64(32)
TO_UNIT = 2.0**-53


def state_of(generator: np.random.Generator) -> IntArray:
    """Return the state (``STATE``,) of a generator over PCG64, from which the kernels go on as it would."""
    known = generator.bit_generator.state
    numbers = [known["state"][name] >> 32 * k & 0xFFFFFFFF for name in ("state", "inc") for k in range(WORDS)]
    return np.array([*numbers, known["has_uint32"], known["uinteger"]], dtype=np.int64)


@kernel
def uniform(state, low, high):
    """Return a number from ``low`` up to ``high``, as ``Generator.uniform``; state: (``STATE``,), advanced."""
    high_word, low_word = _next_words(state)
    word = (high_word << HALF | low_word) >> np.uint64(11)
    return low + (high - low) * (float(word) * TO_UNIT)


@kernel
def below(state, bound):
    """Return a whole number from 0 on below a bound of at most 2^32 - 1, as ``Generator.integers``; see uniform."""
    if bound == 1:
        return 0
    count = np.uint64(bound)
    product = _next_half(state) * count
    if product & LOW < count:
        least = (np.uint64(0x100000000) - count) % count
        while product & LOW < least:
            product = _next_half(state) * count
    return np.int64(product >> HALF)


@kernel
def _next_half(state):
    """Return the next 32 bits: the lower ones of a new number, then its upper ones."""
    if state[HAS_HALF] > 0:
        state[HAS_HALF] = 0
        return np.uint64(state[HALF_LEFT])
    high_word, low_word = _next_words(state)
    state[HAS_HALF], state[HALF_LEFT] = 1, np.int64(high_word)
    return low_word


@kernel
def _next_words(state):
    """Advance the generator, and return the upper and lower 32 bits of its next number."""
    _advance(state)
    a, b, c, d = np.uint64(state[0]), np.uint64(state[1]), np.uint64(state[2]), np.uint64(state[3])
    folded = (b ^ d) << HALF | (a ^ c)
    turn = d >> np.uint64(26)
    rotated = folded >> turn | folded << (np.uint64(64) - turn & np.uint64(63))
    return rotated >> HALF, rotated & LOW


@kernel
def _advance(state):
    """Multiply the number by a constant and add the increment, modulo 2^128."""
    sums_0, sums_1, sums_2, sums_3 = (
        np.uint64(state[INCREMENT]),
        np.uint64(state[INCREMENT + 1]),
        np.uint64(state[INCREMENT + 2]),
        np.uint64(state[INCREMENT + 3]),
    )
    for k in range(WORDS):
        word = np.uint64(state[k])
        for j in range(WORDS - k):
            product = word * np.uint64(MULTIPLIER[j])
            lower, upper = product & LOW, product >> HALF
            if k + j == 0:
                sums_0, sums_1 = sums_0 + lower, sums_1 + upper
            elif k + j == 1:
                sums_1, sums_2 = sums_1 + lower, sums_2 + upper
            elif k + j == 2:
                sums_2, sums_3 = sums_2 + lower, sums_3 + upper
            else:
                sums_3 = sums_3 + lower
    sums_1 = sums_1 + (sums_0 >> HALF)
    sums_2 = sums_2 + (sums_1 >> HALF)
    sums_3 = sums_3 + (sums_2 >> HALF)
    state[0], state[1] = np.int64(sums_0 & LOW), np.int64(sums_1 & LOW)
    state[2], state[3] = np.int64(sums_2 & LOW), np.int64(sums_3 & LOW)
