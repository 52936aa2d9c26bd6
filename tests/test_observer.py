"""What a law makes of its measurements: delay, noise and lasting errors."""

import numpy as np
import pytest

from sffr_baselines.control_law import make_states, state_at
from sffr_baselines.laws import LawPolicy, make_law
from sffr_baselines.observer import ANGLE, estimate, integrate, make_observer, tracked_errors
from sffr_baselines.rollout import STRIDE, result_of, rollout, true_observations
from sffr_gym.config.params import load_params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.initial import initial_positions
from sffr_gym.physics.kinematics import arm_points
from sffr_gym.physics.model import pack
from sffr_gym.task.observation import observation_fields, observation_index
from sffr_gym.task.reference import path_reference

LEVELS = {"position": 1.0e-4, "angle": 1.0e-4, "velocity": 5.0e-4, "rate": 5.0e-4}
NOISE = str(LEVELS | {"acceleration": 0.3, "angular_acceleration": 0.3}).replace("'", "")
TANGENT = ["path.heading=tangent", "initial.qd=null"]


def designed(*overrides):
    """The observer of the case study, and what it tracks."""
    params = load_params().with_overrides(*overrides)
    model = pack(params)
    reference = path_reference(params, model, initial_positions(params, model)[0])
    at = observation_index(observation_fields(model, params))
    return make_observer(params, model, reference, at), tracked_errors(model, reference, at), at


@pytest.fixture
def delayed(user_scenario):
    """A scenario whose sensors lag a period, without noise."""
    return user_scenario(duration=1.0, sensors={"delay": 1.0})


def law(name, env, *overrides):
    return LawPolicy(name, make_law(name, env.params.with_overrides(*overrides)))


@pytest.mark.parametrize("overrides", [[], TANGENT], ids=["fixed heading", "tangent heading"])
@pytest.mark.parametrize(("share", "found"), [(1.0, 1.0), (0.0, 0.0)])
def test_the_second_observation_tells_of_a_lag(user_scenario, share, found, overrides):
    """With the noise of the shipped scenario, at any phase of the circle."""
    scenario = user_scenario(duration=1.0, random_phase=True, sensors=LEVELS | {"delay": share})
    env = SFFRFlexEnv(scenario, overrides=overrides)
    policy = law("ahsc-ff", env)
    for seed in range(25):
        obs, _ = env.reset(seed=seed)
        policy.reset()
        for _ in range(3):
            assert policy.states is None or policy.states.late[0, 0] == (found if policy.tick > 1 else 0.0)
            obs, *_ = env.step(policy(obs))
        assert policy.states.late[0, 0] == found


@pytest.mark.parametrize("overrides", [[], TANGENT], ids=["fixed heading", "tangent heading"])
def test_a_lag_costs_micrometres_instead_of_millimetres(delayed, overrides):
    """The path's speed times a period is 1.7 mm, which the paper's law takes for an error."""
    env = SFFRFlexEnv(delayed, overrides=overrides)
    errors = {name: result_of(rollout(env, law(name, env), 0)).measures["track_rmse"] for name in ("ahsc", "ahsc-ff")}
    assert errors["ahsc"] > 0.5e-3
    assert errors["ahsc-ff"] < 10e-6


def test_without_lag_nothing_changes(user_scenario):
    """Compensation that finds no lag acts on what is measured, bit for bit."""
    env = SFFRFlexEnv(user_scenario(duration=0.5, offset_position=0.1))
    runs = [rollout(env, law("ahsc", env, f"control.delay_compensation={on}"), 3) for on in ("false", "true")]
    np.testing.assert_array_equal(runs[0].p, runs[1].p)


