"""Paths other than the circle: their form, derivatives and start, and that the laws follow them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial.polynomial import polyder, polyval

from sffr_baselines import make_policy
from sffr_baselines.rollout import result_of, rollout
from sffr_gym import ConfigError, load_params
from sffr_gym.config.path import DEGREE, N_PIECE
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.physics.initial import initial_positions
from sffr_gym.physics.model import pack
from sffr_gym.task.metrics import measured
from sffr_gym.task.quasi_static import quasi_static_amplitudes, quasi_static_at
from sffr_gym.task.reference import Desired, _polynomial, desired, path_reference
from sffr_gym.task.scenario import load_scenario
from sffr_gym.task.signals import ERROR, VIBRATION

STILL = "initial.qfd=[0, 0, 0]"
PATHS = {
    "figure-eight": ["path.kind=figure-eight", "path.radius=5"],
    "figure-eight tangent": ["path.kind=figure-eight", "path.radius=5", "path.heading=tangent"],
    "line": ["path.kind=line"],
    "slew": ["path.kind=slew", "path.displacement=[3, -1]"],
    "waypoints": ["path.kind=waypoints"],
    "waypoints tangent": ["path.kind=waypoints", "path.heading=tangent"],
    "circle tangent": ["path.heading=tangent"],
}
RATES = ("base_error_rate", "yaw_error_rate", "tip_error_rate", "object_error_rate", "object_angle_error_rate")
ERRORS = ("base_error", "yaw_error", "tip_error", "object_error", "object_angle_error")


def reference_of(*overrides, phase=0.0):
    """Parameters, and the path from their start."""
    params = load_params().with_overrides(*overrides)
    model = pack(params)
    return params, path_reference(params, model, initial_positions(params, model)[0], phase=phase)


@pytest.mark.parametrize("name", PATHS)
@pytest.mark.parametrize("phase", [0.0, 0.7])
def test_derivatives_are_those_of_the_motion(name, phase):
    """By central differences, of position and heading, up to the third, at times within pieces."""
    params, reference = reference_of(*PATHS[name], phase=phase if "eight" in name or "circle" in name else 0.0)
    h = 1e-3
    for t in np.linspace(0.11, 0.93, 9) * params.path.period:
        before, now, after = (desired(reference, t + shift) for shift in (-h, 0.0, h))
        names = Desired._fields
        for lower, higher in [
            ("x", "xd"), ("xd", "xdd"), ("xdd", "xddd"), ("y", "yd"), ("yd", "ydd"), ("ydd", "yddd"),
            ("heading", "turn"), ("turn", "turn_acceleration"), ("turn_acceleration", "turn_jerk"),
        ]:  # fmt: skip
            slope = (getattr(after, lower) - getattr(before, lower)) / (2.0 * h)
            assert getattr(now, higher) == pytest.approx(slope, rel=2e-5, abs=2e-6), (higher, t, names)


def test_derivatives_of_a_piece_are_those_of_its_polynomial():
    """All four, though no shipped path that turns has a fourth one."""
    coefficients, s = np.random.default_rng(0).normal(size=DEGREE + 1), 0.7
    exact = [polyval(s, polyder(coefficients, k)) for k in range(5)]
    np.testing.assert_allclose(_polynomial(np.append(9.0, coefficients), 1, s), exact, rtol=1e-12)


@pytest.mark.parametrize("kind", ["circle", "figure-eight"])
@pytest.mark.parametrize("phase", [0.0, 0.7, 4.0])
def test_a_closed_path_begins_where_the_object_is_and_comes_back(kind, phase):
    params, reference = reference_of(f"path.kind={kind}", phase=phase)
    model = pack(params)
    place = initial_positions(params, model)[0][model.at.object : model.at.object + 2]
    for t in (0.0, params.path.period):
        now = desired(reference, t)
        np.testing.assert_allclose([now.x, now.y], place, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", PATHS)
def test_a_path_is_begun_without_errors(name):
    """Robot and object move as one with the path: no error, none of its rates, and no joint moves."""
    env = SFFRFlexEnv(overrides=PATHS[name])
    obs, _ = env.reset(seed=0)
    for field in (*ERRORS, *RATES):
        np.testing.assert_allclose(obs[env.fields[field].slice], 0.0, rtol=0, atol=1e-13)
    np.testing.assert_allclose(env.velocities[3:9], 0.0, rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", PATHS)
def test_a_law_that_knows_the_panels_stays_on_the_path(name):
    """Tracking to half a micrometre proves the accelerations that are fed forward, the angular one among them."""
    env = SFFRFlexEnv(load_scenario("nominal").with_changes(duration=6.0), overrides=PATHS[name])
    trajectory = rollout(env, make_policy("ahsc-ff", env), seed=0)
    assert not trajectory.failure and trajectory.signals[:, ERROR].max() < 5e-7


def test_a_figure_eight_is_two_lobes():
    """x = r sin 2a, y = 2 r (1 - cos a), whose middle it crosses twice, and which is closed."""
    params, reference = reference_of("path.kind=figure-eight", "path.radius=5", "path.speed=0.5")
    assert params.path.period == pytest.approx(2.0 * np.pi * 10.0 / 0.5)
    start = desired(reference, 0.0)
    assert (start.xd, start.yd) == pytest.approx((0.5, 0.0))
    for part, place in (0.25, (0.0, 10.0)), (0.5, (0.0, 20.0)), (0.75, (0.0, 10.0)), (1.0, (0.0, 0.0)):
        now = desired(reference, part * params.path.period)
        assert (now.x - start.x, now.y - start.y) == pytest.approx(place, abs=1e-12)
    side = desired(reference, params.path.period / 8.0)
    assert side.x - start.x == pytest.approx(5.0)


@pytest.mark.parametrize("kind", ["line", "slew"])
def test_a_move_begins_and_ends_at_rest(kind):
    """Where and when it should, with nothing left of velocity and acceleration; half way at half time."""
    changes = f"path.kind={kind}", "path.displacement=[3, -1]", "path.turn=0.8", "path.time=9"
    params, reference = reference_of(*changes)
    start, turned = desired(reference, 0.0), 0.8 if kind == "slew" else 0.0
    for t, share in (0.0, 0.0), (4.5, 0.5), (9.0, 1.0), (30.0, 1.0):
        now = desired(reference, t)
        assert (now.x - start.x, now.y - start.y) == pytest.approx((3.0 * share, -share), abs=1e-12)
        assert now.heading == pytest.approx(turned * share, abs=1e-12)
        if share != 0.5:
            motion = now.xd, now.yd, now.xdd, now.ydd, now.turn, now.turn_acceleration
            assert motion == pytest.approx((0.0,) * 6, abs=1e-12)
    fastest = desired(reference, 4.5).xd
    assert fastest == pytest.approx(3.0 / 9.0 * (1.875 if kind == "slew" else 4.0 / 3.0))  # of the quintic, a trapezoid
    assert (params.path.arrival, params.path.period) == (9.0, 18.0)


def test_waypoints_are_passed_smoothly():
    """Each at its chord's time; velocity and acceleration have no jump, and straight on from the last one."""
    points = [[3.0, 1.0], [6.0, -1.0], [9.0, 2.0]]
    params, reference = reference_of(
        "path.kind=waypoints", f"path.points={[list(p) for p in points]}", "path.speed=0.5"
    )
    start, knots = desired(reference, 0.0), params.path.pieces[:, 0]
    chords = np.hypot(*np.diff(np.array([[0.0, 0.0], *points]), axis=0).T)
    np.testing.assert_allclose(knots, np.append(0.0, np.cumsum(chords)) / 0.5, rtol=1e-14)
    for knot, point in zip(knots[1:].tolist(), points, strict=True):
        before, after = desired(reference, knot - 1e-9), desired(reference, knot + 1e-9)
        assert (after.x - start.x, after.y - start.y) == pytest.approx(point, abs=1e-8)
        for each in ("xd", "yd", "xdd", "ydd"):
            assert getattr(after, each) == pytest.approx(getattr(before, each), abs=1e-7)
    ends = desired(reference, 0.0)[4:6] + desired(reference, float(knots[-1]) + 3.0)[4:6]
    assert ends == pytest.approx((0.0,) * 4, abs=1e-12)


