"""The laws by name: what each one does to the panels, what a law that tracks adds, and what a policy counts."""

import numpy as np
import pytest

from sffr_baselines import make_policy
from sffr_baselines.laws import LawPolicy, make_law, tracking
from sffr_gym import load_params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.scenario import load_scenario

# Of each law's panels: whether it damps them by a virtual damping, and adapts it, by which output.
PANELS = {
    "none": (False, False, False), "hsc": (True, False, False), "hsc-tuned": (True, False, False),
    "ahsc": (True, True, False), "ahsc-filtered": (True, True, True), "lqr": (False, False, False),
    "mpc": (False, False, False), "ppf": (False, False, False), "shaped": (False, False, False),
    "shaped-zv": (False, False, False),
}  # fmt: skip


def observations(count):
    """Observations on the way of swinging panels."""
    env = SFFRFlexEnv("excited")
    rows = [env.reset(seed=0)[0]]
    while len(rows) < count:
        rows.append(env.step(np.full(15, 0.02))[0])
    return np.array(rows)


@pytest.mark.parametrize("name", PANELS)
def test_a_law_damps_and_adapts_as_its_name_says(params, name):
    """Those that track as well, which change the rigid part alone."""
    names = [name] if name.startswith("shaped") else [name, f"{name}-ff", f"{name}-kf"]
    for each in names:
        own = make_law(each, params).suppression
        assert ((own.damped * own.B0).any(), (own.damped * own.Gamma).any(), own.filtered) == PANELS[name]


@pytest.mark.parametrize("name", PANELS)
def test_piezos_are_off_or_driven_as_a_laws_name_says(params, name):
    """By the panels' motion; whether they swing or not makes no difference to what leaves them alone."""
    policy = make_policy(name, params)
    actions = np.array([policy(obs) for obs in observations(5)])
    assert actions[1:, :6].any() == (name not in ("none", "shaped", "shaped-zv"))
    if policy.law.suppression.Gamma.any():
        assert (policy.B_hat[0] != policy.initial_damping()).any()
    else:
        np.testing.assert_array_equal(policy.B_hat[0], policy.initial_damping())


def test_the_filtered_law_adapts_otherwise():
    both = [make_policy(name, load_params()) for name in ("ahsc", "ahsc-filtered")]
    for obs in observations(20):
        for policy in both:
            policy(obs)
    assert (both[0].B_hat[0, :, 1:] != both[1].B_hat[0, :, 1:]).all()


@pytest.mark.parametrize("gains", [[], ["control.Kp=3600.0", "control.Kd=90.0"]])
@pytest.mark.parametrize("filters", [False, True])
def test_slow_errors_of_a_law_that_tracks_fade_without_a_swing(params, gains, filters):
    """``Kd ed + Kp e + Ki z = 0`` has one root twice; the rest is the panels' reaction, late sensors, and a filter."""
    given = params.with_overrides(*gains).control
    control = tracking(given, filters=filters)
    roots = np.roots([given.Kd, given.Kp, control.Ki])
    np.testing.assert_allclose(roots, -0.5 * given.Kp / given.Kd, rtol=1e-6)
    assert control.feedforward and control.delay_compensation and (control.observer is not None) == filters
    assert not (given.feedforward or given.delay_compensation or given.Ki or given.observer)
    assert (control.Kp, control.Kd, control.period) == (given.Kp, given.Kd, given.period)


def test_a_filter_believes_in_the_noise_of_the_scenario_noise(params):
    observer, sensors = tracking(params.control, filters=True).observer, load_scenario("noise").sensors
    for unit in ("position", "angle", "velocity", "rate"):
        assert getattr(observer, unit) == getattr(sensors, unit)
    assert observer.acceleration == observer.angular_acceleration == 0.3


@pytest.mark.parametrize(
    ("name", "tracks", "filters", "shaped"),
    [("ahsc", False, False, False), ("ahsc-ff", True, False, False), ("ahsc-kf", True, True, False),
     ("lqr", False, False, False), ("lqr-ff", True, False, False), ("lqr-kf", True, True, False),
     ("mpc", True, False, False), ("shaped", True, False, True), ("shaped-zv", True, False, True)],
)  # fmt: skip
def test_a_law_tracks_and_filters_as_its_ending_says(params, name, tracks, filters, shaped):
    """Model predictive control and shaped paths track without an ending."""
    slew = params.with_overrides("path.kind=slew", "path.heading=fixed")
    law = make_law(name, slew)
    assert (law.reaction.active, law.observer.compensates, law.gains[2] > 0.0) == (tracks,) * 3
    assert law.observer.filters == filters
    assert (law.shaped.pieces.size > 0) == shaped


@pytest.mark.parametrize("array", ["generalized", "patches", "tip"])
@pytest.mark.parametrize("name", ["ahsc", "mpc"])
def test_a_prediction_has_the_channels_of_the_feedback(params, name, array):
    """Of a law that predicts, and of one that leaves room for none."""
    law = make_law(name, params.with_overrides(f"actuators.piezo.array={array}"))
    assert law.predictive.share.shape[:2] == law.regulator.gain.shape[:2]
    assert (law.predictive.hold > 0) == (name == "mpc")


def test_a_policy_counts_control_periods():
    """From 0 on, and again after a reset; a batch counts once for all."""
    policy, rows = make_policy("ahsc", load_params()), observations(3)
    assert isinstance(policy, LawPolicy) and policy.tick == 0 and policy.B_hat is None
    for k, obs in enumerate(rows):
        policy(obs)
        assert policy.tick == k + 1
    policy.reset()
    assert policy.tick == 0 and policy.B_hat is None
    policy(rows)
    assert policy.tick == 1 and policy.B_hat.shape == (3, 2, 3)


@pytest.mark.parametrize("shape", [(52,), (1, 52), (3, 52)])
def test_actions_have_the_shape_of_their_observations(shape):
    env = SFFRFlexEnv()
    policy = make_policy("hsc", env)
    assert policy(np.broadcast_to(env.reset(seed=0)[0], shape)).shape == (*shape[:-1], 15)
    for wrong in (np.zeros((2, 51)), np.zeros((1, 2, 52)), np.zeros(1)):
        with pytest.raises(ValueError, match="expects observations of 52 numbers"):
            policy(wrong)
