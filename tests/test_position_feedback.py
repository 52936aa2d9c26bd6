"""Positive position feedback: filters that lag a quarter of a cycle, in loops that are stable beyond what they know."""

from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import cont2discrete

from sffr_baselines import make_policy
from sffr_baselines.position_feedback import feed_back, make_position_feedback, sampled_filter
from sffr_baselines.rollout import result_of, rollout
from sffr_baselines.settings import FilterSettings, load_settings
from sffr_gym.config.params import load_params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.actuators import pack_actuators
from sffr_gym.physics.beam import beam
from sffr_gym.physics.model import pack, tip_rows

FINE = ["panel.bending_cut=1.0e9", "panel.axial_cut=1.0e9"]
ARRAYS = {
    "generalized": [],
    "weak": ["actuators.piezo.force=0.04", "actuators.piezo.moment=0.04"],
    "patches": ["actuators.piezo.array=patches"],
}
ONE_MODE = FilterSettings(gain=(0.3, 1.0e-6), damping=(0.4, 0.5), frequency=(1.1, 1.0), swing=1.0e-6)


@cache
def robot(*overrides):
    params = load_params().with_overrides(*overrides)
    model = pack(params)
    return params, model, pack_actuators(params, model)


def loop(law, model, actuators, period):
    """The step of a clamped panel of the plant and of the filters that see its tip: [modes, rates, filters, rates]."""
    n, w2 = len(model.omega2[0]), model.omega2[0]
    reach = actuators.reach[0] * actuators.gain[0]  # modal forces of a volt
    tip = tip_rows(model)[0][1:]  # q5, q6 of a unit of each mode
    rates = np.zeros((2 * n + reach.shape[1],) * 2)
    rates[:n, n : 2 * n], rates[n : 2 * n, :n] = np.eye(n), -np.diag(w2)
    rates[n : 2 * n, n : 2 * n], rates[n : 2 * n, 2 * n :] = -np.diag(model.damping[0]), reach
    panel = expm(period * rates)
    step = np.zeros((2 * n + 4, 2 * n + 4))
    step[: 2 * n, : 2 * n] = panel[: 2 * n, : 2 * n]
    step[: 2 * n, 2 * n :: 2] = panel[: 2 * n, 2 * n :] @ law.volts[0]
    for m in range(2):
        rows = slice(2 * n + 2 * m, 2 * n + 2 * m + 2)
        step[rows, rows] = law.step[0, m]
        step[rows, :n] = np.outer(law.push[0, m], law.modes[0, m] @ tip)
    return step


def growth(settings, believed, plant, factor=1.0):
    """Spectral radius of a period of the loop: filters made for a robot, on the panel of another."""
    params, _, own = robot(*believed)
    law = make_position_feedback(params, own.K_PZ, settings)
    law = law._replace(volts=factor * law.volts)
    _, model, actuators = robot(*plant)
    return np.abs(np.linalg.eigvals(loop(law, model, actuators, params.control.period))).max()


def test_sampled_filter_is_scipys():
    omega, zeta, period = 3.0, 0.4, 0.1
    system = np.array([[0.0, 1.0], [-(omega**2), -2.0 * zeta * omega]]), np.array([[0.0], [omega**2]])
    step, push, *_ = cont2discrete((*system, np.eye(2), np.zeros((2, 1))), period)
    found = sampled_filter(omega, zeta, period)
    np.testing.assert_allclose(found[0], step, rtol=1e-12)
    np.testing.assert_allclose(found[1], push[:, 0], rtol=1e-12)


def test_modes_are_those_of_the_clamped_panel():
    """Their amplitudes give the energy, and a held deflection ends as a push of its stiffness times the gain."""
    params, _, own = robot()
    law = make_position_feedback(params, own.K_PZ, FilterSettings(
        gain=(0.3, 0.2), damping=(0.5, 0.5), frequency=(1.0, 1.0), swing=1.0e-6))  # fmt: skip
    shape = beam(9.0, 4.0, 20.0, 9.6e7, 1)
    M, K = shape.M_ff[1:, 1:], shape.K[1:, 1:]
    x = np.array([0.1, -0.05, 9.0, 9.0])  # rates are not looked at
    assert np.sum((law.modes[0] @ x[:2]) ** 2) == pytest.approx(x[:2] @ M @ x[:2])
    filters, volts = np.zeros((2, 2)), np.zeros(3)
    for _ in range(40_000):
        volts = np.zeros(3)
        feed_back(law, 0, x, filters, volts)
    np.testing.assert_allclose(filters[:, 0], law.modes[0] @ x[:2], rtol=1e-8)
    # In modal coordinates K is diag(w^2): a force of g w^2 on each mode.
    amplitudes = law.modes[0]
    share = np.linalg.inv(amplitudes) @ np.diag([0.3, 0.2]) @ amplitudes
    np.testing.assert_allclose(volts[1:] * 47.5 / 200.0, K @ share @ x[:2], rtol=1e-7)
    assert abs(volts[0]) < 1.0e-12


