"""The desired motion: derivatives against differences, the circle's geometry and the formation."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from sffr_gym import load_params
from sffr_gym.config.params import Params
from sffr_gym.physics.initial import initial_positions
from sffr_gym.physics.model import object_slice, pack
from sffr_gym.task.reference import N_PIECE, Desired, Reference, desired, flat_reference, path_reference, reference_at

Array = NDArray[np.float64]

TABLE_IV_OBJECT = [1.4208867, -0.0373103, 0.0759733]
RADIUS, SPEED = 15.0, 0.85


def make(*overrides: str, speed: float | None = None, phase: float = 0.0) -> tuple[Params, Array, Reference]:
    """Return parameters, the start and its reference."""
    params = load_params().with_overrides(*overrides)
    model = pack(params)
    p, _ = initial_positions(params, model)
    return params, p, path_reference(params, model, p, speed=speed, phase=phase)


def position(reference: Reference) -> Callable[[float], Array]:
    """Return the position as a function of time."""

    def at(t: float) -> Array:
        want = desired(reference, t)
        return np.array([want.x, want.y])

    return at


def velocity(want: Desired) -> Array:
    """Return the velocity as a vector."""
    return np.array([want.xd, want.yd])


@pytest.fixture(params=[(0.0, None), (2.3, None), (-1.1, 1.2)], ids=["start", "phase", "phase and speed"])
def reference(request: pytest.FixtureRequest) -> Reference:
    """Return circles from several places and at several speeds."""
    phase, speed = request.param
    return make(speed=speed, phase=phase)[2]


@pytest.mark.parametrize("t", [0.0, 7.7, 64.0])
def test_velocity_and_acceleration_are_the_derivatives_of_the_position(reference: Reference, t: float) -> None:
    """By differences over 1 ms, whose truncation is 1e-9."""
    x, h = position(reference), 1e-3
    want = desired(reference, t)
    np.testing.assert_allclose(velocity(want), (x(t + h) - x(t - h)) / (2 * h), rtol=0, atol=1e-8)
    after, before = velocity(desired(reference, t + h)), velocity(desired(reference, t - h))
    np.testing.assert_allclose([want.xdd, want.ydd], (after - before) / (2 * h), rtol=0, atol=1e-8)


def test_path_is_a_circle_to_the_left(reference: Reference) -> None:
    """Radius and speed as configured, the acceleration towards a fixed centre on the left of the velocity."""
    speed = reference.rate * RADIUS
    centres = []
    for t in np.linspace(0.0, 100.0, 11):
        want = desired(reference, t)
        x, xd, xdd = np.array([want.x, want.y]), velocity(want), np.array([want.xdd, want.ydd])
        assert np.hypot(*xd) == pytest.approx(speed, rel=1e-13)
        left = np.array([-xd[1], xd[0]]) / speed
        np.testing.assert_allclose(xdd, left * speed**2 / RADIUS, rtol=0, atol=1e-14)
        centres.append(x + RADIUS * left)
    np.testing.assert_allclose(centres, np.tile(centres[0], (11, 1)), rtol=0, atol=1e-12)


def test_path_leaves_from_the_object_along_x() -> None:
    """At phase 0 the start is the object's pose, at the configured speed along +x, and once around takes 110.9 s."""
    params, p, reference = make()
    assert path_reference(params, pack(params), p).phase == 0.0
    want = desired(reference, 0.0)
    np.testing.assert_allclose([want.x, want.y], TABLE_IV_OBJECT[:2], rtol=0, atol=1e-6)
    np.testing.assert_array_equal([want.x, want.y], p[object_slice(pack(params))][:2])
    np.testing.assert_allclose(velocity(want), [SPEED, 0.0], rtol=0, atol=1e-15)
    assert params.path.period == pytest.approx(110.88, abs=0.005)
    top = desired(reference, params.path.period / 2)
    np.testing.assert_allclose([top.x - want.x, top.y - want.y], [0.0, 2 * RADIUS], rtol=0, atol=1e-12)
    end = desired(reference, params.path.period)
    np.testing.assert_allclose([end.x, end.y, *velocity(end)], [want.x, want.y, *velocity(want)], rtol=0, atol=1e-12)


