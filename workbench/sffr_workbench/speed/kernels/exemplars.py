"""The forms of arguments for which the timed loops are compiled; see :mod:`sffr_gym.envs.exemplars`."""

from __future__ import annotations

import numpy as np

from sffr_gym.compile.workspace import new_workspace
from sffr_gym.envs.exemplars import PLAIN, Exemplars, exemplar_task
from sffr_gym.physics.integrator import step_shapes
from sffr_workbench.speed.kernels.loops import (
    cosine,
    divide,
    forces_of,
    multiply_add,
    multiply_add_chain,
    replay,
    solve_motion,
    square_root,
)


@replay.shown_by
def _replay() -> Exemplars:
    model = exemplar_task().model
    p, rows, work = np.zeros(model.at.end), np.zeros((1, model.at.end)), new_workspace(step_shapes(model))
    yield PLAIN, (model, rows, 1.0, 1, 0, work, p, p, 1, rows)


@forces_of.shown_by
def _forces_of() -> Exemplars:
    plant = exemplar_task()
    commands = np.zeros((1, len(plant.scale)))
    yield PLAIN, (plant.model, plant.actuators, commands, commands, np.zeros((1, plant.model.at.end)))


@solve_motion.shown_by
def _solve_motion() -> Exemplars:
    model = exemplar_task().model
    p, work = np.zeros(model.at.end), new_workspace(step_shapes(model))
    yield PLAIN, (model, p, p, p, work.dynamics, p, 1)


def _operations() -> Exemplars:
    yield PLAIN, (np.zeros(1), 1.0, 1.0, 1)


for _loop in multiply_add, multiply_add_chain, divide, square_root, cosine:
    _loop.shown_by(_operations)