@pytest.mark.parametrize("array", ARRAYS)
@pytest.mark.parametrize("elements", [1, 4, 8])
def test_the_loop_is_stable_beyond_the_modes_that_it_knows(array, elements):
    """Shipped settings, believed one element, on panels of more with all their modes."""
    settings, overrides = load_settings("ppf"), ARRAYS[array]
    plant = [*overrides, f"panel.elements={elements}", *FINE]
    assert growth(settings, overrides, plant) < 1.0
    assert growth(settings, overrides, [*plant, "panel.EI=14"]) < 1.0, "softer than believed"
    assert growth(settings, overrides, [*plant, "panel.EI=26"]) < 1.0, "stiffer"


def test_with_bonded_pairs_the_second_filter_is_left_out_since_it_would_feed_a_third_mode():
    """Their force and the measured motion are at different places, so that stability is not for nothing."""
    overrides, settings = (
        ARRAYS["patches"],
        load_settings("ppf").model_copy(update={"gain": (0.3, 0.3), "swing": 1.0e-6}),
    )
    plant = [*overrides, "panel.elements=4", *FINE]
    assert growth(settings, overrides, plant) < 1.0
    params, model, actuators = robot(*overrides)
    law = make_position_feedback(params, actuators.K_PZ, settings)
    assert not law.volts[..., 1].any() and law.volts[..., 0].all()
    both = law.volts.copy()
    modal = np.linalg.inv(law.modes[0]).T @ actuators.K_PZ[0, 1:]
    both[:, :, 1] = np.linalg.pinv(modal)[:, 1] * 0.3 * model.omega2[0, -1]
    _, fine, own = robot(*plant)
    assert np.abs(np.linalg.eigvals(loop(law._replace(volts=both), fine, own, params.control.period))).max() > 1.0


def test_it_is_stable_as_long_as_stiffness_is_left():
    """Collocated, the loop loses its stability where the filter takes all the stiffness of its mode (g = 1)."""
    assert growth(ONE_MODE, [], [], factor=0.99 / 0.3) < 1.0
    assert growth(ONE_MODE, [], [], factor=1.01 / 0.3) > 1.0


def test_filters_damp_their_modes():
    """The slowest pole of the loop decays in seconds; that of the panel by itself in a day."""
    period = load_params().control.period
    rate = -np.log(growth(load_settings("ppf"), [], [])) / period
    assert rate > 0.1 > 1.0e3 * -np.log(growth(load_settings("ppf"), [], [], factor=0.0)) / period


def test_weak_piezos_are_asked_for_no_more_than_they_have():
    """At the swing of the settings the first mode's filter just reaches the limit; strong ones keep their gains."""
    settings = load_settings("ppf").model_copy(update={"swing": 1.0})
    for overrides, bound in ((ARRAYS["weak"], True), ([], False)):
        params, _, own = robot(*overrides)
        law = make_position_feedback(params, own.K_PZ, settings)
        free = make_position_feedback(params, own.K_PZ, settings.model_copy(update={"swing": 1.0e-6}))
        amplitude = law.modes[0, 0] @ np.linalg.inv(law.modes[0])[:, 0] * settings.swing
        amplitude /= np.linalg.inv(law.modes[0])[0, 0]
        largest = np.abs(law.volts[0, :, 0]).max() * amplitude / (2.0 * settings.damping[0])
        assert (largest == pytest.approx(200.0)) == bound
        assert np.array_equal(law.volts, free.volts) == (not bound)


def test_rates_are_not_used():
    """Noise of them does not reach the piezos."""
    env = SFFRFlexEnv("excited")
    obs, _ = env.reset(seed=1)
    actions = []
    for rate in 0.0, 5.0:
        policy, seen = make_policy("ppf", env), obs.copy()
        seen[env.fields["elastic_rate"].slice] = rate
        for _ in range(20):
            action = policy(seen)
        actions.append(action[:6])
    np.testing.assert_array_equal(*actions)
    assert np.abs(actions[0]).max() > 0.0


@pytest.mark.parametrize("scenario", ["excited", "truth"])
def test_it_calms_the_robots_panels(scenario):
    """On the whole robot: a tenth of the vibration without it, as a mean over the circle."""
    env = SFFRFlexEnv(scenario)
    means = {name: result_of(rollout(env, make_policy(name, env), 2)).measures for name in ("none", "ppf", "ppf-ff")}
    assert means["ppf"]["vibration"] < 0.1 * means["none"]["vibration"]
    assert means["ppf-ff"]["track_rmse"] < 0.05 * means["ppf"]["track_rmse"]


def test_on_bonded_pairs_it_alone_bears_modes_that_nobody_knows():
    """With pairs near the root of a panel of four elements the other laws feed a third mode, up to their limits."""
    env = SFFRFlexEnv("patches", overrides=["panel.elements=4"])
    failures = {"ppf-ff": result_of(rollout(env, make_policy("ppf-ff", env), 1)).failure}
    for name in "ahsc", "lqr":
        with pytest.warns(UserWarning, match=f"{name} is unstable on .*mode"):
            policy = make_policy(name, env)
        failures[name] = result_of(rollout(env, policy, 1)).failure
    assert failures.pop("ppf-ff") == ""
    assert all("saturated actuators keep the panels swinging" in failure for failure in failures.values())
