"""Resident memory over a long run: does anything pile up?"""

from __future__ import annotations

import gc
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import gymnasium as gym
import numpy as np
import psutil

import sffr_gym  # noqa: F401  (registers SFFRFlex-v0)
from sffr_workbench.speed.measure import Row, Section

PERIODS, QUICK_PERIODS = 10_000_000, 20_000
SINGLE_PART = 10  # the single environment runs so many times fewer
NUM_ENVS = 1024
READINGS = 20  # of the resident memory in a run
MIB = 2.0**20


def memory(repeats: int, quick: bool) -> Section:
    """Measure resident memory along a run of the vector and one of the single environment, resets included.

    Each in a process of its own, in which nothing else has been measured.
    """
    periods = QUICK_PERIODS if quick else PERIODS
    rows = []
    for key, what, make, length in (
        ("vector", f"vector environment of {NUM_ENVS}", _vector, periods),
        ("single", "single environment", _single, periods // SINGLE_PART),
    ):
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            readings = pool.submit(_readings, make, length).result()
        note = f"first reading {readings[0]:.1f}, last {readings[-1]:.1f}"
        rows.append(Row(key, f"{what}, {length:,} control periods", "MiB", tuple(readings), note=note))
    return Section("memory", f"Resident memory, {READINGS} readings after each {100 // READINGS} % of a run", rows)


def _readings(make: Callable[[], Callable[[], int]], periods: int) -> list[float]:
    """Measure resident memory [MiB] along ``periods`` control periods, of which a call of what is made makes some."""
    process, readings, done, step = psutil.Process(), [], 0, make()
    for k in range(READINGS):
        while done < periods * (k + 1) // READINGS:
            done += step()
        gc.collect()
        readings.append(process.memory_info().rss / MIB)
    return readings


def _vector() -> Callable[[], int]:
    env = gym.make_vec("SFFRFlex-v0", num_envs=NUM_ENVS)
    env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (NUM_ENVS, 15))

    def step() -> int:
        env.step(actions)
        return NUM_ENVS

    return step


def _single() -> Callable[[], int]:
    env = gym.make("SFFRFlex-v0")
    env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (500, 15)).astype(np.float32)

    def step() -> int:
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()
        return len(actions)

    return step
