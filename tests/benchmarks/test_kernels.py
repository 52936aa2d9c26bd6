"""Times of the kernels, for comparison with earlier runs (``make bench``); what is asserted is that they ran.

A test's own time is that of one call from Python, which handles hundreds of control periods.
"""

import numpy as np
import pytest

from sffr_baselines import make_policy
from sffr_baselines.closed_loop import act, make_record
from sffr_baselines.control_law import law_shapes, make_states
from sffr_gym.compile.arguments import Structures
from sffr_gym.compile.workspace import new_workspace
from sffr_gym.envs.batch import group_memory, group_shapes, make_batch, put_episode, step_range
from sffr_gym.physics.dynamics import work_shapes
from sffr_gym.physics.integrator import INTEGRATORS, step_shapes
from sffr_gym.task.control_period import observe_states, period_shapes
from sffr_gym.task.episode import draw, nominal
from sffr_gym.task.scenario import load_scenario
from sffr_gym.task.signals import N_SIGNALS
from sffr_gym.task.status import RUNNING
from sffr_workbench.speed.circle import Loop, close_loop, make_course
from sffr_workbench.speed.kernels.loops import replay, solve_motion

PERIODS = 500


@pytest.fixture(scope="module")
def course():
    return make_course(PERIODS * 2.0e-3)


@pytest.fixture(scope="module")
def forces(course):
    return close_loop(course)


@pytest.mark.parametrize(("integrator", "steps"), [("etdrk4", 1), ("rk4", 4)])
def test_integration(benchmark, course, forces, integrator, steps):
    model, period, work = course.plant.model, course.plant.period, new_workspace(step_shapes(course.plant.model))
    p, v, kept = course.p.copy(), course.v.copy(), np.zeros((1, len(course.p)))
    call = replay.bind(model, forces, period, steps, INTEGRATORS[integrator], work, p, v, PERIODS, kept)

    def periods():
        p[:], v[:] = course.p, course.v
        call()

    benchmark(periods)
    assert np.abs(kept[0] - course.p).max() > 0.1


def test_equations_of_motion(benchmark, course, forces):
    out, work = np.zeros(len(course.p)), new_workspace(work_shapes(course.plant.model))
    benchmark(solve_motion.bind(course.plant.model, course.p.copy(), course.v, forces[0], work, out, PERIODS))
    assert np.isfinite(out).all() and out.any()


def test_observation(benchmark, course):
    plant, rows, signals = course.plant, (PERIODS, 1), np.zeros(N_SIGNALS)
    t, p, v = plant.period * np.arange(PERIODS), np.tile(course.p, rows), np.tile(course.v, rows)
    obs, work = np.zeros((PERIODS, len(course.obs))), new_workspace(period_shapes(plant))
    benchmark(observe_states.bind(plant, course.reference, t, p, v, work, obs, signals))
    assert np.isfinite(obs).all() and obs.any(axis=1).all()


def test_control_law(benchmark, course):
    policy = make_policy("ahsc", course.params)
    obs, actions = np.tile(course.obs, (PERIODS, 1)), np.zeros((PERIODS, len(course.plant.scale)))
    law, tick = policy.law, np.zeros(1, dtype=np.int64)
    benchmark(act.bind(law, tick, obs, make_states(law, PERIODS), actions, new_workspace(law_shapes(law))))
    assert np.isfinite(actions).all() and actions.any()


def test_closed_loop(benchmark, course):
    policy, record = make_policy("ahsc", course.params), make_record(course.plant, course.ticks, 1)
    assert benchmark(Loop(course, course.plant, policy.law, record)) == (PERIODS, RUNNING)


def test_batch(benchmark, course):
    plants, batch, rng = Structures([course.plant]), make_batch(course.plant, PERIODS), np.random.default_rng(0)
    for i in range(PERIODS):
        put_episode(batch, i, draw(load_scenario("excited"), nominal(course.params), rng))
    actions, active = np.zeros((PERIODS, len(course.plant.scale))), np.ones(PERIODS, dtype=np.bool_)
    memory = group_memory(group_shapes(course.plant), 1)
    benchmark(step_range.bind(plants, batch, actions, active, *memory, 0, PERIODS))
    assert (batch.tick > 0).all()