def test_a_tangent_heading_follows_the_path():
    """The reference axes turn as the direction of the motion does."""
    for name in "figure-eight tangent", "waypoints tangent":
        params, reference = reference_of(*PATHS[name])
        start = desired(reference, 0.0)
        for t in np.linspace(0.0, params.path.period, 23):
            now = desired(reference, t)
            direction = np.arctan2(now.yd, now.xd) - np.arctan2(start.yd, start.xd)
            assert np.exp(1j * now.heading) == pytest.approx(np.exp(1j * direction), abs=1e-12)


@pytest.mark.parametrize("name", ["slew", "figure-eight tangent"])
def test_the_quasi_static_shape_and_its_rate_are_those_under_the_motion(name):
    """Its rate by central differences; its force on the root, by the panel's own equation with the shape held."""
    params, reference = reference_of(*PATHS[name])
    model, h = pack(params), 1e-3
    times = np.linspace(0.2, 0.45, 5) * params.path.period
    _, rate = quasi_static_amplitudes(model, reference, times)
    before, after = (quasi_static_at(model, reference, times + shift) for shift in (-h, h))
    np.testing.assert_allclose(rate, (after - before) / (2.0 * h), rtol=1e-5, atol=1e-8)
    assert np.abs(rate).max() > 1e-4


