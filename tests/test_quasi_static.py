"""The panels' quasi-static shape: static equilibrium under the reference's acceleration, and the rate of it."""

import numpy as np
import pytest

from sffr_gym.config.params import Params
from sffr_gym.physics.beam import shape_functions
from sffr_gym.physics.each_panel import panel_beams
from sffr_gym.physics.initial import initial_positions
from sffr_gym.physics.kinematics import perpendicular, rotation
from sffr_gym.physics.model import pack
from sffr_gym.task.quasi_static import quasi_static_amplitudes, quasi_static_at
from sffr_gym.task.reference import desired, path_reference
from sffr_gym.task.signals import N_SIGNALS, measure_state
from sffr_gym.task.task_model import make_task_model

SLEW = ["path.turn=1.0", "path.time=12.0", "path.displacement=[1.0, 0.5]"]
SLANTED = "panel.mounts=[{name: a, root: [0.1, 0.5], angle: 1.2}, {name: b, root: [-0.2, -0.5], angle: -2.1}]"
TURNED = "initial.q=[0.1, 0.2, 0.4, 0.6, 4.2, 5.6, 2.1, 0.4, 0.1]"


@pytest.fixture(params=["fixed circle", "tangent circle", "fixed figure-eight", "fixed slew"])
def moving(request, params):
    """Return a robot, its base turned and its panels at angles, its arrays, and its motion along a path."""
    heading, kind = request.param.split()
    changes = [f"path.heading={heading}", f"path.kind={kind}", TURNED, SLANTED, *SLEW, "panel.bending_cut=1.0e+6"]
    robot: Params = params.with_overrides(*changes)
    model = pack(robot)
    return robot, model, path_reference(robot, model, initial_positions(robot, model)[0], phase=0.7)


def root(reference, offset, t):
    """Return the desired place of a panel's root at ``offset`` (2,) in the base."""
    now, from_object = desired(reference, t), np.array([reference.base_x, reference.base_y])
    return np.array([now.x, now.y]) + rotation(now.heading) @ (from_object + rotation(reference.yaw) @ offset)


def test_elastic_forces_balance_the_inertia_of_a_panel_that_rides_along(moving):
    """``K q_f = -S_y a`` with the acceleration ``a`` of the root across the panel, by differences of its motion."""
    robot, model, reference = moving
    beam, t, h = panel_beams(robot)[0], 3.0, 1e-3
    q_f = np.einsum("pfm,pm->pf", model.shapes, quasi_static_at(model, reference, np.array([t]))[0])
    for i, mount in enumerate(robot.panel.mounts):
        after, now, before = (root(reference, np.array(mount.root), time) for time in (t + h, t, t - h))
        a = (after - 2.0 * now + before) / h**2
        angle = desired(reference, t).heading + reference.yaw + mount.angle
        across = np.array([-np.sin(angle), np.cos(angle)]) @ a
        inertia = beam.S_y * across + beam.c_y * desired(reference, t).turn_acceleration
        np.testing.assert_allclose(beam.K @ q_f[i], -inertia, rtol=0, atol=1e-6)
        assert np.abs(beam.S_y * across).max() > 1e-3


def test_rate_is_that_of_the_shape(moving):
    """By central differences."""
    robot, model, reference = moving
    h = 1e-3
    shape, rate = quasi_static_amplitudes(model, reference, np.array([2.3]))
    before, now, after = quasi_static_at(model, reference, 2.3 + np.array([-h, 0.0, h]))
    np.testing.assert_allclose(now, shape[0], rtol=1e-13, atol=1e-18)
    np.testing.assert_allclose((after - before) / (2.0 * h), rate[0], rtol=1e-6, atol=1e-13)
    on_circle = robot.path.kind == "circle"
    assert rate.any() == (
        reference.turning == 0.0 or not on_circle
    )  # seen from a robot that turns with the path nothing changes


def test_wrench_is_that_of_the_bent_panels_inertia(moving):
    """Of the quasi-static shape, carried along as one body by the desired motion, point by point."""
    robot, model, reference = moving
    t, task = 2.3, make_task_model(robot)
    now, amplitudes = desired(reference, t), quasi_static_at(model, reference, np.array([t]))[0]
    wrench, n_p = np.zeros(3), len(robot.panel.mounts)
    p, v = initial_positions(robot, model)
    measure_state(task, reference, now, p, v, np.zeros(n_p), wrench, np.zeros(N_SIGNALS))
    force, moment, panel = np.zeros(2), 0.0, robot.panel
    places, weights = np.polynomial.legendre.leggauss(8)
    for i, mount in enumerate(panel.mounts):
        nodes = np.concatenate([np.zeros(3), model.shapes[i] @ amplitudes[i]])
        turned = rotation(now.heading + reference.yaw)
        for place, weight in zip((places + 1.0) / 2.0, weights / 2.0, strict=True):
            across = shape_functions(place, panel.length)[1] @ nodes
            seen = np.array(mount.root) + rotation(mount.angle) @ [place * panel.length, across]
            from_base = turned @ seen
            d = rotation(now.heading) @ [reference.base_x, reference.base_y] + from_base
            a = np.array([now.xdd, now.ydd]) + now.turn_acceleration * perpendicular(d) - now.turn**2 * d
            force -= weight * panel.mass * a
            moment -= weight * panel.mass * (from_base[0] * a[1] - from_base[1] * a[0])
    np.testing.assert_allclose(wrench, [*force, moment], rtol=1e-9, atol=1e-12)