def test_the_gain_is_the_least_variance():
    """Of a double integrator under white acceleration, the steady filter's error is the Riccati equation's."""
    observer, tracked, _ = designed(f"control.observer={NOISE}")
    rng, T = np.random.default_rng(0), observer.period
    for k, (sigma, rate) in ((0, (1e-4, 5e-4)), (2, (1e-4, 5e-4))):
        assert tracked[k].axis == (0 if k == 0 else 2)
        spread = {}
        for factor in 0.7, 1.0, 1.4:
            L, n = factor * observer.gain[k], 4000
            x, guess, left = np.zeros((2, n)), np.zeros((2, n)), []
            A, G = np.array([[1.0, T], [0.0, 1.0]]), np.array([T**2 / 2.0, T])
            for step in range(400):
                x = A @ x + np.outer(G, 0.3 * rng.standard_normal(n))
                expected = A @ guess
                y = x + np.array([[sigma], [rate]]) * rng.standard_normal((2, n))
                guess = expected + L @ (y - expected)
                if step > 200:
                    left.append(np.mean((guess - x) ** 2, axis=1))
            spread[factor] = np.mean(left, axis=0) / [sigma**2, rate**2]
        assert (spread[1.0] < spread[0.7]).all() and (spread[1.0] < spread[1.4]).all()


def test_the_filter_calms_the_joints(user_scenario):
    """With noise, a filtered law moves the motors less, and pays with half as much error more."""
    env = SFFRFlexEnv(user_scenario(duration=5.0, sensors=LEVELS))
    plain, filtered = (result_of(rollout(env, law(name, env), 0)).measures for name in ("lqr-ff", "lqr-kf"))
    assert filtered["joint_effort"] < 0.7 * plain["joint_effort"]
    assert filtered["thruster_impulse"] < 0.8 * plain["thruster_impulse"]
    assert filtered["track_rmse"] < 1.6 * plain["track_rmse"]


def test_integral_action_removes_a_lasting_error(user_scenario):
    """A heavier object than believed pulls outward all along the circle."""
    env = SFFRFlexEnv(user_scenario(duration=20.0, plant={"object": [2.0, 2.0]}))
    errors = {name: result_of(rollout(env, law(name, env), 0)).measures["track_rmse"] for name in ("ahsc", "ahsc-ff")}
    assert errors["ahsc-ff"] < 0.15 * errors["ahsc"]


def test_integrals_stay_while_an_actuator_saturates(user_scenario):
    """Far off the path the thrusters give all they have, and nothing winds up."""
    env = SFFRFlexEnv(user_scenario(duration=5.0, offset_position=0.5), overrides=["actuators.thruster_force=5"])
    policy = law("ahsc-ff", env)
    obs, _ = env.reset(seed=5)
    for _ in range(100):
        action = policy(obs)
        assert np.abs(action[6:8]).max() > 1.0
        assert not policy.states.integral.any()
        obs, *_ = env.step(action)


def test_what_is_tracked():
    """Base, both grippers and the object, each at its place in the formation."""
    observer, tracked, at = designed()
    assert [each.error for each in tracked] == [
        *range(at.base_error, at.base_error + 2), at.yaw_error, *range(at.tip_error, at.tip_error + 4),
        *range(at.object_error, at.object_error + 2), at.object_angle_error,
    ]  # fmt: skip
    assert not (observer.filters or observer.compensates)
    assert [each.lever for each in tracked[-3:]] == [0.0, 0.0, 1.0]


def test_levers_are_those_of_the_formation_at_the_start():
    """A point that is carried at a place moves by ``turn x place``: base and grippers, seen from the object."""
    params = load_params().with_overrides("initial.q.2=0.4")
    model = pack(params)
    p = initial_positions(params, model)[0]
    _, tracked, _ = designed("initial.q.2=0.4")
    tips = [arm_points(model, p[:9], np.zeros(9), int(arm))[1].x for arm in model.grasp_arm]
    places = np.array([p[:2], *tips]) - p[model.at.object : model.at.object + 2]
    levers = [each.lever for each in tracked if each.axis != ANGLE][:6]
    np.testing.assert_allclose(levers, np.column_stack([-places[:, 1], places[:, 0]]).ravel(), rtol=0, atol=1e-12)
    assert np.abs(places).min() > 1e-3


