"""The forms of arguments for which the entries of this package are compiled: the case study's, in all variants."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from sffr_gym.compile.arguments import Structures
from sffr_gym.compile.lanes import WIDTH
from sffr_gym.compile.workspace import new_workspace
from sffr_gym.config.params import load_params
from sffr_gym.envs.batch import Batch, group_memory, group_shapes, make_batch, observe_range, step_range
from sffr_gym.envs.batch_draws import start_range
from sffr_gym.envs.lane_plants import LanePlants
from sffr_gym.physics.integrator import step_shapes
from sffr_gym.physics.plant import advance_plant, evaluate
from sffr_gym.task.control_period import observe_states, period_shapes
from sffr_gym.task.episode import draws_of, nominal
from sffr_gym.task.reference import path_reference
from sffr_gym.task.scenario import load_scenario
from sffr_gym.task.signals import N_SIGNALS
from sffr_gym.task.task_model import TaskModel, make_task_model

Exemplars = Iterator[tuple[str, tuple[Any, ...]]]
PLAIN, LANES, OWN = "plain", "lanes", "lanes of plants"  # labels: what is compiled together


def exemplar_task() -> TaskModel:
    """Return a robot."""
    return make_task_model(load_params())


def exemplar_groups(shapes: Any) -> Iterator[tuple[str, tuple[Structures, Structures, Batch], tuple[Any, ...]]]:
    """Yield plants of groups and of one, a batch and memory: one by one, in lanes, and with plants in lanes.

    Args:
        shapes: returns those of the memory for a robot.
    """
    task = exemplar_task()
    plants, own = Structures([task]), LanePlants([[task] * WIDTH]).structures
    for width, label, groups in ((1, PLAIN, plants), (WIDTH, LANES, plants), (WIDTH, OWN, own)):
        yield label, (groups, plants, make_batch(task, WIDTH)), group_memory(shapes(task), width)


@step_range.shown_by
def _step_range() -> Exemplars:
    for label, batched, memory in exemplar_groups(group_shapes):
        actions, active = np.zeros_like(batched[-1].applied), np.ones(WIDTH, dtype=np.bool_)
        yield label, (*batched, actions, active, *memory, 0, WIDTH)


@observe_range.shown_by
def _observe_range() -> Exemplars:
    task = exemplar_task()
    chosen, memory = np.ones(2, dtype=np.bool_), new_workspace(period_shapes(task))
    yield PLAIN, (Structures([task]), make_batch(task, 2), chosen, memory, 0, 2)


@start_range.shown_by
def _start_range() -> Exemplars:
    task, known = exemplar_task(), nominal(load_params())
    draws, _ = draws_of(load_scenario("impulse"), known)
    numbers, chosen = np.zeros((2, len(draws.kinds))), np.ones(2, dtype=np.bool_)
    ticks = np.zeros(2, dtype=np.int64)
    yield PLAIN, (known.model, draws, numbers, chosen, make_batch(task, 2), ticks, 0, 2)


@observe_states.shown_by
def _observe_states() -> Exemplars:
    task = exemplar_task()
    p = np.zeros((2, task.model.at.end))
    reference = path_reference(load_params(), task.model, p[0])
    obs, memory = np.zeros((2, len(task.bound))), new_workspace(period_shapes(task))
    yield PLAIN, (task, reference, np.zeros(2), p, p, memory, obs, np.zeros(N_SIGNALS))


@advance_plant.shown_by
def _advance_plant() -> Exemplars:
    task = exemplar_task()
    p, memory = np.zeros(task.model.at.end), new_workspace(step_shapes(task.model))
    yield PLAIN, (task.model, p, p, p, 0.0, 1, 0, memory)


@evaluate.shown_by
def _evaluate() -> Exemplars:
    task = exemplar_task()
    p, memory = np.zeros(task.model.at.end), new_workspace(step_shapes(task.model))
    yield PLAIN, (task.model, p, p, p, memory.dynamics, p, False)
