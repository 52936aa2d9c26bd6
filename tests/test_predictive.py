"""Model predictive control: the regulator where nothing binds, and the optimum under the limits where they do."""

from functools import cache

import numpy as np
import pytest
from scipy.linalg import block_diag, solve_discrete_are

import sffr_baselines.damping_env
from sffr_baselines import make_policy
from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv
from sffr_baselines.laws import LawPolicy, make_law
from sffr_baselines.panel_reaction import BENDING
from sffr_baselines.predictive import BLOCKS, alike, cycle_hold, make_predictive, plan_shapes, predict, problem
from sffr_baselines.regulator import sampled_panel, worth_of_effort
from sffr_baselines.rollout import result_of, rollout
from sffr_baselines.scheduled import scheduled_law
from sffr_baselines.settings import load_settings
from sffr_gym.compile.workspace import new_workspace
from sffr_gym.config.params import load_params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.physics.actuators import pack_actuators
from sffr_gym.physics.beam import one_element_beam
from sffr_gym.physics.model import pack
from sffr_gym.task.scenario import load_scenario
from sffr_gym.task.score import costs
from sffr_gym.task.signals import VIBRATION

WEAK = ["actuators.piezo.force=0.04", "actuators.piezo.moment=0.04"]
PATCHES = ["actuators.piezo.array=patches"]
LIMIT = 200.0


@cache
def designed(*overrides):
    """Robot, tip forces of a volt, problem, and what the regulator minimises: Q, R and the sampled panel."""
    params = load_params().with_overrides(*overrides)
    K_PZ = pack_actuators(params, pack(params)).K_PZ
    weights, panel = load_settings("lqr"), one_element_beam(params.panel)
    effort = weights.effort * worth_of_effort(params, K_PZ[0], weights.swing)
    M, K = panel.M_ff[BENDING, BENDING], panel.K[BENDING, BENDING]
    A, G = sampled_panel(M, params.panel.strain_rate_damping * K, K, params.control.period)
    law = make_predictive(params, K_PZ, weights)
    return params, K_PZ, law, effort, (A, G @ K_PZ[0, BENDING], block_diag(K, M) / 2.0)


def swing(seed):
    """A deviation [q5, q6, their rates] of a panel that swings by up to 0.3 m."""
    rng = np.random.default_rng(seed)
    return np.array([0.3, 0.1, 0.2, 0.1]) * rng.uniform(-1.0, 1.0, 4)


def volts_of(law, gain, x, last=0.0):
    """The volts of a panel at a deviation, from the kernel; last: all unknowns of the solution before."""
    volts, plan = -gain @ x, np.full(law.scale.shape[1], last)
    predict(law, 0, x, 0.0, plan, new_workspace(plan_shapes(law)), volts)
    return volts


@pytest.mark.parametrize("overrides", [WEAK, PATCHES], ids=["weak", "patches"])
def test_the_problem_is_the_cost_of_all_time_to_come(overrides):
    """Held deviations from the regulator's volts, period by period, the regulator after them: x'Px + d'Hd."""
    params, K_PZ, _, effort, (A, G, Q) = designed(*overrides)
    n_c, hold = G.shape[1], 3
    R = effort * np.eye(n_c)
    P = solve_discrete_are(A, G, Q, R)
    gain = np.linalg.solve(R + G.T @ P @ G, G.T @ P @ A)
    hessian, regulator = problem(params, K_PZ[0], R, hold)
    start, d = swing(1), np.random.default_rng(2).normal(0.0, 100.0, (len(BLOCKS), n_c))
    x, own, total, means = start, start, 0.0, []
    for block, holds in enumerate(BLOCKS):
        mean = 0.0
        for _ in range(holds * hold):
            volts = d[block] - gain @ own
            mean = mean - gain @ own / (holds * hold)
            total += x @ Q @ x + volts @ R @ volts
            x, own = A @ x + G @ volts, (A - G @ gain) @ own
        means.append(mean)
    total += x @ P @ x
    assert total == pytest.approx(start @ P @ start + d.ravel() @ hessian @ d.ravel(), rel=1e-8)
    np.testing.assert_allclose(regulator @ start, np.ravel(means), rtol=1e-8, atol=1e-8 * np.abs(means).max())


