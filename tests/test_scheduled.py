"""Laws under a schedule: what of a law a factor multiplies, and how fast the panels' vibration grows with it."""

import numpy as np
import pytest
from observer import bent, command_of

from sffr_baselines.laws import make_law
from sffr_baselines.panel_reaction import add_panel_reaction
from sffr_baselines.regulator import sampled_bending
from sffr_baselines.scheduled import AGENT_PERIOD, regulated_growth, scheduled_law
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