def test_panels_that_start_at_rest_on_a_slow_move_hardly_vibrate():
    """A motion of many periods bends the panels quasi-statically: no vibration is left of it, for a turn as well."""
    env = SFFRFlexEnv(
        load_scenario("nominal").with_changes(duration=60.0),
        overrides=["path.kind=slew", "path.time=100", "path.displacement=[4, 2]", "path.turn=1.0", STILL],
    )
    trajectory = rollout(env, make_policy("none", env), seed=0)
    bent = np.abs(trajectory.tips).max()
    assert bent > 5e-3 and trajectory.signals[:, VIBRATION].max() < 1e-4


def test_a_batch_steps_like_the_single_one():
    """In lanes as alone, whatever piece each environment is in."""
    changes = ["path.kind=waypoints", "path.heading=tangent", "path.points=[[0.2, 0.0], [0.4, 0.1]]"]
    batch, alone = SFFRFlexVectorEnv(9, overrides=changes), SFFRFlexEnv(overrides=changes)
    batch.reset(seed=0)
    alone.reset(seed=0)
    actions = 1e-3 * np.random.default_rng(0).uniform(-1.0, 1.0, (240, 15))
    for action in actions:
        together, single = batch.step(np.tile(action, (9, 1)))[0], alone.step(action)[0]
        np.testing.assert_array_equal(together, np.tile(single, (9, 1)))
    assert alone.time > alone.reference.pieces[N_PIECE]


def test_the_tip_after_the_arrival_is_measured():
    """Where a path has one within the episode."""
    env = SFFRFlexEnv(load_scenario("slew").with_changes(duration=25.0))
    trajectory = rollout(env, make_policy("ahsc", env), seed=0)
    found = result_of(trajectory).measures
    assert found["residual_tip"] == np.abs(trajectory.tips[10_000:]).max() > 0.0
    short = SFFRFlexEnv(load_scenario("slew").with_changes(duration=15.0))
    assert "residual_tip" not in result_of(rollout(short, make_policy("ahsc", short), seed=0)).measures
    assert list(measured([found]))[-1] == "residual_tip" and "residual_tip" not in measured([{}])


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        (["path.kind=spiral"], "path.kind = 'spiral': must be 'circle', 'figure-eight', 'line', 'slew' or 'waypoints'"),
        (
            ["path.kind=slew", "path.heading=tangent"],
            "path.heading = 'tangent': must be fixed: a slew begins",
        ),
        (
            ["path.kind=waypoints", "path.points=[[1, 1], [1, 1]]"],
            "path.points.1 = [1.0, 1.0]: must be another",
        ),
        (["path.kind=waypoints", "path.points=[[0, 0]]"], "path.points.0 = [0.0, 0.0]: must be another"),
        (["path.points=[]"], "path.points = []: must have at least 1 entry"),
    ],
)
def test_what_is_no_path_is_refused(changes, reason):
    """With key, value and what is right."""
    with pytest.raises(ConfigError) as error:
        load_params().with_overrides(*changes)
    assert reason in str(error.value)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        (
            ["path.kind=slew", "path.time=0.1"],
            "limits.velocity: bounds the path's motion to 20 [m/s], which",
        ),
        (
            ["path.kind=waypoints", "path.heading=tangent", "path.points=[[4, 0], [0, 0]]"],
            "path.heading = 'tangent': must be fixed on a path that slows down to",
        ),
    ],
)
def test_a_path_that_cannot_be_observed_is_refused(changes, reason):
    """When the environment is made."""
    with pytest.raises(ConfigError) as error:
        SFFRFlexEnv(overrides=changes)
    assert reason in str(error.value)


def test_a_move_has_no_speed_to_draw():
    """A scenario that draws one is refused."""
    with pytest.raises(ConfigError, match=r"speed: a line has path\.time"):
        SFFRFlexEnv("fast", overrides=["path.kind=line"])