@pytest.mark.parametrize("overrides", [WEAK, PATCHES], ids=["weak", "patches"])
def test_the_solution_is_osqps(overrides):
    """With an unknown for each channel, as if none were alike, at states that drive channels to their limits."""
    osqp = pytest.importorskip("osqp")
    from scipy.sparse import csc_matrix, eye_array

    params, K_PZ, law, effort, (A, G, Q) = designed(*overrides)
    R = effort * np.eye(G.shape[1])
    P = solve_discrete_are(A, G, Q, R)
    gain = np.linalg.solve(R + G.T @ P @ G, G.T @ P @ A)
    hessian, regulator = problem(params, K_PZ[0], R, law.hold)
    s = 1.0 / np.sqrt(np.diag(hessian))
    even, bound = csc_matrix(s[:, None] * hessian * s), 0
    for seed in range(6):
        x = swing(seed)
        mean, solver = regulator @ x, osqp.OSQP()
        solver.setup(
            even, np.zeros(len(s)), csc_matrix(eye_array(len(s))), (-LIMIT - mean) / s, (LIMIT - mean) / s,
            eps_abs=1e-9, eps_rel=1e-9, max_iter=100_000, polishing=True, verbose=False,
        )  # fmt: skip
        expected = np.clip(-gain @ x + (s * solver.solve(raise_error=True).x)[: G.shape[1]], -LIMIT, LIMIT)
        np.testing.assert_allclose(volts_of(law, gain, x), expected, atol=1e-3)
        bound += np.abs(expected - np.clip(-gain @ x, -LIMIT, LIMIT)).max() > 1.0
    assert bound > 2, "limits must make a difference"
    small = 1.0e-3 * swing(0)
    np.testing.assert_array_equal(
        volts_of(law, gain, small, 0.1), -gain @ small, "no search where no limit is in reach"
    )


