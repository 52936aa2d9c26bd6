"""The panels' law: virtual damping of Eq. 20, the quadratic velocity terms of Eq. 48, and the adaptation of Eq. 39."""

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sffr_baselines import make_policy
from sffr_baselines.laws import make_law, undamped_coordinates
from sffr_baselines.suppression import damped_coordinates
from sffr_gym.config.params import load_params
from sffr_gym.envs.single import SFFRFlexEnv

AUTHORITY = 47.5  # N or N m at full voltage
B0, GAMMA, PSI = np.array([3500.0, 1.5, 5.0]), np.array([700.0, 10.0, 15.0]), 0.1
MASS, LENGTH = 9.0, 4.0
M_FF = MASS * np.array([
    [1 / 3, 0, 0], [0, 13 / 35, -11 / 210 * LENGTH], [0, -11 / 210 * LENGTH, LENGTH**2 / 105]
])  # fmt: skip
ALL = "suppression.coordinates=all"
EAGER = ("suppression.B0=[0.1, 0.1, 0.1]", "suppression.Gamma=[1.0e+5, 1.0e+5, 1.0e+5]")


class Bench:
    """A policy that is fed made-up panel states; everything else of the observation is that of Table IV."""

    def __init__(self, name, *overrides):
        env = SFFRFlexEnv(overrides=list(overrides))
        self.policy, self.fields, self.period = make_policy(name, env), env.fields, env.params.control.period
        self.obs = env.reset(seed=0)[0]

    def __call__(self, q, qd, yaw_rate=0.0):
        """Return the wanted tip forces (2, 3) for elastic coordinates and rates (2, 3)."""
        obs = self.obs.copy()
        obs[self.fields["elastic"].slice] = np.ravel(q)
        obs[self.fields["elastic_rate"].slice] = np.ravel(qd)
        obs[self.fields["yaw_rate"].slice] = yaw_rate
        return self.policy(obs)[:6].reshape(2, 3) * AUTHORITY

    @property
    def B_hat(self):
        """The present virtual damping (2, 3)."""
        return self.policy.B_hat[0].copy()


shared_bench = functools.cache(Bench)


def states(seed, size=0.2):
    """Random elastic coordinates and rates (2, 3) of both panels."""
    return size * np.random.default_rng(seed).uniform(-1.0, 1.0, (2, 2, 3))


def eq_48(q, qd, w):
    """The elastic rows of Eq. 48 for one panel, with the misprints of its third and fourth row mended."""
    (q4, q5, q6), (q4d, q5d, q6d), m, L = q, qd, MASS, LENGTH
    return np.array([
        m * w**2 * (L / 3 + q4 / 3) + 2 * m * w * (7 / 20 * q5d - L / 20 * q6d),
        m * w**2 * (13 / 35 * q5 - 11 / 210 * L * q6) + 2 * m * w * (-7 / 20 * q4d),
        m * w**2 * (L**2 / 105 * q6 - 11 / 210 * L * q5) + 2 * m * w * (L / 20 * q4d),
    ])  # fmt: skip


def test_law_is_eq_20():
    """The piezos' force is -B qd - Q_v on every coordinate, of each panel by itself."""
    bench = Bench("hsc", ALL)
    for seed, w in ((0, 0.0), (1, 0.7), (2, -1.3)):
        q, qd = states(seed)
        expected = [-B0 * qd[i] - eq_48(q[i], qd[i], w) for i in range(2)]
        np.testing.assert_allclose(bench(q, qd, w), expected, rtol=1e-12, atol=1e-12)


def test_undamped_coordinates_get_no_force():
    """What the law does not damp it leaves alone, the compensation of Q_v included."""
    bench = Bench("hsc")
    q, qd = states(3)
    forces = bench(q, qd, 0.9)
    np.testing.assert_array_equal(forces[:, 0], 0.0)
    expected = [(-B0 * qd[i] - eq_48(q[i], qd[i], 0.9))[1:] for i in range(2)]
    np.testing.assert_allclose(forces[:, 1:], expected, rtol=1e-12, atol=1e-12)
    only = Bench("hsc", "suppression.coordinates=[q6]")(q, qd, 0.9)
    np.testing.assert_array_equal(only[:, :2], 0.0)
    np.testing.assert_array_equal(only[:, 2], forces[:, 2])


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(st.floats(-50.0, 50.0), min_size=12, max_size=12), st.sampled_from(["hsc", "ahsc", "ahsc-filtered"]))
def test_damping_takes_power_out_of_each_coordinate(values, name):
    """While the base does not turn, force times rate is never positive, limits or none."""
    q, qd = np.reshape(values, (2, 2, 3)) * [[[1e-2, 0.1, 0.1]], [[1e-3, 1.0, 1.0]]]
    bench = shared_bench(name, ALL)
    bench.policy.reset()
    assert (bench(q, qd) * qd).max() <= 0.0


