"""One control period of the task: a held command, what it does to the plant, and what is observed and measured then.

Pure functions of the state; one source for the single environment, the batch and the compiled closed loop.
"""

from __future__ import annotations

from typing import NamedTuple

from sffr_gym.compile.kernels import entry, kernel
from sffr_gym.compile.lanes import any_lane, where
from sffr_gym.compile.linalg import assign
from sffr_gym.physics.actuators import actuate, actuator_state, generalized_forces, state_size
from sffr_gym.physics.integrator import StepWork, advance, step_shapes
from sffr_gym.physics.model import N_BASE
from sffr_gym.task.observation import observe
from sffr_gym.task.reference import desired
from sffr_gym.task.signals import N_SIGNALS, measure_command, measure_state
from sffr_gym.task.status import NOT_FINITE, RUNNING, status_of
from sffr_gym.types import Array

LARGEST = 1.0e100  # of a state: energies and rewards are made of its squares


class Before(NamedTuple):
    """The state before a period, to which an environment that diverges goes back."""

    p: Array  #: (n,) positions and velocities
    v: Array  #: (n,)
    actuation: Array  #: (n_u + 9,) what the actuators remember
    obs: Array  #: (n_o,), signals: (N_SIGNALS,) what was observed and measured; kept only where other lanes go on
    signals: Array


class PeriodWork(NamedTuple):
    """Memory of a control period. One for each thread."""

    step: StepWork  #: of the integrator
    before: Before  #: the state before the period
    tau: Array  #: (n,) generalised forces
    asked: Array  #: (n_u,) command within the limits
    applied: Array  #: (n_u,) what the actuators gave of it
    quasi_static: Array  #: (3,) quasi-static wrench of the panels on the base [N, N, N m]
    energy: Array  #: (n_p,) each panel's share of the signal ``vibration`` [J]


def period_shapes(task):
    """Shapes of the :class:`PeriodWork` of a :class:`task_model.TaskModel`."""
    n, n_u = task.model.at.end, len(task.scale)
    return PeriodWork(
        step=step_shapes(task.model),
        before=Before((n,), (n,), (state_size(n_u),), (len(task.bound),), (N_SIGNALS,)), tau=(n,),
        asked=(n_u,), applied=(n_u,), quasi_static=(3,), energy=(len(task.model.panel_root),),
    )  # fmt: skip


@kernel
def control_period(task, reference, t_end, p, v, command, actuation, wrench, work, obs, signals):
    """Hold a command for the control period that ends at ``t_end`` [s]; advance ``p, v`` (n,) in place.

    A state that is not finite is not returned: ``p, v`` and actuators go back to what they were, observation and
    signals stay.

    task: the plant as a :class:`task_model.TaskModel`; reference: the episode's :class:`reference.Reference`.
    command: (n_u,) piezo volts, base thrust, joint torques, before the limits.
    actuation: (n_u + 9,) numbers of the :class:`actuators.ActuatorState`, advanced in place.
    wrench: (3,) force of the surroundings on the base [N, N, N m], base axes.
    work: :class:`PeriodWork`.
    obs: (n_o,) observation at the end, written; signals: (N_SIGNALS,) written.

    Returns the status of the new state: ``RUNNING``, or why the episode ends.
    """
    before = work.before
    assign(before.p, p)
    assign(before.v, v)
    assign(before.actuation, actuation)
    actuate(task.actuators, command, actuator_state(task.actuators, actuation), work.asked, work.applied)
    generalized_forces(task.model, task.actuators, work.applied, work.tau)
    for k in range(N_BASE):
        work.tau[k] += wrench[k]
    for k in range(task.model.at.object, task.model.at.end):  # nothing pushes the object but the grippers
        work.tau[k] = 0.0
    advance(task.model, p, v, work.tau, task.period, task.steps, task.integrator, work.step)
    diverged = _has_diverged(p, v)
    if any_lane(diverged > 0.0):
        _roll_back(diverged, before.p, p)
        _roll_back(diverged, before.v, v)
        _roll_back(diverged, before.actuation, actuation)
        if not any_lane(diverged == 0.0):
            return where(diverged > 0.0, NOT_FINITE, RUNNING)
        assign(before.obs, obs)
        assign(before.signals, signals)
    des = desired(reference, t_end)
    observe(task, reference, des, p, v, work.step.dynamics, obs, False)
    measure_state(task, reference, des, p, v, work.energy, work.quasi_static, signals)
    measure_command(task, work.asked, work.applied, work.step.forces.q_flex, work.quasi_static, signals)
    status = status_of(task, p, v, work.step.dynamics, obs)
    if any_lane(diverged > 0.0):
        _roll_back(diverged, before.obs, obs)
        _roll_back(diverged, before.signals, signals)
    return where(diverged > 0.0, NOT_FINITE, status)


@entry
def observe_states(task, reference, t, p, v, work, obs, signals):
    """Observe states (rows, n) at times ``t`` (rows,) [s] without steps, into ``obs`` (rows, n_o).

    Other arguments as in :func:`observe_state`; the signals are those of the last one.
    """
    for row in range(len(t)):
        observe_state(task, reference, t[row], p[row], v[row], work, obs[row], signals)


@kernel
def observe_state(task, reference, t, p, v, work, obs, signals):
    """Observe and measure a state at time ``t`` [s] without a step; the signals of the command are 0.

    Arguments as in :func:`control_period`.
    """
    des = desired(reference, t)
    observe(task, reference, des, p, v, work.step.dynamics, obs, True)
    signals[:] = 0.0
    measure_state(task, reference, des, p, v, work.energy, work.quasi_static, signals)


@kernel
def _has_diverged(p, v):
    """1 where a position or velocity (n,) is not finite, or its square would not be, else 0."""
    diverged = 0.0
    for k in range(len(p)):
        diverged = where((abs(p[k]) < LARGEST) & (abs(v[k]) < LARGEST), diverged, 1.0)  # NaN is not less
    return diverged


@kernel
def _roll_back(diverged, before, values):
    """Put values (n,) back to what they were before where the state has diverged."""
    for k in range(len(values)):
        values[k] = where(diverged > 0.0, before[k], values[k])