def test_phase_and_speed_can_differ_from_the_configured_ones() -> None:
    """A phase turns the direction of departure and its acceleration, not the place; a speed replaces the path's."""
    _, p, reference = make(phase=np.pi / 2, speed=1.2)
    want = desired(reference, 0.0)
    np.testing.assert_allclose([want.x, want.y], p[-3:-1], rtol=0, atol=1e-14)
    np.testing.assert_allclose(velocity(want), [0.0, 1.2], rtol=0, atol=1e-15)
    np.testing.assert_allclose([want.xdd, want.ydd], [-(1.2**2) / RADIUS, 0.0], rtol=0, atol=1e-15)


@pytest.mark.parametrize("phase", [0.0, 1.3])
def test_heading_is_fixed_or_turns_with_the_path(phase: float) -> None:
    """Fixed: never turns. Tangent: by the angle that the velocity has turned since the start, at the path's rate."""
    _, _, fixed = make(phase=phase)
    _, _, tangent = make("path.heading=tangent", phase=phase)
    start = desired(tangent, 0.0)
    assert start.heading == 0.0
    for t in (0.0, 3.0, 50.0):
        assert (desired(fixed, t).heading, desired(fixed, t).turn) == (0.0, 0.0)
        want = desired(tangent, t)
        a, b = velocity(start), velocity(want)
        turned = np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b)
        assert want.heading == pytest.approx(turned, abs=1e-12)
        assert want.turn == pytest.approx(SPEED / RADIUS, rel=1e-13)


def test_formation_is_that_of_the_start() -> None:
    """Base relative to the object, both orientations, and the joint angles to hold."""
    _, p, reference = make()
    np.testing.assert_allclose([reference.base_x, reference.base_y], [-1.4208867, 0.0373103], rtol=0, atol=1e-6)
    assert reference.yaw == 0.0
    assert reference.phi == pytest.approx(TABLE_IV_OBJECT[2], abs=1e-6)
    np.testing.assert_array_equal(reference.joints, p[3:9])
    p[4] += 1.0
    assert reference.joints[1] != p[4]  # a copy


def test_without_an_object_the_base_follows_the_path() -> None:
    """From its own place and with its own yaw, no offset."""
    _, _, reference = make("object=null", "initial.q=[2, -1, 0.3, 0.6, 4.2, 5.6, 2.1, 0.4, 0.1]")
    want = desired(reference, 0.0)
    np.testing.assert_allclose([want.x, want.y], [2.0, -1.0], rtol=0, atol=1e-14)
    assert (reference.base_x, reference.base_y, reference.yaw) == (0.0, 0.0, 0.3)


WAYPOINTS = ("path.kind=waypoints", "path.points=[[1.0, 0.5], [2.0, -0.5], [3.5, 0.0]]", "path.speed=0.3")


def test_flat_numbers_are_the_reference() -> None:
    """Whatever each of them is, and however many joints and pieces there are."""
    for overrides in ((), ("path.kind=figure-eight", "path.heading=tangent"), WAYPOINTS):
        reference = make(*overrides, phase=0.0)[2]
        numbered = reference_at(np.arange(1.0, 1.0 + len(flat_reference(reference))), len(reference.joints))
        np.testing.assert_array_equal(flat_reference(numbered), np.arange(1.0, 1.0 + len(flat_reference(numbered))))
        again = reference_at(flat_reference(reference), len(reference.joints))
        for before, after in zip(reference, again, strict=True):
            np.testing.assert_array_equal(after, before)


def test_a_piece_begins_at_its_time() -> None:
    """At the very time at which one piece ends and the next begins the motion is that just before."""
    reference = make(*WAYPOINTS)[2]
    knots = reference.pieces[::N_PIECE]
    assert len(knots) > 2
    for t in knots[1:]:
        np.testing.assert_allclose(desired(reference, t)[:6], desired(reference, t - 1e-9)[:6], rtol=0, atol=1e-6)
        assert np.hypot(*velocity(desired(reference, t))) > 0.1 or t == knots[-1]
