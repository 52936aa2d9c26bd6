"""Measures of an episode on signals whose answers are known."""

import math

import numpy as np
import pytest

from sffr_gym.task.metrics import MEASURES, SETTLED, measure, measured, settling_time
from sffr_gym.task.signals import N_SIGNALS, SIGNALS

PERIOD = 0.5  # s


def signals(**columns: list[float]) -> np.ndarray:
    """Return signals of as many periods as the columns have entries; those not given are zero."""
    count = len(next(iter(columns.values())))
    table = np.zeros((count, N_SIGNALS))
    for name, values in columns.items():
        table[:, SIGNALS.index(name)] = values
    return table


# Each signal's column, and every measure that it alone moves away from zero, with its value.
KNOWN = {
    "object_error": ([3.0, 0.0, 0.0, 4.0], {"track_rmse": 2.5, "track_max": 4.0}),
    "attitude_error": ([0.1, 0.1, 0.7, 0.7], {"attitude_rmse": 0.5}),
    "vibration": ([1.0, 2.0, 4.0, 0.1], {"vibration": 1.775, "settling_time": 1.5}),
    "tip": ([0.1, 0.3, 0.2, 0.0], {"tip_max": 0.3}),
    "force_deviation": ([1.0, 7.0, 5.0, 5.0], {"disturbance_force_rmse": 5.0}),
    "moment_deviation": ([2.0, 14.0, 10.0, 10.0], {"disturbance_moment_rmse": 10.0}),
    "piezo_square": ([1.0, 2.0, 3.0, 4.0], {"piezo_effort": 5.0}),
    "thrust": ([8.0, 0.0, 0.0, 1.0], {"thruster_impulse": 4.5}),
    "joint_square": ([0.2, 0.2, 0.2, 0.2], {"joint_effort": 0.4}),
    "piezo_saturated": ([1.0, 0.0, 0.5, 0.0], {"piezo_saturation": 0.375}),
    "thruster_saturated": ([0.0, 1.0, 0.0, 0.0], {"thruster_saturation": 0.25}),
    "joint_saturated": ([1.0, 1.0, 1.0, 0.0], {"joint_saturation": 0.75}),
}


@pytest.mark.parametrize("signal", SIGNALS)
def test_each_signal_moves_its_own_measures(signal: str) -> None:
    """Root mean squares, means, maxima and integrals by hand; every other measure stays at zero."""
    column, expected = KNOWN[signal]
    found = measure(signals(**{signal: column}), PERIOD)
    assert {name: value for name, value in found.items() if value != 0.0} == pytest.approx(expected | {"duration": 2.0})


def test_all_measures_are_plain_numbers_in_the_order_of_the_table() -> None:
    """For JSON and for tables."""
    found = measure(signals(**{name: column for name, (column, _) in KNOWN.items()}), PERIOD)
    assert list(found) == list(MEASURES)
    assert all(type(value) is float for value in found.values())
    expected = {"failed": 0.0, "duration": 2.0}
    for _, values in KNOWN.values():
        expected |= values
    assert found == pytest.approx(expected)


@pytest.mark.parametrize(("failure", "expected"), [("", 0.0), ("lost grasp", 1.0)])
def test_failure_counts_as_one(failure: str, expected: float) -> None:
    """A reason marks the episode; its measures are those of the time it lasted."""
    found = measure(signals(tip=[0.5]), PERIOD, failure)
    assert (found["failed"], found["duration"], found["tip_max"]) == (expected, 0.5, 0.5)


def test_an_episode_without_a_period_is_rejected() -> None:
    """There is nothing to take the mean of."""
    with pytest.raises(ValueError, match="at least one control period"):
        measure(np.zeros((0, N_SIGNALS)), PERIOD)


@pytest.mark.parametrize(
    ("energy", "expected"),
    [
        ([1.0, 0.04, 0.04, 0.04], 0.5),  # at once
        ([1.0, 0.04, 0.06, 0.04], 1.5),  # a return above the bound counts
        ([1.0, 0.04, 0.04, 0.06], 2.0),  # at the very end: never settled
        ([1.0, 1.0, 1.0, 1.0], 2.0),  # never
        ([0.0, 0.0, 0.0], 0.0),  # nothing to settle
        ([0.01, 1.0, 0.05, 0.0], 1.0),  # the largest comes later; the bound itself counts as below
        ([3.0], 0.5),
    ],
)
def test_settling_time(energy: list[float], expected: float) -> None:
    """The last time at which the energy exceeds 5 % of its largest value."""
    assert SETTLED == 0.05
    assert settling_time(np.array(energy), PERIOD) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("arrival", "expected"),
    [
        (0.0, 0.7),  # the whole episode
        (1.0, 0.4),  # from the third period on: the first two end at or before the arrival
        (1.1, 0.2),  # in the middle of a period, which does not count
        (1.5 + 1e-10, 0.2),  # rounded, it is no later
        (2.0, math.nan),  # the episode ended before
    ],
)
def test_residual_swing_is_what_is_left_from_the_arrival_on(arrival: float, expected: float) -> None:
    """Beside all other measures, of which there is one more."""
    table = signals(tip=[0.7, 0.3, 0.4, 0.2])
    found = measure(table, PERIOD, arrival=arrival)
    assert found == pytest.approx(measure(table, PERIOD) | {"residual_tip": expected}, nan_ok=True)
    assert measured([{}, found]) == MEASURES | {"residual_tip": "m"}