def test_gains_that_are_unstable_are_refused():
    with pytest.raises(ConfigError, match=r"control\.Ki = 270000\.0: must be less than Kp Kd = 2\.7e\+05"):
        load_params().with_overrides("control.Ki=270000")
    with pytest.raises(ConfigError, match=r"control\.observer"):
        load_params().with_overrides("control.observer={position: 0.1}")


@pytest.mark.parametrize("late", [0.0, 1.0])
def test_the_prediction_is_the_error_law_of_a_period(late):
    """An estimate of a filter that trusts no measurement moves as edd = -(Kp e + Kd ed + Ki z), sensors late or not."""
    params = load_params().with_overrides(f"control.observer={NOISE}", "control.Ki=600")
    policy = LawPolicy("ahsc", make_law("ahsc", params))
    law = policy.law
    law = law._replace(observer=law.observer._replace(gain=np.zeros_like(law.observer.gain)))
    state, n_t, T = state_at(make_states(law, 1), 0), len(law.observer.error), params.control.period
    rng = np.random.default_rng(0)
    state.errors[:], state.integral[:] = rng.normal(size=(n_t, 2)), rng.normal(size=n_t)
    state.age[0], state.late[0] = 5.0, late
    e, ed, z = state.errors[:, 0].copy(), state.errors[:, 1].copy(), state.integral.copy()
    seen, obs = np.zeros(law.at.end), rng.normal(size=law.at.end)
    estimate(law.observer, law.gains, law.at, obs, state, seen)
    edd = -(900.0 * e + 300.0 * ed + 600.0 * z)
    np.testing.assert_allclose(seen[law.observer.error], e + T * ed + T**2 / 2.0 * edd, rtol=1e-12)
    np.testing.assert_allclose(seen[law.observer.rate], ed + T * edd, rtol=1e-12)


def test_the_filter_weighs_a_measurement_against_the_prediction():
    """Of sensors without lag: ``x + L (y - x)`` for an error and its rate together."""
    own = make_law("ahsc", load_params().with_overrides(f"control.observer={NOISE}"))
    state, T, rng = state_at(make_states(own, 1), 0), own.observer.period, np.random.default_rng(3)
    L = rng.uniform(0.1, 0.9, own.observer.gain.shape)
    own = own._replace(observer=own.observer._replace(gain=L))
    state.errors[:], state.age[0] = rng.normal(size=state.errors.shape), 5.0
    e, ed = state.errors.T.copy()
    edd = -(own.gains.Kp * e + own.gains.Kd * ed)
    expected = np.array([e + T * ed + T**2 / 2.0 * edd, ed + T * edd])
    seen, obs = np.zeros(own.at.end), rng.normal(size=own.at.end)
    estimate(own.observer, own.gains, own.at, obs, state, seen)
    gap = np.array([obs[own.observer.error], obs[own.observer.rate]]) - expected
    found = expected + np.einsum("kij,jk->ik", L, gap)
    np.testing.assert_allclose([seen[own.observer.error], seen[own.observer.rate]], found, rtol=1e-12)


@pytest.mark.parametrize("late", [0.0, 1.0])
def test_a_lag_is_what_explains_the_second_observation_better(late):
    """Errors that have moved rather with their own rates, or rather with the reference, which is twice as fast."""
    own = make_law("ahsc-ff", load_params())
    state, T = state_at(make_states(own, 1), 0), own.observer.period
    point = own.observer.axis != ANGLE
    errors, rates = own.observer.error[point], own.observer.rate[point]
    first, second, seen = np.zeros((3, own.at.end))
    for obs in (first, second):
        obs[rates] = 0.5
        obs[own.at.reference_velocity : own.at.reference_velocity + 2] = 1.0
    first[errors] = 0.2 * T
    second[errors] = first[errors] + T * (0.85 if late else 0.65)
    for obs in (first, second):
        estimate(own.observer, own.gains, own.at, obs, state, seen)
    assert state.late[0] == late