def test_channels_that_bend_alike_are_one_unknown():
    """The faces of a pair pull against each other; what acts along the panel has no part."""
    assert alike(designed(*PATCHES)[1][0]).tolist() == np.kron(np.eye(4), [[1.0], [-1.0]]).tolist()
    assert alike(designed(*WEAK)[1][0]).tolist() == [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
    assert alike(np.zeros((3, 2))).shape == (2, 0)


def test_without_limits_in_reach_it_is_the_regulator():
    """With the weights of lqr, in the closed loop, period by period; the limits of Table III are never in reach."""
    env = SFFRFlexEnv("excited")
    lqr = make_policy("lqr-ff", env)
    mpc = LawPolicy("mpc", make_law("mpc", env.params, load_settings("lqr")))
    assert mpc.law.predictive.hold > 0
    obs, _ = env.reset(seed=5)
    for _ in range(100):
        action = mpc(obs)
        np.testing.assert_allclose(action, lqr(obs), rtol=1e-9, atol=1e-12)
        obs = env.step(action)[0]


@pytest.mark.parametrize("scenario", ["weak", "patches"])
def test_it_keeps_the_limits_and_costs_less_than_a_regulator_that_runs_into_them(scenario):
    """The same weights, the same start."""
    env = SFFRFlexEnv(scenario)
    weights = load_settings("lqr")
    results = {}
    for name in "ahsc", "lqr-ff", "mpc":
        law = make_law(name, env.params, weights if name == "mpc" else None)
        results[name] = [result_of(rollout(env, LawPolicy(name, law), seed)) for seed in range(2)]
    found = costs(results)
    assert found["mpc"] < found["lqr-ff"] < found["ahsc"]
    obs, _ = env.reset(seed=0)
    policies = [LawPolicy(name, make_law(name, env.params, weights)) for name in ("lqr-ff", "mpc")]
    n_volts = env.plant_task.actuators.at.thrust
    wild = calm = 0.0
    for _ in range(50):
        actions = [np.abs(policy(obs)[:n_volts]).max() for policy in policies]
        wild, calm = max(wild, actions[0]), max(calm, actions[1])
        obs = env.step(policies[1](obs))[0]
    assert calm <= 1.0 < wild


def test_a_cheap_price_does_not_break_it():
    """Where a regulator that is priced far too low runs into its limits all the time, the prediction holds."""
    env = SFFRFlexEnv("weak")
    cheap = load_settings("lqr").model_copy(update={"effort": 0.03})
    vibration = {}
    for name in "lqr-ff", "mpc":
        law = make_law(name, env.params, cheap)
        vibration[name] = result_of(rollout(env, LawPolicy(name, law), 1)).measures["vibration"]
    assert vibration["mpc"] < 0.8 * vibration["lqr-ff"]


@pytest.mark.parametrize("overrides", [[], ["panel.EI=2000"], ["control.period=5.0e-4"], ["panel.length=0.5"]])
def test_a_solution_is_held_for_a_part_of_a_swing(overrides):
    """Of the first mode: w = 3.53 sqrt(EI / (rho a L^4)) by one element; never less than a period."""
    params = load_params().with_overrides(*overrides)
    panel = params.panel
    omega = 3.5327 * np.sqrt(panel.EI / (panel.mass / panel.length * panel.length**4))
    expected = max(1, round(2.0 * np.pi / omega / 480 / params.control.period))
    assert cycle_hold(params) == expected


def test_robots_without_panels_or_bending_channels_have_no_prediction():
    assert make_law("mpc", load_params().with_overrides("panel.mounts=[]")).predictive.hold == 0


@pytest.mark.parametrize("name", ["mpc", "ppf"])
@pytest.mark.parametrize("scenario", ["weak", "patches"])
def test_stepping_a_batch_gives_the_trajectories_of_the_compiled_loop(name, scenario, user_scenario):
    """Whether alone in the compiled loop or many through the interface."""
    keys = load_scenario(scenario).model_dump(mode="json", exclude={"name", "description"})
    file = user_scenario("short", **keys | {"duration": 0.5})
    batch, alone = SFFRFlexVectorEnv(3, scenario=file), SFFRFlexEnv(file)
    policy = make_policy(name, batch)
    obs, _ = batch.reset(seed=20)
    tips = []
    for _ in range(250):
        obs, *_, infos = batch.step(policy(obs))
        tips.append(infos["vibration"])
    for i in range(3):
        one = rollout(alone, make_policy(name, alone), 20 + i)
        np.testing.assert_array_equal(np.array(tips)[:, i], one.signals[:, VIBRATION])


def test_it_runs_in_lanes_as_alone(monkeypatch):
    """Prediction and filters, together with a law whose damping an agent schedules, bit for bit."""

    def both(prior, *arguments):
        mpc, ppf = make_law("mpc", prior), make_law("ppf", prior)
        law = scheduled_law(prior, *arguments)
        return law._replace(regulator=mpc.regulator, predictive=mpc.predictive, filters=ppf.filters)

    monkeypatch.setattr(sffr_baselines.damping_env, "scheduled_law", both)
    batch = SFFRFlexDampingVectorEnv(9, scenario="weak", duration=1.0)
    first, _ = batch.reset(seed=40)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (10, *batch.action_space.shape)).astype(np.float32)
    together = [first] + [batch.step(each)[0] for each in actions]
    planned = 0
    for i in range(9):
        env = SFFRFlexDampingEnv("weak", duration=1.0)
        alone = [env.reset(seed=40 + i)[0]] + [env.step(each[i])[0] for each in actions]
        np.testing.assert_array_equal(alone, [each[i] for each in together])
        for name, array in env._damping.law._asdict().items():
            np.testing.assert_array_equal(getattr(batch._damping.law, name)[i], array[0])
        planned += env._damping.law.plan.any()
        assert env._damping.law.filters.all()
    assert 0 < planned
