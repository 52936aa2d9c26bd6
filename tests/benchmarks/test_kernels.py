"""Times of the kernels, for comparison with earlier runs (``make bench``); what is asserted is that they ran.

A test's own time is that of one call from Python, which handles hundreds of control periods.
"""

import numpy as np
import pytest

from sffr_baselines import make_policy
from sffr_baselines.closed_loop import act, act_shapes, loop_shapes, make_record
from sffr_gym.compile.workspace import allocate
from sffr_gym.envs.batch import batch_memory, make_batch, start_episode, step_range
from sffr_gym.envs.fleet import make_fleet
from sffr_gym.physics.dynamics import work_shapes
from sffr_gym.physics.integrator import INTEGRATORS, step_shapes
from sffr_gym.task.control_period import period_shapes
from sffr_gym.task.episode import draw, nominal
from sffr_gym.task.scenario import load_scenario
from sffr_gym.task.signals import N_SIGNALS
from sffr_gym.task.status import RUNNING
from sffr_workbench.speed.circle import close_loop, make_course
from sffr_workbench.speed.kernels.loops import observe_often, replay, solve_motion

PERIODS = 500


@pytest.fixture(scope="module")
def course():
    return make_course(PERIODS * 2.0e-3)


@pytest.fixture(scope="module")
def forces(course):
    return close_loop(course)


@pytest.mark.parametrize(("integrator", "steps"), [("etdrk4", 1), ("rk4", 4)])
def test_integration(benchmark, course, forces, integrator, steps):
    model, period, work = course.plant.model, course.plant.period, allocate(step_shapes(course.plant.model))[0]
    kept = np.zeros((1, len(course.p)))

    def periods():
        kernel = INTEGRATORS[integrator]
        replay(model, forces, period, steps, kernel, work, course.p.copy(), course.v.copy(), PERIODS, kept)

    benchmark(periods)
    assert np.abs(kept[0] - course.p).max() > 0.1


def test_equations_of_motion(benchmark, course, forces):
    out = np.zeros(len(course.p))
    work = allocate(work_shapes(course.plant.model))[0]
    benchmark(lambda: solve_motion(course.plant.model, course.p.copy(), course.v, forces[0], work, out, PERIODS))
    assert np.isfinite(out).all() and out.any()


def test_observation(benchmark, course):
    obs, signals, buffers = np.zeros(len(course.obs)), np.zeros(N_SIGNALS), allocate(period_shapes(course.plant))[0]
    benchmark(lambda: observe_often(course.plant, course.reference, course.p, course.v, buffers, obs, signals, PERIODS))
    assert np.isfinite(obs).all() and obs.any()


def test_control_law(benchmark, course):
    policy = make_policy("ahsc", course.params)
    obs, actions = np.tile(course.obs, (PERIODS, 1)), np.zeros((PERIODS, len(course.plant.scale)))
    B_hat = np.tile(policy.initial_damping(), (PERIODS, 1, 1))
    block = allocate(act_shapes(policy.law))[0]
    benchmark(lambda: act(policy.law, 0, obs, B_hat, np.ones_like(B_hat), actions, block))
    assert np.isfinite(actions).all() and actions.any()


def test_closed_loop(benchmark, course):
    policy, record = make_policy("ahsc", course.params), make_record(course.plant, course.ticks, 1)
    block = allocate(loop_shapes(course.plant, policy.law))[0]
    assert benchmark(lambda: course.control(course.plant, policy.law, block, record)) == (PERIODS, RUNNING)


def test_batch(benchmark, course):
    fleet, batch, rng = make_fleet(course.plant), make_batch(course.plant, PERIODS), np.random.default_rng(0)
    memory = batch_memory(course.plant, PERIODS)
    for i in range(PERIODS):
        start_episode(fleet, batch, memory, i, draw(load_scenario("excited"), nominal(course.params), rng))
    actions, active = np.zeros((PERIODS, len(course.plant.scale))), np.ones(PERIODS, dtype=np.bool_)
    benchmark(lambda: step_range(fleet, batch, actions, active, memory.plain[0], memory.plain[0], 0, PERIODS))
    assert (batch.tick > 0).all()
