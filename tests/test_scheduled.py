"""Laws under a schedule: what of a law a factor multiplies, and how fast the panels' vibration grows with it."""

import re

import numpy as np
import pytest
from observer import bent, command_of

from sffr_baselines.laws import make_law
from sffr_baselines.panel_reaction import add_panel_reaction
from sffr_baselines.regulator import sampled_bending
from sffr_baselines.scheduled import AGENT_PERIOD, action_names, regulated_growth, scheduled_law
from sffr_baselines.stability import largest_stable_damping
from sffr_gym import ConfigError, load_params
from sffr_gym.physics.actuators import pack_actuators

FACTORS = np.array([0.1, 1.0, 4.0, 60.0])


@pytest.mark.parametrize("name", ["lqr", "mpc"])
@pytest.mark.parametrize("array", ["generalized", "patches"])
def test_a_regulated_panel_grows_as_its_sampled_equations_do(name, array):
    """Bending alone, which feedback of q5 and q6 by piezos across the panel leaves to itself."""
    params = load_params().with_overrides(f"actuators.piezo.array={array}", "panel.axial_cut=1.0e-3")
    law = make_law(name, params)
    _, _, A, G = sampled_bending(params)
    growth = regulated_growth(law, params, FACTORS)
    force = pack_actuators(params, law.prior).K_PZ[:, 1:]
    for i, gain in enumerate(law.regulator.gain):
        loops = A - FACTORS[:, None, None] * (G @ force[i] @ gain)
        np.testing.assert_allclose(growth[i], np.abs(np.linalg.eigvals(loops)).max(axis=1), rtol=1e-9)


def test_a_factor_with_which_a_panel_would_grow_is_refused():
    params = load_params()
    assert regulated_growth(make_law("lqr", params), params, np.array([1.0, 30.0])).max() < 1.0
    scheduled_law(params, "lqr", 30.0, AGENT_PERIOD, None)
    with pytest.raises(ConfigError, match="lower rho"):
        scheduled_law(params, "lqr", 1000.0, AGENT_PERIOD, None)


def test_a_share_of_the_reaction_is_that_part_of_each_panels_wrench():
    """Linear in the share, each panel by itself, and the whole is the sum."""
    params = load_params()
    observer, p, v = bent(params, seed=5)
    law, obs = make_law("lqr-ff", params), observer(p, v, 0)
    volts = command_of("lqr-ff", observer, p, v)["piezo_volts"].ravel()

    def wrench(*share):
        total = np.zeros(3)
        add_panel_reaction(law.reaction, law.scale, law.at, obs, volts, np.array([0.3, -0.2, 0.1]), share, total)
        return total

    left, right = wrench(1.0, 0.0), wrench(0.0, 1.0)
    np.testing.assert_allclose(wrench(0.25, 0.5), 0.25 * left + 0.5 * right, rtol=1e-12)
    np.testing.assert_allclose(wrench(1.0, 1.0), left + right, rtol=1e-12)
    assert np.abs(left).min() > 1e-6 and np.abs(left - right).min() > 1e-6


def least_unstable_factor(law, params):
    """Return the factor of a law's damping or feedback from which on a panel's vibration grows."""
    if not law.regulator.active:
        own = law.suppression
        return largest_stable_damping(law.prior, own.B0, own.damped, own.period)
    low, high = 1.0, 1000.0
    for _ in range(30):
        middle = np.sqrt(low * high)
        stable = regulated_growth(law, params, np.array([middle])).max() <= 1.0
        low, high = (middle, high) if stable else (low, middle)
    return low


@pytest.mark.parametrize("name", ["hsc", "lqr"])
def test_a_factor_is_refused_from_where_a_panel_grows_at_all(params, name):
    """Little beyond the stable ones already; the message says how fast, and under which damping."""
    factor = least_unstable_factor(make_law(name, params), params)
    assert 20.0 < factor < 300.0
    scheduled_law(params, name, 0.99 * factor, AGENT_PERIOD, None)
    with pytest.raises(ConfigError, match=r"rho = .* lower rho") as refused:
        scheduled_law(params, name, 1.02 * factor, AGENT_PERIOD, None)
    growth = float(re.search(r"grows ([\d.]+) times", str(refused.value))[1])
    assert 1.0 <= growth < 1.3
    if name == "hsc":
        worst = [float(each) for each in re.search(r"damping \[(.*?)\]", str(refused.value))[1].split(",")]
        assert worst[0] == 0.0 and max(worst[1] / 1.5, worst[2] / 5.0) == pytest.approx(1.02 * factor)


@pytest.mark.parametrize("name", ["hsc", "lqr"])
def test_a_mode_that_nothing_damps_does_not_grow(params, name):
    """The axial one of a panel without losses keeps its amplitude, which is no reason to refuse a factor."""
    scheduled_law(params.with_overrides("panel.strain_rate_damping=0"), name, 10.0, AGENT_PERIOD, None)


def test_one_panel_can_be_scheduled_and_none_cannot(params):
    one = params.with_overrides("panel.mounts=[{name: one, root: [0.3, -0.7], angle: 2.1}]")
    assert action_names(one, scheduled_law(one, "ahsc", 10.0, AGENT_PERIOD, None)) == ("one_q5", "one_q6")
    with pytest.raises(ConfigError, match="the robot has no panels whose damping could be scheduled"):
        scheduled_law(params.with_overrides("panel.mounts=[]"), "ahsc", 10.0, AGENT_PERIOD, None)


@pytest.mark.parametrize(
    ("name", "actions"),
    [("ahsc", ["q5", "q6"]), ("ahsc-ff", ["q5", "q6", "reaction"]), ("lqr", ["feedback"]),
     ("mpc", ["feedback", "reaction"])],
)  # fmt: skip
def test_actions_are_named_by_panel_and_by_what_they_change(params, name, actions):
    names = action_names(params, make_law(name, params))
    assert names == tuple(f"{panel}_{action}" for panel in ("left", "right") for action in actions)


@pytest.mark.parametrize(
    ("agent_period", "hold"),
    [(0.002, 1), (0.004, 2), (0.1, 50), (10.0, 5000), (0.003, None), (0.1005, None), (1e-6, None)],
)
def test_a_decision_holds_for_whole_control_periods(params, agent_period, hold):
    """From one on."""
    if hold is None:
        with pytest.raises(ConfigError, match=r"must be a multiple of control.period = 0\.002"):
            scheduled_law(params, "hsc", 10.0, agent_period, None)
    else:
        assert scheduled_law(params, "hsc", 10.0, agent_period, None).schedule.hold == hold


@pytest.mark.parametrize(("given", "tolerance"), [(None, np.inf), (1e-9, 1e-9), (0.25, 0.25), (1000.0, 1000.0)])
def test_what_a_schedule_is_given_stands_in_the_law(params, given, tolerance):
    schedule = scheduled_law(params, "hsc", 2.5, AGENT_PERIOD, given).schedule
    assert (schedule.rho, schedule.tolerance) == (2.5, tolerance)
