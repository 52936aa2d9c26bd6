"""The forms of arguments for which the entries of this package are compiled: the case study's, in all variants."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from sffr_gym.compile.arguments import Structures
from sffr_gym.compile.lanes import WIDTH
from sffr_gym.compile.workspace import new_workspace
from sffr_gym.config.params import load_params
from sffr_gym.envs.batch import Batch, group_memory, group_shapes, make_batch, observe_row, step_range
from sffr_gym.physics.integrator import step_shapes
from sffr_gym.physics.simulator import advance_plant, evaluate
from sffr_gym.task.control_period import observe_states, period_shapes
from sffr_gym.task.reference import circle_reference
from sffr_gym.task.signals import N_SIGNALS
from sffr_gym.task.task_model import TaskModel, make_task_model

Exemplars = Iterator[tuple[str, tuple[Any, ...]]]
STEP = "simulation.max_step=1.0e-4"  # which suits both couplings


def exemplar_tasks() -> Iterator[tuple[str, TaskModel]]:
    """Yield a robot for each coupling, with a label."""
    for coupling in ("exact", "staggered"):
        yield coupling, make_task_model(load_params().with_overrides(f"simulation.coupling={coupling}", STEP))


def exemplar_groups(shapes: Any) -> Iterator[tuple[str, Structures, Batch, tuple[Any, ...]]]:
    """Yield plants, a batch and memory for both couplings, one by one and in lanes, with a label.

    Args:
        shapes: returns those of the memory for a robot.
    """
    for coupling, task in exemplar_tasks():
        for width, label in ((1, coupling), (WIDTH, f"{coupling} lanes")):
            yield label, Structures([task]), make_batch(task, WIDTH), group_memory(shapes(task), width)


@step_range.shown_by
def _step_range() -> Exemplars:
    for label, plants, batch, memory in exemplar_groups(group_shapes):
        actions, active = np.zeros_like(batch.applied), np.ones(WIDTH, dtype=np.bool_)
        yield label, (plants, batch, actions, active, *memory, 0, WIDTH)


@observe_row.shown_by
def _observe_row() -> Exemplars:
    for label, task in exemplar_tasks():
        row, memory = np.zeros(1, dtype=np.int64), new_workspace(period_shapes(task))
        yield label, (Structures([task]), make_batch(task, 1), row, memory)


@observe_states.shown_by
def _observe_states() -> Exemplars:
    for label, task in exemplar_tasks():
        p = np.zeros((2, task.model.at.end))
        reference = circle_reference(load_params(), task.model, p[0])
        obs, memory = np.zeros((2, len(task.bound))), new_workspace(period_shapes(task))
        yield label, (task, reference, np.zeros(2), p, p, memory, obs, np.zeros(N_SIGNALS))


@advance_plant.shown_by
def _advance_plant() -> Exemplars:
    for label, task in exemplar_tasks():
        p, memory = np.zeros(task.model.at.end), new_workspace(step_shapes(task.model))
        yield label, (task.model, p, p, p, 0.0, 1, 0, memory)


@evaluate.shown_by
def _evaluate() -> Exemplars:
    for label, task in exemplar_tasks():
        p, memory = np.zeros(task.model.at.end), new_workspace(step_shapes(task.model))
        yield label, (task.model, p, p, p, memory.dynamics, p, False)
