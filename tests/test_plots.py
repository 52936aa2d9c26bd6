"""What pictures are made of: the trace, the axes and their units, the path's points."""

import numpy as np
import pytest

from sffr_gym.envs.single import SFFRFlexEnv

pytest.importorskip("PIL")
from sffr_gym.render.geometry import path_points
from sffr_gym.render.plots import Axis, linear, logarithmic, with_unit
from sffr_gym.render.renderer import SWING
from sffr_gym.render.trace import Trace
from sffr_gym.task.reference import desired


def test_trace_keeps_the_last_seconds():
    trace = Trace(period=0.002, n_panels=2)
    for tick in range(0, 15_000):
        if trace.is_due(tick):
            trace.append((0.002 * tick, 1.0, 2.0, 3.0, 4.0))
    rows = trace.rows_at(0.002 * tick)
    np.testing.assert_allclose(np.diff(rows[:, 0]), Trace.EVERY)
    assert rows[0, 0] == pytest.approx(10.0) and rows[-1, 0] == pytest.approx(29.95)
    earlier = rows[rows[:, 0] < 29.001]
    np.testing.assert_array_equal(trace.rows_at(29.0)[-len(earlier) :], earlier)
    assert Trace.SPAN >= SWING
    trace.clear()
    assert trace.rows().shape == (0, 5)


def test_axes_hold_their_values_in_round_numbers():
    assert linear(np.array([0.0, 0.31])) == Axis(0.0, 0.5)
    assert linear(np.array([-0.31, 0.1]), signed=True) == Axis(-0.5, 0.5)
    assert linear(np.array([np.nan, 0.0])) == Axis(0.0, 1.0)
    assert linear(np.zeros(0), signed=True) == Axis(-1.0, 1.0)
    low, high, log = logarithmic(np.array([3e-6, 2e-5]))
    assert log and (low, high) == pytest.approx((1e-6, 1e-4))
    low, high, _ = logarithmic(np.array([1e-12, 1e-3, np.nan]))
    assert (low, high) == pytest.approx((1e-6, 1e-3))
    assert logarithmic(np.zeros(3)).high > 0.0


@pytest.mark.parametrize("heading", ["fixed", "tangent"])
def test_drawn_path_is_the_desired_motion(heading):
    env = SFFRFlexEnv(overrides=[f"path.heading={heading}"])
    env.reset(seed=0)
    t = np.linspace(0.0, 2.0 * np.pi / env.reference.rate, 25)
    places = [desired(env.reference, each)[:2] for each in t]
    points = path_points(env.reference, t)
    np.testing.assert_allclose(points, places, rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.ptp(points, axis=0), 30.0, rtol=0, atol=0.3)


@pytest.mark.parametrize(
    "value,text",
    [(0.0, "0 V"), (0.31, "310 mV"), (-12.0, "-12 V"), (3.1234e-6, "3.12 uV"), (1e-6, "1 uV"), (0.0100, "10 mV")],
)
def test_numbers_have_units(value, text):
    assert with_unit(value, "V") == ("0" if value == 0.0 else text)
