"""What disturbs an episode: noise and delay of what is measured, and impulses on the base.

The noise is made of counted random numbers: that of a control period is a function of the episode's key and the period
alone, not of the policy, of environments beside it, of threads, or of what was drawn before.
"""

from __future__ import annotations

from math import cos, log, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from sffr_gym.compile.kernels import kernel
from sffr_gym.physics.actuators import quantise
from sffr_gym.task.observation import clip, observe
from sffr_gym.task.reference import desired
from sffr_gym.types import Array, IntArray

ROUNDS = 10  # of Philox
LOW = np.uint64(0xFFFFFFFF)  # the lower 32 bits
HALF = np.uint64(32)
TO_UNIT = 2.0**-32
KEYS = 2**32
NEVER = -1  # control period of an impulse that does not come


class Sensing(NamedTuple):
    """How what is measured differs from the truth."""

    level: Array  #: (n_o,) standard deviation of the noise on each number of the observation
    key: int  #: of the noise's random numbers, below ``KEYS``; 0 for none
    delay: int  #: 1 if what is measured lags a control period behind, else 0
    quantum: Array  #: (n_o,) step in which each number is given; 0 for any value
    coarse: int  #: 1 if any is given in steps, else 0


class Impulses(NamedTuple):
    """Impulses on the base."""

    tick: IntArray  #: (k,) control periods, counted from 0, over which each acts; negative for none
    impulse: Array  #: (k, 3) time integrals of force and moment along the base axes [N s, N s, N m s]


@kernel
def impulse_wrench(impulses, tick, period, wrench):
    """Write the mean force and moment (3,) of the impulses in control period ``tick`` [N, N, N m], base axes."""
    wrench[0] = wrench[1] = wrench[2] = 0.0
    for k in range(len(impulses.tick)):
        if impulses.tick[k] == tick:
            for j in range(3):
                wrench[j] += impulses.impulse[k, j] / period


@kernel
def sense(task, reference, sensing, tick, p, v, work, obs):
    """Turn the true observation ``obs`` (n_o,) after ``tick`` control periods into what is measured, in place.

    Late first, then noisy, then rounded to what the sensors can tell apart, as a signal goes through a sensor.

    Late sensors show the robot as it was a period ago; what is desired of it now is known.

    task: the plant as a :class:`task_model.TaskModel`; reference: the episode's.
    p, v: (n,) state a control period ago; work: a :class:`dynamics.Work`, overwritten.
    """
    if sensing.delay > 0:
        observe(task, reference, desired(reference, tick * task.period), p, v, work, obs, True)
        clip(task.bound, obs)
    if sensing.key > 0:
        add_noise(sensing, tick, task.bound, obs)
    if sensing.coarse > 0:
        quantise(sensing.quantum, task.bound, obs)


@kernel
def add_noise(sensing, tick, bound, obs):
    """Add the noise of control period ``tick`` to an observation ``obs`` (n_o,), in place and within ``bound`` (n_o,).

    Two normal numbers from two uniform ones (Box and Muller), four of which come from one block of Philox.
    """
    for k in range(0, len(obs), 4):
        a, b, c, d = philox(tick, k // 4, sensing.key)
        _add_pair(sensing.level, bound, a, b, k, obs)
        _add_pair(sensing.level, bound, c, d, k + 2, obs)


@kernel
def philox(tick, block, key):
    """Four random words of 32 bits, of the counter (tick, block, 0, 0) under a key of 32 bits: Philox4x32-10.

    Source: J. K. Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", 2011.
    """
    c0, c1, c2, c3 = np.uint64(tick), np.uint64(block), np.uint64(0), np.uint64(0)
    k0, k1 = np.uint64(key), np.uint64(0)
    for _ in range(ROUNDS):
        first, second = np.uint64(0xD2511F53) * c0, np.uint64(0xCD9E8D57) * c2  # 32 by 32 bits: no overflow
        c0, c1, c2, c3 = (second >> HALF) ^ c1 ^ k0, second & LOW, (first >> HALF) ^ c3 ^ k1, first & LOW
        k0, k1 = (k0 + np.uint64(0x9E3779B9)) & LOW, (k1 + np.uint64(0xBB67AE85)) & LOW
    return c0, c1, c2, c3


@kernel
def _add_pair(level, bound, a, b, k, obs):
    """Add two normal numbers, made of two random words, to ``obs[k]`` and ``obs[k + 1]``, where these exist."""
    size = sqrt(-2.0 * log((float(a) + 0.5) * TO_UNIT))
    angle = 2.0 * pi * (float(b) + 0.5) * TO_UNIT
    if k < len(obs):
        obs[k] = min(max(obs[k] + level[k] * size * cos(angle), -bound[k]), bound[k])
    if k + 1 < len(obs):
        obs[k + 1] = min(max(obs[k + 1] + level[k + 1] * size * sin(angle), -bound[k + 1]), bound[k + 1])