@pytest.mark.parametrize("overrides", [[], TANGENT], ids=["fixed heading", "tangent heading"])
def test_a_late_observation_is_brought_up_to_date(user_scenario, overrides):
    """What a compensating law sees is what sensors without lag would show, joints and panels included."""
    scenario = {"duration": 1.0, "offset_position": 0.02, "panel_modes": [{"mode": 1, "amplitude": [0.1, 0.1]}]}
    env = SFFRFlexEnv(user_scenario(**scenario, sensors={"delay": 1.0}), overrides=overrides)
    policy = law("ahsc", env, "control.delay_compensation=true")
    true, own = true_observations(rollout(env, policy, 2)), policy.law
    state, seen, gaps = state_at(make_states(own, 1), 0), np.zeros_like(true[0]), []
    obs, _ = env.reset(seed=2)
    policy.reset()
    for tick in range(400):
        estimate(own.observer, own.gains, own.at, obs, state, seen)
        if tick > 1 and tick % STRIDE == 0:
            gaps.append(np.abs([obs - true[tick // STRIDE], seen - true[tick // STRIDE]]))
        obs, *_ = env.step(policy(obs))
    late, corrected = np.max(gaps, axis=0)
    for name, least in {"base_error": 20, "tip_error": 20, "object_error": 20, "joint_angle": 5, "elastic": 5}.items():
        places = env.fields[name].slice
        assert corrected[places].max() < late[places].max() / least


@pytest.mark.parametrize("overrides", [[], ["path.kind=slew"]], ids=["circle", "slew"])
def test_a_late_measurement_is_an_error_of_a_period_ago(overrides):
    """Taken back by the reference's motion since, and moved on by the error law, to second order of the period."""
    policy = LawPolicy("ahsc-ff", make_law("ahsc-ff", load_params().with_overrides(*overrides)))
    own, rng = policy.law, np.random.default_rng(1)
    state, tracked, T = state_at(make_states(own, 1), 0), own.observer, own.observer.period
    obs = rng.normal(size=own.at.end)
    state.errors[:], state.age[0], state.late[0] = rng.normal(size=state.errors.shape), 5.0, 1.0
    e, ed, seen = state.errors[:, 0].copy(), state.errors[:, 1].copy(), np.zeros_like(obs)
    estimate(own.observer, own.gains, own.at, obs, state, seen)
    point = tracked.axis != ANGLE
    axis = np.where(point, tracked.axis, 0)
    speed = np.where(point, obs[own.at.reference_velocity + axis], 0.0) + obs[own.at.reference_turn] * tracked.lever
    acceleration = np.where(point, obs[own.at.reference_acceleration + axis], 0.0)
    if overrides:  # a circle is turned along evenly
        acceleration = acceleration + obs[own.at.reference_turn_acceleration] * tracked.lever
    y = obs[tracked.error] - T * speed + 0.5 * T**2 * acceleration
    yd = obs[tracked.rate] - T * acceleration
    edd = -(own.gains.Kp * e + own.gains.Kd * ed)
    np.testing.assert_allclose(seen[tracked.error], y + T * yd + 0.5 * T**2 * edd, rtol=1e-12)
    np.testing.assert_allclose(seen[tracked.rate], yd + T * edd, rtol=1e-12)


@pytest.mark.parametrize("saturated", [False, True])
def test_integrals_are_those_of_the_errors(saturated):
    own = make_law("ahsc-ff", load_params())
    state, seen = (
        state_at(make_states(own, 1), 0),
        np.random.default_rng(2).normal(size=own.at.end),
    )
    integrate(own.observer, seen, saturated, state)
    integrate(own.observer, seen, saturated, state)
    expected = 0.0 if saturated else 2.0 * own.observer.period * seen[own.observer.error]
    np.testing.assert_allclose(state.integral, expected, rtol=1e-14)
