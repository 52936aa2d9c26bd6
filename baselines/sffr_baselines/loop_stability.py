"""Whether a law is stable on a plant: the poles of the sampled, linear closed loop of both.

The plant is linearised about its start, panels straight, and sampled with held commands; so are the law, its observer
and integrals, and actuators that lag. Limits, on-off thrusters, steps, adaptation and sensors that lag are left out: a
loop that is stable here can still fail, one that is not will.
"""

from __future__ import annotations

import functools
import warnings
from typing import NamedTuple

import numpy as np

from sffr_baselines.closed_loop import act
from sffr_baselines.control_law import Law, law_shapes, make_states
from sffr_gym.compile.workspace import new_workspace
from sffr_gym.config.params import Params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.physics.actuators import pack_actuators
from sffr_gym.physics.initial import initial_positions
from sffr_gym.physics.integrator import INTEGRATORS
from sffr_gym.physics.linearization import LinearModel, Tangent, closed, linear_model, tangent
from sffr_gym.physics.model import mode_slice
from sffr_gym.physics.plant import Plant
from sffr_gym.task.control_period import observe_states, period_shapes
from sffr_gym.task.signals import N_SIGNALS
from sffr_gym.task.task_model import TaskModel, make_task_model
from sffr_gym.types import Array

FASTEST_GROWTH = 0.05  # 1/s; over an episode of two minutes slower growth is hidden by what else happens
STEP = 1.0e-5  # of a central difference of the law, which is nearly linear: m, rad and their rates
SETTLED = 2.0  # observations after which an observer goes on as ever


class Growth(NamedTuple):
    """The fastest growth of a closed loop."""

    rate: float  #: [1/s], negative if all dies away
    pole: complex  #: whose magnitude is the growth each period
    state: str  #: that has the largest share in it


class PlantPoint(NamedTuple):
    """A plant and the point about which it is linear."""

    task: TaskModel
    linear: LinearModel  #: sampled at the control period
    way: Tangent  #: motion that the grasps allow
    p: Array  #: (n,) positions and velocities
    v: Array  #: (n,)


def closed_loop_growth(law: Law, plant: Params) -> Growth:
    """Return the fastest growth of a law on a plant.

    Args:
        law: of the same observations and actuators.
        plant: the robot as it is.

    Raises:
        ValueError: if a grasping arm is straight, or a grasp open, so that there is no linear model.
        ConfigError: for a plant that cannot be simulated.
    """
    point = _point_of(plant)
    matrix, names = loop_matrix(law, point)
    poles, vectors = np.linalg.eig(matrix)
    worst = int(np.argmax(np.abs(poles)))
    state = names[int(np.argmax(np.abs(vectors[: len(names), worst])))]
    return Growth(float(np.log(np.abs(poles[worst]))) / point.task.period, complex(poles[worst]), state)


def loop_matrix(law: Law, point: PlantPoint) -> tuple[Array, list[str]]:
    """Return the map of the closed loop over a control period, and the names of the plant's states, its first.

    Then come what the law remembers (integrals, estimates) and the forces of lagging actuators.
    """
    linear, actuators, n = point.linear, point.task.actuators, len(point.linear.x0)
    observations = _observe(law, point)
    memory = _memory(law, observations[0])
    n_s = len(memory)
    offsets = np.kron(np.eye(n_s), np.array([[STEP], [-STEP]]))
    before = np.vstack([np.tile(memory, (len(observations), 1)), memory + offsets])
    seen = np.vstack([observations, np.tile(observations[0], (len(offsets), 1))])
    command, after = _act(law, seen, before)
    both = np.column_stack([command, after])
    slopes = (both[1::2] - both[2::2]).T / (2.0 * STEP)
    gain, remembered = slopes[: command.shape[1]], slopes[command.shape[1] :]
    gain[actuators.limit == 0.0] = 0.0  # what is not there
    n_u = len(gain)
    matrix = np.zeros((n + n_s + n_u, n + n_s + n_u))
    law_end = n + n_s
    matrix[:n, :n], matrix[n:law_end, :law_end] = linear.A, remembered
    matrix[:n, :law_end] += linear.B * (1.0 - actuators.behind) @ gain
    matrix[:n, law_end:] = linear.B * actuators.behind
    matrix[law_end:, :law_end] = (1.0 - actuators.decay)[:, None] * gain
    matrix[law_end:, law_end:] = np.diag(actuators.decay)
    return matrix, [label.name for label in linear.states]


