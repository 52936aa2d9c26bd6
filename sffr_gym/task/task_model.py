"""A robot with its actuators and what the task asks of it, packed for the compiled control period."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sffr_gym.compile.workspace import Integers
from sffr_gym.config.params import Params
from sffr_gym.physics.actuators import Actuators, actuator_shapes, pack_actuators
from sffr_gym.physics.integrator import INTEGRATORS
from sffr_gym.physics.model import Model, Sizes, model_shapes, model_sizes, pack, steps_in
from sffr_gym.task.episode import Episode
from sffr_gym.task.observation import ObservationIndex, held_joints, observation_fields, observation_index
from sffr_gym.task.reward import Weights, reward_weights
from sffr_gym.types import Array, IntArray


class Limits(NamedTuple):
    """The model's range."""

    tip: float  #: largest transverse tip displacement of a panel [m]
    elbow: float  #: smallest ``|sin|`` of a grasping arm's elbow [-]
    gap: float  #: largest distance of a gripper from its grasp point [m]


class TaskModel(NamedTuple):
    """A robot with its actuators, and what the task asks of it."""

    model: Model  #: the rigid part, panels and object
    actuators: Actuators  #: limits and authority
    held: IntArray  #: (n_h,) joints that hold their angles
    period: float  #: control period [s]
    steps: int  #: integration steps in it
    integrator: int  #: see ``integrator``
    limits: Limits  #: ends of an episode
    scale: Array  #: (n_u,) command of a unit action
    at: ObservationIndex  #: index map of the observation
    bound: Array  #: (n_o,) its range
    weights: Weights  #: of the reward


class TaskSizes(NamedTuple):
    """Numbers of a task model's parts."""

    model: Sizes  #: of the robot's parts
    channels: int  #: piezo channels of a panel
    command: int  #: n_u, n_h and n_o
    held: int
    observation: int


def make_task_model(params: Params) -> TaskModel:
    """Pack parameters for the compiled control period."""
    model = pack(params)
    actuators = pack_actuators(params, model)
    period, limits = params.control.period, params.limits
    fields = observation_fields(model, params)
    return TaskModel(
        model=model,
        actuators=actuators,
        held=held_joints(model),
        period=period,
        steps=steps_in(model, period),
        integrator=INTEGRATORS[params.simulation.integrator],
        limits=Limits(limits.tip * params.panel.length, limits.arm_singularity, limits.grasp_gap),
        scale=actuators.limit.copy(),
        at=observation_index(fields),
        bound=np.concatenate([np.full(field.size, field.bound) for field in fields.values()]),
        weights=reward_weights(params),
    )


def task_sizes(task: TaskModel) -> TaskSizes:
    """Return the numbers of a task model's parts."""
    channels = task.actuators.gain.shape[1]
    return TaskSizes(model_sizes(task.model), channels, len(task.scale), len(task.held), len(task.bound))


def task_shapes(n):
    """Shapes of a :class:`TaskModel`, for :func:`sffr_gym.compile.workspace.structure`.

    n: :class:`TaskSizes`.
    """
    one = Integers(())
    return TaskModel(
        model=model_shapes(n.model), actuators=actuator_shapes(n.model, n.channels, n.command),
        held=Integers((n.held,)), period=(), steps=one, integrator=one, limits=Limits((), (), ()), scale=(n.command,),
        at=ObservationIndex(
            one, one, one, one, one, one, one, one, one, one, one, one, one, one, one, one, one, one, one
        ),
        bound=(n.observation,), weights=Weights((), (), ()),
    )  # fmt: skip


def plant_of(prior: TaskModel, episode: Episode) -> TaskModel:
    """Return the plant of an episode with its faults; ``prior`` itself if that is the plant and all of it works.

    An action still asks for a part of the limits that the controllers believe in; what a fault takes of them cuts it
    off.

    Args:
        prior: the robot that the controllers believe in.
        episode: as drawn.
    """
    left = episode.health.left(prior.actuators)
    if episode.plant is episode.prior and left.min() == 1.0:
        return prior
    plant = prior if episode.plant is episode.prior else make_task_model(episode.plant)
    actuators = plant.actuators._replace(limit=plant.actuators.limit * left)
    return plant._replace(actuators=actuators, scale=prior.scale)
