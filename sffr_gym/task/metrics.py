"""Measures of an episode, from the signals of every control period; ``score`` makes the benchmark's cost of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import ceil, nan
from typing import NamedTuple

import numpy as np

from sffr_gym.task.signals import (
    ATTITUDE,
    ERROR,
    FORCE,
    JOINT,
    MOMENT,
    PIEZO,
    SAT_JOINT,
    SAT_PIEZO,
    SAT_THRUST,
    THRUST,
    TIP,
    VIBRATION,
)
from sffr_gym.task.status import LIMIT_CYCLE, REASONS
from sffr_gym.types import Array

SETTLED = 0.05  # of the largest vibration energy
LAST = 0.25  # of an episode, in which it shows whether it is stable
LEAST = 2.0  # s of it, in which a swing would fade or not
BUSY = 0.25  # of a group's channels, on average over that time, that are at their limits

# Each measure with its unit, in the order of tables.
MEASURES = {
    "track_rmse": "m",
    "track_max": "m",
    "attitude_rmse": "rad",
    "vibration": "J",
    "tip_max": "m",
    "settling_time": "s",
    "disturbance_force_rmse": "N",
    "disturbance_moment_rmse": "N m",
    "piezo_effort": "V2 s",
    "thruster_impulse": "N s",
    "joint_effort": "N2 m2 s",
    "piezo_saturation": "1",
    "thruster_saturation": "1",
    "joint_saturation": "1",
    "failed": "1",
    "duration": "s",
}
# Only where the path ends at rest before the episode does: the largest tip displacement from then on, all of which is
# residual vibration, since nothing accelerates any more.
ARRIVAL_MEASURES = {"residual_tip": "m"}


def measured(episodes: Iterable[Mapping[str, float]]) -> dict[str, str]:
    """Return the names of the measures that some episodes have, with their units, in the order of tables."""
    found = set().union(*episodes)
    return MEASURES | {name: unit for name, unit in ARRIVAL_MEASURES.items() if name in found}


class Totals(NamedTuple):
    """What the measures of an episode are made of: its signals, summed up over its control periods."""

    ticks: int  #: control periods
    sums: Array  #: (N_SIGNALS,) of the signals, of their squares, and the largest of each
    squares: Array
    largest: Array
    settled: int  #: control periods from which on the vibration stays below ``SETTLED`` of its maximum


def measure(signals: Array, period: float, failure: str = "", arrival: float | None = None) -> dict[str, float]:
    """Return the measures of one episode, by the names in ``MEASURES``, and in ``ARRIVAL_MEASURES`` if it arrives.

    Args:
        signals: (n_ticks, N_SIGNALS) in the order of ``SIGNALS``.
        period: control period [s].
        failure: why the episode ended early; empty if it did not.
        arrival: time at which the path ends at rest [s]; None if it goes on. What failed before has NaN after it.

    Raises:
        ValueError: for an episode without a single control period.
    """
    if len(signals) == 0:
        raise ValueError("an episode needs at least one control period")
    settled = settling_ticks(signals[:, VIBRATION])
    sums, squares = signals.sum(axis=0), (signals**2).sum(axis=0)
    measures = measures_of(Totals(len(signals), sums, squares, signals.max(axis=0), settled), period, failure)
    if arrival is None:
        return measures
    after = signals[ceil(arrival / period - 1e-9) :, TIP]
    return measures | {"residual_tip": float(after.max()) if len(after) else nan}


def measures_of(totals: Totals, period: float, failure: str) -> dict[str, float]:
    """Return the measures in ``MEASURES`` of an episode that is summed up already; see :func:`measure`."""
    rms, mean = np.sqrt(totals.squares / totals.ticks), totals.sums / totals.ticks
    total, largest = totals.sums * period, totals.largest
    values = (
        rms[ERROR], largest[ERROR], rms[ATTITUDE], mean[VIBRATION], largest[TIP],
        float(totals.settled * period), rms[FORCE], rms[MOMENT],
        total[PIEZO], total[THRUST], total[JOINT], mean[SAT_PIEZO], mean[SAT_THRUST], mean[SAT_JOINT],
        float(bool(failure)), totals.ticks * period,
    )  # fmt: skip
    return {name: float(value) for name, value in zip(MEASURES, values, strict=True)}


def instability(signals: Array, period: float) -> str:
    """Return why an episode was unstable although no state left the model's range; empty if it was not.

    A sampled loop that feeds the panels' vibration makes it grow until actuators give no more, and then holds it there:
    in the last quarter of the episode more than a quarter of a group's channels are at their limits, on average (one of
    three of each panel is enough to do it), and the panels still swing with more than 5 % of their largest energy.
    Where actuators saturate because they are weak the energy falls nevertheless; where panels swing on because nothing
    damps them, none saturates. An episode of less than 8 s is too short to tell.

    Args:
        signals: (n_ticks, N_SIGNALS) of the whole episode.
        period: control period [s].
    """
    last = signals[-last_ticks(len(signals)) :]
    return instability_of(last.mean(axis=0), len(last), signals[:, VIBRATION].max(), period)


def instability_of(mean: Array, ticks: int, largest: float, period: float) -> str:
    """Return why an episode was unstable, empty if it was not; see :func:`instability`.

    Args:
        mean: (N_SIGNALS,) of the signals over its last part.
        ticks: control periods of that part.
        largest: vibration energy of the whole episode [J].
        period: control period [s].
    """
    saturated = mean[[SAT_PIEZO, SAT_THRUST, SAT_JOINT]].max()
    swinging = mean[VIBRATION] > SETTLED * largest
    return REASONS[LIMIT_CYCLE] if saturated > BUSY and swinging and ticks * period >= LEAST else ""


def last_ticks(ticks: int) -> int:
    """Return how many control periods the last part of an episode has, which shows whether it is stable."""
    return max(int(LAST * ticks), 1)


def settling_time(energy: Array, period: float) -> float:
    """Return the time [s] from which an energy (n_ticks,) stays below ``SETTLED`` of its maximum."""
    return float(settling_ticks(energy) * period)


def settling_ticks(energy: Array) -> int:
    """Return the number of control periods from which an energy (n_ticks,) stays below ``SETTLED`` of its maximum."""
    above = np.flatnonzero(energy > SETTLED * energy.max())
    return int(above[-1]) + 1 if len(above) else 0