def warn_if_unstable(name: str, law: Law, plant: Params, where: str) -> bool:
    """Warn of a law that is unstable on a plant, with the growth and what would help; return whether it is.

    Args:
        name: of the policy.
        law: its compiled form.
        plant: the robot as it is.
        where: what to call it.
    """
    if plant.simulation.coupling == "staggered":  # whose late reaction has a bound of its own
        return False
    try:
        growth = closed_loop_growth(law, plant)
    except (ValueError, ConfigError, np.linalg.LinAlgError):  # told where the robot is simulated
        return False
    if growth.rate <= FASTEST_GROWTH:
        return False
    period = plant.control.period
    warnings.warn(
        f"{name} is unstable on {where}: held for {period:g} s, its commands let {growth.state} grow by "
        f"{growth.rate:.3g} 1/s ({abs(growth.pole):.4g} times each period; linear closed loop); {_remedy(growth)}",
        stacklevel=5,
    )
    return True


def _remedy(growth: Growth) -> str:
    if "_mode" in growth.state:
        return (
            "shorten control.period, lower suppression.B0, or leave out fast modes with panel.bending_cut and "
            "panel.axial_cut"
        )
    return "shorten control.period, lower control.Kp and control.Kd, or let actuators lag less"


@functools.lru_cache(maxsize=64)
def _point_of(plant: Params) -> PlantPoint:
    """Return a plant linearised about its start, with straight panels."""
    task = make_task_model(plant)
    model, actuators = task.model, pack_actuators(plant, task.model)
    p, v = initial_positions(plant, model)
    p[mode_slice(model)] = v[mode_slice(model)] = 0.0
    p, v = closed(model, p, v)
    equations = Plant(model, INTEGRATORS[plant.simulation.integrator])
    linear = linear_model(plant, model, actuators, equations, p, v, np.zeros(len(actuators.limit)))
    return PlantPoint(task, linear.discrete(task.period), tangent(model, p, v), p, v)


def _observe(law: Law, point: PlantPoint) -> Array:
    """Return observations (1 + 2 n, n_o): of the point, then a step ahead and one behind in each of its n states."""
    way, p, v = point.way, point.p, point.v
    ahead = [(way.T[:, j], way.S[:, j]) for j in range(len(way.free))]
    ahead += [(0.0 * p, way.T[:, j]) for j in range(len(way.free))]
    places, rates = [p], [v]
    for dp, dv in ahead:
        places += [p + STEP * dp, p - STEP * dp]
        rates += [v + STEP * dv, v - STEP * dv]
    task = point.task
    observations, signals = np.zeros((len(places), len(task.bound))), np.zeros(N_SIGNALS)
    memory = new_workspace(period_shapes(task))
    still = np.zeros(len(places))
    observe_states(task, law.reference, still, np.array(places), np.array(rates), memory, observations, signals)
    return observations


def _memory(law: Law, seen: Array) -> Array:
    """Return what the law remembers once settled at the point: integrals, estimates of errors, position filters."""
    estimates = np.column_stack([seen[law.observer.error], seen[law.observer.rate]])
    return np.concatenate([np.zeros(len(estimates)), estimates.ravel(), np.zeros(4 * len(law.allocation))])


def _act(law: Law, seen: Array, memory: Array) -> tuple[Array, Array]:
    """Return the commands (rows, n_u) of the law for what it sees (rows, n_o) and remembers, and its memory then."""
    states, n, n_t = make_states(law, len(seen)), len(seen), len(law.observer.error)
    integral, errors, filters = np.split(memory, [n_t, 3 * n_t], axis=1)
    states.integral[:], states.errors[:] = integral, errors.reshape(n, n_t, 2)
    states.filters[:] = filters.reshape(states.filters.shape)
    states.age[:] = SETTLED
    actions = np.zeros((len(seen), len(law.scale)))
    act(law, np.ones(1, dtype=np.int64), seen, states, actions, new_workspace(law_shapes(law)))
    return actions * law.scale, np.column_stack(
        [states.integral, states.errors.reshape(n, -1), states.filters.reshape(n, -1)]
    )
