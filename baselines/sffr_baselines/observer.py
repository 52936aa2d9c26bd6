"""What a law makes of its measurements: an observer for noise, and the compensation of sensors that lag a period.

The error law ``edd = -(Kp e + Kd ed + Ki z)`` says how the errors of base, grippers and object will change over a
control period. A steady-state Kalman filter corrects that prediction by what is measured; where sensors lag, the
measurement corrects the estimate of a period ago, from which the present errors are predicted (Smith). Without either
the law acts on what is measured, as the paper's does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_are

from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.lanes import where
from sffr_gym.compile.linalg import assign
from sffr_gym.config.params import Params
from sffr_gym.config.sections import Observer as ObserverSection
from sffr_gym.physics.kinematics import perpendicular, rotation
from sffr_gym.physics.model import Model
from sffr_gym.task.observation import ObservationIndex, reference_turning
from sffr_gym.task.reference import Reference
from sffr_gym.types import Array, IntArray

ANGLE = 2  # axis of a tracked angle; 0 and 1 are those of a point


class Observer(NamedTuple):
    """The tracked errors, one after another, and how measurements correct them."""

    compensates: bool  #: whether the law looks for sensors that lag, and makes up for it
    filters: bool  #: whether measurements are weighed against the prediction
    period: float  #: control period [s]
    error: IntArray  #: (n_t,) places of the errors in an observation, and of their rates
    rate: IntArray  #: (n_t,)
    axis: IntArray  #: (n_t,) reference axis of each, or ``ANGLE``
    lever: Array  #: (n_t,) speed along it for a unit of the reference's turn [m]; 1 for angles
    gain: Array  #: (n_t, 2, 2) of the innovation of error and rate, on both


class Tracked(NamedTuple):
    """A tracked error: its places in the observation and how the reference moves it; see :class:`Observer`."""

    error: int
    rate: int
    axis: int
    lever: float


def make_observer(prior: Params, model: Model, reference: Reference, at: ObservationIndex) -> Observer:
    """Design the observer for what the controller believes.

    Args:
        prior: the controller's parameters.
        model: the same as arrays.
        reference: the formation that the task asks for.
        at: index map of the observation.
    """
    control, tracked = prior.control, tracked_errors(model, reference, at)
    gains = [_kalman_gain(control.observer, control.period, angle=each.axis == ANGLE) for each in tracked]
    return Observer(
        compensates=control.delay_compensation,
        filters=control.observer is not None,
        period=control.period,
        error=np.array([each.error for each in tracked], dtype=np.int64),
        rate=np.array([each.rate for each in tracked], dtype=np.int64),
        axis=np.array([each.axis for each in tracked], dtype=np.int64),
        lever=np.array([each.lever for each in tracked]),
        gain=np.array(gains),
    )


def tracked_errors(model: Model, reference: Reference, at: ObservationIndex) -> list[Tracked]:
    """Return the errors that the law of Eqs. 9 and 12 governs: base x, y, yaw; each gripper's x, y; object x, y, angle.

    Args:
        model: the robot.
        reference: the formation that the task asks for.
        at: index map of the observation.
    """
    base = np.array([reference.base_x, reference.base_y])
    tracked = _point(at.base_error, at.base_error_rate, base)
    tracked.append(Tracked(at.yaw_error, at.yaw_error_rate, ANGLE, 1.0))
    for g, point in enumerate(model.grasp_point):
        tracked += _point(at.tip_error + 2 * g, at.tip_error_rate + 2 * g, rotation(reference.phi) @ point)
    if model.object_mass > 0.0:
        tracked += _point(at.object_error, at.object_error_rate, np.zeros(2))
        tracked.append(Tracked(at.object_angle_error, at.object_angle_error_rate, ANGLE, 1.0))
    return tracked


def _point(error: int, rate: int, place: Array) -> list[Tracked]:
    """Return the two coordinates of a point that the reference carries at a place in its axes."""
    return [Tracked(error + k, rate + k, k, float(perpendicular(place)[k])) for k in (0, 1)]


def _kalman_gain(noise: ObserverSection | None, period: float, *, angle: bool) -> Array:
    """Return the gain (2, 2) of the steady-state filter of an error and its rate; without a model of the noise, 1.

    The error is a double integrator under a known acceleration and an unknown one, white and held over each period.
    """
    if noise is None:
        return np.eye(2)
    unknown = noise.angular_acceleration if angle else noise.acceleration
    measured = np.diag([noise.angle, noise.rate] if angle else [noise.position, noise.velocity]) ** 2
    A, G = np.array([[1.0, period], [0.0, 1.0]]), np.array([[period**2 / 2.0], [period]])
    P = solve_discrete_are(A.T, np.eye(2), unknown**2 * G @ G.T + 1.0e-30 * np.eye(2), measured)
    return np.asarray(P @ np.linalg.inv(P + measured), dtype=np.float64)


@kernel
def integrate(observer, seen, saturated, state):
    """Add a period's errors ``seen`` (n_o,) to ``state.integral`` (n_t,), but not while actuators saturate."""
    for k in range(len(observer.error)):
        error = seen[observer.error[k]]
        state.integral[k] += where(saturated, 0.0, observer.period * error)