@pytest.mark.parametrize(("name", "filtered"), [("ahsc", False), ("ahsc-filtered", True)])
def test_adaptation_is_eq_39(name, filtered):
    """Each period adds T Gamma K' M_f^-1 Y with e = -q_f, K = diag(e_dot) and Y = e or e_dot + psi e."""
    bench, B = Bench(name, ALL), np.tile(B0, (2, 1))
    for seed in range(50):
        q, qd = states(seed, 0.01)
        np.testing.assert_allclose(bench(q, qd), -B * qd, rtol=1e-9, atol=1e-15)
        Y = -(qd + PSI * q) if filtered else -q
        B += bench.period * GAMMA * -qd * np.linalg.solve(M_FF, Y.T).T
        np.testing.assert_allclose(bench.B_hat, B, rtol=1e-12)
    assert np.abs(B / B0 - 1.0).max() > 1e-8


@pytest.mark.parametrize(("coordinate", "column"), [("q4", 0), ("q5", 1)])
def test_printed_law_is_a_function_of_the_deflection(coordinate, column):
    """For a coordinate alone, B - B(0) = Gamma (M_f^-1)_kk (q^2 - q(0)^2) / 2: a swing ends with the damping it had."""
    bench = Bench("ahsc", f"suppression.coordinates=[{coordinate}]", "suppression.B0=[1, 1, 1]")
    gain, inverse = GAMMA[column], np.linalg.inv(M_FF)[column, column]
    steps, amplitude = 3000, 0.01
    for k in range(steps):
        angle = 2 * np.pi * k / steps + 0.3
        q, qd = np.zeros((2, 3)), np.zeros((2, 3))
        q[:, column] = amplitude * np.sin(angle)
        qd[:, column] = amplitude * np.cos(angle) * 2 * np.pi / (steps * bench.period)
        before = 1.0 if k == 0 else bench.B_hat[0, column]
        expected = 1.0 + gain * inverse / 2 * amplitude**2 * (np.sin(angle) ** 2 - np.sin(0.3) ** 2)
        # The law's sum is the integral by the rectangle rule.
        assert before == pytest.approx(expected, abs=gain * inverse * amplitude**2 * 2 * np.pi / steps)
        bench(q, qd)
    assert bench.B_hat[0, column] == pytest.approx(1.0, abs=1e-4 * gain * inverse * amplitude**2)


def test_filtered_law_adds_damping_with_every_swing():
    """A swing adds Gamma (M_f^-1)_kk times the integral of qd^2, which the printed law does not."""
    bench = Bench("ahsc-filtered", "suppression.coordinates=[q5]")
    steps, amplitude = 3000, 0.01
    rate = 2 * np.pi / (steps * bench.period)
    for k in range(steps):
        q, qd = np.zeros((2, 3)), np.zeros((2, 3))
        q[:, 1], qd[:, 1] = (
            amplitude * np.sin(rate * k * bench.period),
            amplitude * rate * np.cos(rate * k * bench.period),
        )
        bench(q, qd)
    integral = amplitude**2 * rate**2 * steps * bench.period / 2
    gained = bench.B_hat[:, 1] - B0[1]
    np.testing.assert_allclose(gained, GAMMA[1] * np.linalg.inv(M_FF)[1, 1] * integral, rtol=1e-9)
    assert gained.min() > 0.0


@pytest.mark.parametrize("name", ["ahsc", "ahsc-filtered"])
def test_no_adaptation_while_a_channel_saturates(name):
    """A panel one of whose channels asks for more than its limit keeps its damping; the other panel adapts."""
    bench = Bench(name)
    q, qd = np.full((2, 3), 0.05), np.full((2, 3), 0.3)
    just, beyond = 0.999 * AUTHORITY / B0[1], 1.001 * AUTHORITY / B0[1]
    qd[1, 1] = beyond
    bench(q, qd)
    assert (bench.B_hat[0, 1:] != B0[1:]).all()
    np.testing.assert_array_equal(bench.B_hat[1, 1:], B0[1:])
    bench.policy.reset()
    qd[1, 1] = just
    bench(q, qd)
    assert (bench.B_hat[:, 1:] != B0[1:]).all()


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1), st.floats(1e-3, 2.0), st.sampled_from(["ahsc", "ahsc-filtered"]))
def test_damping_is_never_negative(seed, size, name):
    """Whatever the panels do, with large gains and little damping to start from, B stays at zero or above."""
    bench = shared_bench(name, *EAGER)
    bench.policy.reset()
    for step in range(30):
        bench(*states([seed, step], size))
        assert bench.B_hat.min() >= 0.0


