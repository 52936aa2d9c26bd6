"""Signals of a command and of a robot that carries nothing, by hand."""

import numpy as np
import pytest

from sffr_gym import SFFRFlexEnv
from sffr_gym.physics.initial import initial_positions
from sffr_gym.task.reference import desired, path_reference
from sffr_gym.task.signals import N_SIGNALS, SIGNALS, measure_command, measure_state
from sffr_gym.task.task_model import make_task_model

FREE = ["object=null", "initial.q=[1.0, 2.0, 0.3, 0.6, 4.2, 5.6, 2.1, 0.4488, 0.08727]"]


def measured(params, asked, applied, q_flex=(0.0, 0.0, 0.0), quasi_static=(0.0, 0.0, 0.0)):
    """Return the signals of a command that are not zero, by name."""
    signals = np.zeros(N_SIGNALS)
    measure_command(make_task_model(params), asked, applied, np.array(q_flex), np.array(quasi_static), signals)
    return {name: value for name, value in zip(SIGNALS, signals.tolist(), strict=True) if value != 0.0}


def test_effort_is_of_what_was_applied(params):
    """Squares of volts and of joint torques, and the thrusters' force along both axes; their torque costs no fuel."""
    applied = np.array([1.0, -2.0, 3.0, 0.0, 0.0, 0.0, 3.0, -4.0, 9.0, 1.0, 0.0, -2.0, 0.0, 0.0, 0.0])
    assert measured(params, np.zeros(15), applied) == {"piezo_square": 14.0, "thrust": 7.0, "joint_square": 5.0}


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_saturation_is_the_share_of_a_groups_channels_at_their_limits(params, sign):
    """At the limit counts, just below does not, whatever was applied."""
    task = make_task_model(params)
    asked = sign * task.actuators.limit * (1.0 - 1e-12)
    assert measured(params, asked, np.zeros(15)) == {}
    asked[[0, 5, 6, 8, 9, 10, 14]] = sign * task.actuators.limit[[0, 5, 6, 8, 9, 10, 14]]
    assert measured(params, asked, np.zeros(15)) == pytest.approx(
        {"piezo_saturated": 2 / 6, "thruster_saturated": 2 / 3, "joint_saturated": 3 / 6}
    )


def test_disturbance_is_what_of_the_panels_wrench_is_not_quasi_static(params):
    found = measured(params, np.zeros(15), np.zeros(15), (4.0, 1.0, -2.0), (1.0, 5.0, 1.0))
    assert found == {"force_deviation": 5.0, "moment_deviation": 3.0}


def test_without_an_object_errors_are_those_of_the_base():
    """None at a start that is turned and away from the origin; then what the base is moved by, whichever way."""
    env = SFFRFlexEnv(overrides=FREE)
    _, info = env.reset(seed=0)
    assert (info["object_error"], info["attitude_error"]) == pytest.approx((0.0, 0.0), abs=1e-12)
    *_, before = env.step(np.zeros(15))
    for shift, angle in (((3e-3, 4e-3), 2e-3), ((-3e-3, 4e-3), -2e-3)):
        env.reset(seed=0)
        state = env.get_state()
        state["batch"].p[0, :3] += (*shift, angle)
        env.set_state(state)
        *_, info = env.step(np.zeros(15))
        assert info["object_error"] == pytest.approx(5e-3, abs=2.0 * before["object_error"] + 1e-6)
        assert info["attitude_error"] == pytest.approx(2e-3, abs=2.0 * before["attitude_error"] + 1e-6)


def test_errors_of_a_base_alone_are_those_from_its_path_and_heading(params):
    """Far along a path that it turns with, and turned at its start."""
    free = params.with_overrides(*FREE, "path.heading=tangent")
    task = make_task_model(free)
    p, v = initial_positions(free, task.model)
    reference, signals = path_reference(free, task.model, p), np.zeros(N_SIGNALS)
    now = desired(reference, 20.0)
    p[:3] = now.x + 3e-3, now.y - 4e-3, now.heading + 0.3 - 2e-3  # 0.3 rad as it starts
    measure_state(task, reference, now, p, v, np.zeros(2), np.zeros(3), signals)
    assert signals[:2] == pytest.approx([5e-3, 2e-3], rel=1e-9)