@kernel
def estimate(observer, gains, at, obs, state, seen):
    """Write what the law acts on, ``seen`` (n_o,), for a measured observation ``obs`` (n_o,).

    observer: :class:`Observer`; gains: :class:`mic.Gains` of the error law; at: index map of the observation.
    state: :class:`LawState`, of which ``errors``, ``late`` and ``age`` change.
    """
    assign(seen, obs)
    if not (observer.compensates or observer.filters):
        return
    if observer.compensates:
        state.late[0] = where(state.age[0] == 1.0, _lag(observer, at, obs, state.errors), state.late[0])
        ahead = state.late[0] * observer.period
        for k in range(at.joint_rate - at.joint_angle):
            seen[at.joint_angle + k] += ahead * obs[at.joint_rate + k]
        for k in range(at.elastic_rate - at.elastic):
            seen[at.elastic + k] += ahead * obs[at.elastic_rate + k]
    for k in range(len(observer.error)):
        _correct(observer, gains, at, obs, state, k)
        seen[observer.error[k]], seen[observer.rate[k]] = state.errors[k, 0], state.errors[k, 1]
    state.age[0] = state.age[0] + 1.0


@kernel
def _correct(observer, gains, at, obs, state, k):
    """Bring the estimate of tracked error ``k`` and of its rate up to the present; arguments as before."""
    T, late = observer.period, state.late[0]
    last, last_rate = state.errors[k, 0], state.errors[k, 1]
    known = -(gains.Kp * last + gains.Kd * last_rate + gains.Ki * state.integral[k])
    # What is measured, as an error at the time when it was true: the reference has moved on since.
    speed, acceleration = _reference_motion(observer, at, obs, k)
    y = obs[observer.error[k]] - late * T * (speed - 0.5 * T * acceleration)
    yd = obs[observer.rate[k]] - late * T * acceleration
    x, xd = y, yd
    if observer.filters:
        expected = where(late > 0.0, last, last + T * (last_rate + 0.5 * T * known))
        expected_rate = where(late > 0.0, last_rate, last_rate + T * known)
        L = observer.gain[k]
        x = expected + L[0, 0] * (y - expected) + L[0, 1] * (yd - expected_rate)
        xd = expected_rate + L[1, 0] * (y - expected) + L[1, 1] * (yd - expected_rate)
    begun = state.age[0] > 0.0  # nothing is expected of the first one
    x, xd = where(begun, x, y), where(begun, xd, yd)
    state.errors[k, 0] = where(late > 0.0, x + T * (xd + 0.5 * T * known), x)
    state.errors[k, 1] = where(late > 0.0, xd + T * known, xd)


@kernel
def _reference_motion(observer, at, obs, k):
    """Desired velocity and acceleration of tracked coordinate ``k``, reference axes; without the turn's square."""
    turn_acceleration, _ = reference_turning(at, obs)
    if observer.axis[k] == ANGLE:
        return obs[at.reference_turn], turn_acceleration
    axis = observer.axis[k]
    speed = obs[at.reference_velocity + axis] + obs[at.reference_turn] * observer.lever[k]
    return speed, obs[at.reference_acceleration + axis] + turn_acceleration * observer.lever[k]


@kernel
def _lag(observer, at, obs, first):
    """Return 1 if the second observation shows that the sensors lag a period, else 0.

    first: (n_t, 2) errors and rates of the first one, which cannot. If they lag, all errors have jumped by the
    reference's motion, as if the robot had stood still; else they have moved with their own rates. The squares of what
    either leaves decide.
    """
    T, stood, moved = observer.period, 0.0, 0.0
    for k in range(len(observer.error)):
        if observer.axis[k] != ANGLE:
            change = obs[observer.error[k]] - first[k, 0]
            speed, _ = _reference_motion(observer, at, obs, k)
            stood += (change - T * speed) * (change - T * speed)
            moved += (change - T * first[k, 1]) * (change - T * first[k, 1])
    return where(stood < moved, 1.0, 0.0)
