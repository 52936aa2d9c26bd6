"""Measures of an episode, from the signals of every control period; ``score`` makes the benchmark's cost of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import ceil, nan

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
    rms = np.sqrt(np.mean(signals**2, axis=0))
    mean, total, largest = signals.mean(axis=0), signals.sum(axis=0) * period, signals.max(axis=0)
    values = (
        rms[ERROR], largest[ERROR], rms[ATTITUDE], mean[VIBRATION], largest[TIP],
        settling_time(signals[:, VIBRATION], period), rms[FORCE], rms[MOMENT],
        total[PIEZO], total[THRUST], total[JOINT], mean[SAT_PIEZO], mean[SAT_THRUST], mean[SAT_JOINT],
        float(bool(failure)), len(signals) * period,
    )  # fmt: skip
    measures = {name: float(value) for name, value in zip(MEASURES, values, strict=True)}
    if arrival is None:
        return measures
    after = signals[ceil(arrival / period - 1e-9) :, TIP]
    return measures | {"residual_tip": float(after.max()) if len(after) else nan}


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
    last = signals[-max(int(LAST * len(signals)), 1) :]
    saturated = last[:, [SAT_PIEZO, SAT_THRUST, SAT_JOINT]].mean(axis=0).max()
    swinging = last[:, VIBRATION].mean() > SETTLED * signals[:, VIBRATION].max()
    return REASONS[LIMIT_CYCLE] if saturated > BUSY and swinging and len(last) * period >= LEAST else ""


def settling_time(energy: Array, period: float) -> float:
    """Return the time [s] from which an energy (n_ticks,) stays below ``SETTLED`` of its maximum."""
    above = np.flatnonzero(energy > SETTLED * energy.max())
    return float((above[-1] + 1) * period) if len(above) else 0.0
