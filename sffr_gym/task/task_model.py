"""A robot with its actuators and what the task asks of it, packed for the compiled control period."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sffr_gym.compile.workspace import Integers
from sffr_gym.config.params import Params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.physics.actuators import Actuators, actuator_shapes, pack_actuators
from sffr_gym.physics.integrator import INTEGRATORS
from sffr_gym.physics.model import Model, Sizes, model_shapes, model_sizes, pack, steps_in
from sffr_gym.task.episode import Episode, Nominal
from sffr_gym.task.observation import ObservationIndex, held_joints, observation_fields, observation_index
from sffr_gym.task.reference import N_REFERENCE
from sffr_gym.task.reward import Weights, reward_weights
from sffr_gym.types import Array, IntArray


class Limits(NamedTuple):
    """The model's range."""

    tip: float  #: largest transverse tip displacement, as a part of the panel's length [-]
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
    reference: int  #: numbers of an episode's :class:`reference.Reference`
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
        limits=Limits(limits.tip, limits.arm_singularity, limits.grasp_gap),
        scale=actuators.rated.copy(),
        at=observation_index(fields),
        reference=N_REFERENCE + len(model.link_mass) + params.path.pieces.size,
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
        at=ObservationIndex(*[one] * len(ObservationIndex._fields)), reference=one,
        bound=(n.observation,), weights=Weights((), (), (), (), (), ()),
    )  # fmt: skip


def nominal_plant(prior: TaskModel, known: Nominal) -> TaskModel:
    """Return a scenario's plant before anything is drawn; ``prior`` itself if that is the plant.

    An action asks for a part of the limits that the controllers believe in.

    Args:
        prior: the robot that the controllers believe in.
        known: the same, with the plant.

    Raises:
        ConfigError: if the plant has other actuators, sensors or control periods than the controllers believe.
    """
    if known.plant is known.params:
        return prior
    plant = make_task_model(known.plant)._replace(scale=prior.scale)
    if (plant.at, len(plant.actuators.limit), plant.period) != (prior.at, len(prior.scale), prior.period):
        raise ConfigError(
            "plant.settings: the plant must have the actuators, the observed parts and the control period that its "
            "controllers believe in; change these for both with `robot`"
        )
    return plant._replace(bound=prior.bound)


def plant_of(plant: TaskModel, known: Nominal, episode: Episode) -> TaskModel:
    """Return the plant of an episode with its faults; ``plant`` itself if nothing of it was drawn and all of it works.

    What a fault or a drawn limit takes of the limits that the controllers believe in cuts off what an action asks for.

    Args:
        plant: of the scenario, before anything is drawn, see :func:`nominal_plant`.
        known: what it was made of.
        episode: as drawn.
    """
    left = episode.health.left(plant.actuators)
    same = episode.plant is (episode.prior if known.plant is known.params else known.plant)
    if same and left.min() == 1.0:
        return plant
    own = plant if same else make_task_model(episode.plant)
    actuators = own.actuators._replace(limit=own.actuators.limit * left)
    return own._replace(actuators=actuators, scale=plant.scale, bound=plant.bound)