@pytest.mark.parametrize("name", ["ahsc", "ahsc-filtered"])
def test_damping_stops_at_zero(name):
    """A panel on its way back to the middle loses damping down to zero, exactly, and is left free then."""
    bench = shared_bench(name, *EAGER)
    bench.policy.reset()
    q, qd = np.array([[0.0, 0.1, 0.0]] * 2), np.array([[0.0, -0.1 * PSI, 0.0]] * 2) / 2
    assert bench(q, qd)[0, 1] > 0.0
    for _ in range(200):
        bench(q, qd)
    np.testing.assert_array_equal(bench.B_hat[:, 1], 0.0)
    np.testing.assert_array_equal(bench(q, qd)[:, 1], 0.0)


@pytest.mark.parametrize(
    ("overrides", "damped"),
    [
        ([], ("q5", "q6")),
        (["control.period=5.0e-4"], ("q4", "q5", "q6")),
        # q4's own frequency is 2828.4 rad/s, so that the bound lies at 0.555 ms.
        (["control.period=5.55e-4"], ("q4", "q5", "q6")),
        (["control.period=5.56e-4"], ("q5", "q6")),
        (["panel.EI=4.0e+6"], ("q5",)),
        ([ALL], ("q4", "q5", "q6")),
        (["suppression.coordinates=[q6, q4]"], ("q6", "q4")),
    ],
)
def test_rule_for_the_damped_coordinates(overrides, damped):
    """`auto` takes the coordinates whose own frequency times the period is below pi/2; `all` and a list are obeyed."""
    params = load_params().with_overrides(*overrides)
    assert damped_coordinates(params) == damped
    assert undamped_coordinates(params) == tuple(name for name in ("q4", "q5", "q6") if name not in damped)
    policy = make_policy("hsc", params)
    expected = [value if name in damped else 0.0 for name, value in zip(("q4", "q5", "q6"), B0, strict=True)]
    np.testing.assert_array_equal(policy.initial_damping(), [expected] * 2)


@pytest.mark.parametrize("name", ["ahsc", "ahsc-filtered"])
def test_without_adaptation_gain_ahsc_is_hsc(name):
    """With Gamma = 0 the adaptive laws are HSC to the last bit; with Table IV's they are not."""
    runs = []
    for law, gain in (("hsc", [700, 10, 15]), (name, [0, 0, 0]), (name, [700, 10, 15])):
        env = SFFRFlexEnv("excited", overrides=[f"suppression.Gamma={gain}"])
        policy = make_policy(law, env)
        obs, _ = env.reset(seed=1)
        for _ in range(100):
            obs = env.step(policy(obs))[0]
        runs.append(obs)
    np.testing.assert_array_equal(runs[0], runs[1])
    assert (runs[0] != runs[2]).any()


def test_none_leaves_the_piezos_off():
    """`none` commands no voltage and adapts nothing, whatever the panels do."""
    bench = Bench("none", ALL)
    for seed in range(5):
        assert not bench(*states(seed, 3.0), yaw_rate=1.0).any()
    assert not bench.B_hat.any()


def test_position_feedback_leaves_the_virtual_damping_out():
    law = make_law("ppf", load_params()).suppression
    np.testing.assert_array_equal(law.B0, 0.0)
    assert law.damped.any()  # what the panels' motion asks for beside it stays


def test_law_knows_the_prior_alone():
    """Gains and panel of the law are those that the controller believes, not those of the plant it meets."""
    prior = load_params().with_overrides("panel.mass=4.5", "suppression.B0=[1, 2, 3]", ALL)
    env = SFFRFlexEnv()
    bench = Bench("hsc")
    bench.policy = make_policy("hsc", prior)
    q, qd = states(6)
    expected = [-np.array([1.0, 2.0, 3.0]) * qd[i] - 0.5 * eq_48(q[i], qd[i], 0.8) for i in range(2)]
    np.testing.assert_allclose(bench(q, qd, 0.8), expected, rtol=1e-12, atol=1e-12)
    assert env.params.panel.mass == 9.0


def test_finer_panels_are_damped_at_their_tips():
    """On a panel of four elements the law acts on the tip's coordinates with the one-element model of the paper."""
    q, qd = states(7)
    coarse, fine = Bench("ahsc", ALL), Bench("ahsc", ALL, "panel.elements=4")
    np.testing.assert_array_equal(coarse(q, qd, 0.5), fine(q, qd, 0.5))
    np.testing.assert_array_equal(coarse.B_hat, fine.B_hat)
