"""What sensors make of the truth: white noise from counted random numbers, so that it depends on nothing but its key.

The numbers of period ``tick`` are a function of the episode's key and ``tick`` alone: not of the policy, of the number
of environments beside, of threads, or of what was drawn before.
"""

from __future__ import annotations

from math import cos, log, pi, sin, sqrt

import numpy as np

from sffr_gym._jit import kernel

ROUNDS = 10
LOW = np.uint64(0xFFFFFFFF)  # the lower 32 bits
HALF = np.uint64(32)
TO_UNIT = 2.0**-32


@kernel(inline=True)
def add_noise(sensing, tick, bound, obs):
    """Add the noise of control period ``tick`` to an observation ``obs`` (n_o,), in place and within ``bound`` (n_o,).

    sensing: an :class:`episode.Sensing`.

    Two normal numbers from two uniform ones (Box and Muller), four of which come from one block of Philox.
    """
    for k in range(0, len(obs), 4):
        a, b, c, d = philox(tick, k // 4, sensing.key)
        _add_pair(sensing.level, bound, a, b, k, obs)
        _add_pair(sensing.level, bound, c, d, k + 2, obs)


@kernel(inline=True)
def philox(tick, block, key):
    """Four random words of 32 bits, of the counter (tick, block, 0, 0) under a key: Philox4x32-10.

    Source: J. K. Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", 2011.
    """
    c0, c1, c2, c3 = np.uint64(tick), np.uint64(block), np.uint64(0), np.uint64(0)
    k0, k1 = np.uint64(key) & LOW, np.uint64(key) >> HALF
    for _ in range(ROUNDS):
        first, second = np.uint64(0xD2511F53) * c0, np.uint64(0xCD9E8D57) * c2  # 32 by 32 bits: no overflow
        c0, c1, c2, c3 = (second >> HALF) ^ c1 ^ k0, second & LOW, (first >> HALF) ^ c3 ^ k1, first & LOW
        k0, k1 = (k0 + np.uint64(0x9E3779B9)) & LOW, (k1 + np.uint64(0xBB67AE85)) & LOW
    return c0, c1, c2, c3


@kernel(inline=True)
def _add_pair(level, bound, a, b, k, obs):
    """Add two normal numbers, made of two random words, to ``obs[k]`` and ``obs[k + 1]``, where these exist."""
    size = sqrt(-2.0 * log((float(a) + 0.5) * TO_UNIT))
    angle = 2.0 * pi * (float(b) + 0.5) * TO_UNIT
    if k < len(obs):
        obs[k] = min(max(obs[k] + level[k] * size * cos(angle), -bound[k]), bound[k])
    if k + 1 < len(obs):
        obs[k + 1] = min(max(obs[k + 1] + level[k + 1] * size * sin(angle), -bound[k + 1]), bound[k + 1])
