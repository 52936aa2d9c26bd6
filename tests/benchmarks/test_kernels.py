"""Times of the kernels, for comparison with earlier runs (``make bench``); what is asserted is that they ran.

A test's own time is that of one call from Python, which handles hundreds of control periods.
"""

import numpy as np
import pytest

from agents.bench.circle import close_loop, make_course, make_record
from agents.bench.kernels.loops import observe_often, replay, solve_motion
from baselines import make_policy
from baselines.closed_loop import act
from sffr_gym.batch import make_batch, start_episode, step_range
from sffr_gym.episode import draw, nominal
from sffr_gym.fleet import make_fleet
from sffr_gym.integrator import INTEGRATORS, step_workspace
from sffr_gym.scenario import load_scenario
from sffr_gym.task import N_SIGNALS, RUNNING, make_buffers

PERIODS = 500


@pytest.fixture(scope="module")
def course():
    return make_course(PERIODS * 2.0e-3)


@pytest.fixture(scope="module")
def forces(course):
    return close_loop(course)


@pytest.mark.parametrize(("integrator", "steps"), [("etdrk4", 1), ("rk4", 4)])
def test_integration(benchmark, course, forces, integrator, steps):
    model, period, work = course.robot.model, course.robot.period, step_workspace(course.robot.model)
    kept = np.zeros((1, len(course.p)))

    def periods():
        kernel = INTEGRATORS[integrator]
        replay(model, forces, period, steps, kernel, work, course.p.copy(), course.v.copy(), PERIODS, kept)

    benchmark(periods)
    assert np.abs(kept[0] - course.p).max() > 0.1


def test_equations_of_motion(benchmark, course, forces):
    out = np.zeros(len(course.p))
    work = make_buffers(course.robot).step.dynamics
    benchmark(lambda: solve_motion(course.robot.model, course.p.copy(), course.v, forces[0], work, out, PERIODS))
    assert np.isfinite(out).all() and out.any()


def test_observation(benchmark, course):
    obs, signals, buffers = np.zeros(len(course.obs)), np.zeros(N_SIGNALS), make_buffers(course.robot)
    benchmark(lambda: observe_often(course.robot, course.reference, course.p, course.v, buffers, obs, signals, PERIODS))
    assert np.isfinite(obs).all() and obs.any()


def test_control_law(benchmark, course):
    policy = make_policy("ahsc", course.params)
    obs, actions = np.tile(course.obs, (PERIODS, 1)), np.zeros((PERIODS, len(course.robot.scale)))
    B_hat = np.tile(policy.initial_damping(), (PERIODS, 1, 1))
    benchmark(lambda: act(policy.law, obs, B_hat, actions))
    assert np.isfinite(actions).all() and actions.any()


def test_closed_loop(benchmark, course):
    policy, buffers, record = make_policy("ahsc", course.params), make_buffers(course.robot), make_record(course)
    assert benchmark(lambda: course.control(course.robot, policy.law, buffers, record)) == (PERIODS, RUNNING)


def test_batch(benchmark, course):
    fleet, batch, rng = make_fleet(course.robot), make_batch(course.robot, PERIODS), np.random.default_rng(0)
    for i in range(PERIODS):
        start_episode(fleet, batch, i, draw(load_scenario("excited"), nominal(course.params), rng))
    actions, active = np.zeros((PERIODS, len(course.robot.scale))), np.ones(PERIODS, dtype=np.bool_)
    benchmark(lambda: step_range(fleet, batch, actions, active, 0, PERIODS))
    assert (batch.tick > 0).all()
