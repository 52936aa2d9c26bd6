"""The forms of arguments for which the entries of this package are compiled; see :mod:`sffr_gym.envs.exemplars`."""

from __future__ import annotations

import numpy as np

from sffr_baselines.closed_loop import act, loop_shapes, make_record, run
from sffr_baselines.control_law import Law, law_shapes, make_states
from sffr_baselines.damping_loop import damping_range, decision_shapes, make_damping, see_range
from sffr_baselines.laws import make_law
from sffr_baselines.schedule import decisions_of_panel
from sffr_gym.compile.lanes import WIDTH
from sffr_gym.compile.workspace import new_workspace
from sffr_gym.config.params import load_params
from sffr_gym.envs.exemplars import PLAIN, Exemplars, exemplar_groups, exemplar_task
from sffr_gym.physics.actuators import state_size
from sffr_gym.task.disturbances import Impulses, Sensing


def _law() -> Law:
    return make_law("ahsc", load_params())


@act.shown_by
def _act() -> Exemplars:
    task = exemplar_task()
    law, obs = _law(), np.zeros((2, len(task.bound)))
    actions, memory = np.zeros((2, len(law.scale))), new_workspace(law_shapes(law))
    yield PLAIN, (law, np.zeros(1, dtype=np.int64), obs, make_states(law, 2), actions, memory)


@run.shown_by
def _run() -> Exemplars:
    task = exemplar_task()
    law, p, obs = _law(), np.zeros(task.model.at.end), np.zeros(len(task.bound))
    sensing, impulses = Sensing(obs, 0, 0, obs, 0), Impulses(np.zeros(1, dtype=np.int64), np.zeros((1, 3)))
    states, work = make_states(law, 1), new_workspace(loop_shapes(task, law))
    episode = task, law.reference, sensing, impulses
    yield (
        PLAIN,
        (
            *episode,
            law,
            work,
            0,
            1,
            p,
            p,
            np.zeros(state_size(len(law.scale))),
            obs,
            states,
            make_record(task, 2, 1),
            np.zeros(2),
        ),
    )


@see_range.shown_by
def _see_range() -> Exemplars:
    task = exemplar_task()
    law, obs = _law(), np.zeros((2, len(task.bound)))
    yield PLAIN, (law, make_damping(law, 2), obs, np.ones(2, dtype=np.bool_), 0, 2)


@damping_range.shown_by
def _damping_range() -> Exemplars:
    law = _law()
    for label, batched, memory in exemplar_groups(lambda task: decision_shapes(task, law)):
        damping, active = make_damping(law, WIDTH), np.ones(WIDTH, dtype=np.bool_)
        decisions = np.zeros((WIDTH, len(law.allocation) * decisions_of_panel(law)))
        yield label, (*batched, law, damping, decisions, active, *memory, 0, WIDTH)
