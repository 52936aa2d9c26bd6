"""Sampled virtual damping of a clamped panel: known numbers, limits, and the simulator itself."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigvals
from scipy.signal import cont2discrete

from sffr_baselines.stability import axial_alone, largest_stable_damping, sampled_growth
from sffr_gym import Simulator, load_params
from sffr_gym.physics.model import pack, tip_rows

B0 = np.array([3500.0, 1.5, 5.0])
ALL = np.ones(3)
BENDING = np.array([0.0, 1.0, 1.0])


def model_of(*overrides):
    return pack(load_params().with_overrides(*overrides))


@pytest.mark.parametrize(("eta", "growth"), [(3.5e-5, 0.869), (0.0, 1.114)])
def test_axial_growth_at_2_ms(eta, growth):
    model = axial_alone(model_of(f"panel.strain_rate_damping={eta}"))
    assert sampled_growth(model, B0, ALL, 2.0e-3) == pytest.approx(growth, abs=5e-4)


def test_full_law_is_stable_at_half_a_millisecond_even_without_strain_rate_damping():
    assert sampled_growth(model_of("panel.strain_rate_damping=0"), B0, ALL, 5.0e-4) < 1.0


def test_full_law_is_unstable_on_the_undamped_panel_at_2_ms_and_bending_alone_is_not():
    model = model_of("panel.strain_rate_damping=0")
    assert sampled_growth(model, B0, ALL, 2.0e-3) > 1.1
    assert sampled_growth(model, B0, BENDING, 2.0e-3) == pytest.approx(1.0, abs=1e-12)  # of the axial mode, left alone


@pytest.mark.parametrize("elements", [1, 3])
@pytest.mark.parametrize("damped", [ALL, BENDING, [0, 0, 1]])
def test_agrees_with_the_whole_state_space_discretised_at_once(elements, damped):
    model, period = model_of(f"panel.elements={elements}"), 1.3e-3
    n, tip = model.omega2.shape[1], tip_rows(model)[0]
    zero = np.zeros((n, n))
    A = np.block([[zero, np.eye(n)], [-np.diag(model.omega2[0]), -np.diag(model.damping[0])]])
    inputs, output = np.vstack([np.zeros((n, 3)), tip.T]), np.hstack([np.zeros((3, n)), tip])
    Ad, Bd, *_ = cont2discrete((A, inputs, output, np.zeros((3, 3))), period)
    expected = np.abs(eigvals(Ad - Bd @ np.diag(B0 * damped) @ output)).max()
    assert sampled_growth(model, B0, damped, period) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("left_out", [["panel.axial_cut=1", "panel.bending_cut=0.01"], ["panel.axial_cut=10"]])
def test_what_has_no_modes_does_not_grow(left_out):
    """A rigid panel, and one whose axial modes are left out, looked at along its axis."""
    assert sampled_growth(axial_alone(model_of(*left_out)), B0, ALL, 2.0e-3) == 0.0


def test_short_periods_give_the_continuous_damping():
    model, period = model_of(), 1.0e-6
    tip = tip_rows(model)[0]
    n = model.omega2.shape[1]
    D = np.diag(model.damping[0]) + tip.T @ np.diag(B0) @ tip
    slowest = eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(model.omega2[0]), -D]])).real.max()
    assert np.log(sampled_growth(model, B0, ALL, period)) / period == pytest.approx(slowest, rel=1e-4)


@pytest.mark.parametrize(("period", "B"), [(1.0e-3, B0), (5.0e-4, 3.5 * B0)])
def test_the_simulator_grows_as_predicted(period, B):
    """The panel on a base too heavy to move, its law in a loop outside: nothing in common but the parameters."""
    params = load_params().with_overrides(
        "object=null", "base.mass=1.0e9", "base.inertia=1.0e9", "actuators.piezo.voltage=1.0e9",
        "actuators.piezo.force=1.0e9", "actuators.piezo.moment=1.0e9", "panel.strain_rate_damping=1.0e-5",
        "simulation.max_step=1.0e-4", "initial.qd=[0, 0, 0, 0, 0, 0, 0, 0, 0]",
    )  # fmt: skip
    sim = Simulator(params)
    state = sim.initial_state()
    state = replace(state, qf=0 * state.qf, qfd=np.tile([1.0e-6, 0.0, 0.0], (2, 1)))
    speeds = []
    for _ in range(60):
        state = sim.step(state, piezo_tau=-B * state.qfd, dt=period)
        speeds.append(state.qfd[0, 0])
    late = np.abs(speeds)
    growth = (late[-20:].max() / late[-40:-20].max()) ** (1 / 20)
    assert growth == pytest.approx(float(sampled_growth(pack(params), B, ALL, period)), rel=0.01)


def test_batches_give_the_rows_alone():
    model, many = model_of(), np.outer([0.1, 1.0, 10.0], B0)
    growth = sampled_growth(model, many, ALL, 1.0e-3)
    assert growth.shape == (3,)
    np.testing.assert_allclose(growth, [sampled_growth(model, B, ALL, 1.0e-3) for B in many], rtol=1e-12)


@pytest.mark.parametrize("coordinate", range(3))
@pytest.mark.parametrize("period", [5.0e-4, 1.0e-3, 2.0e-3])
def test_largest_damping_is_where_stability_ends(coordinate, period):
    model, direction = model_of(), np.eye(3)[coordinate]
    largest = largest_stable_damping(model, direction, ALL, period)
    assert sampled_growth(model, 0.999 * largest * direction, ALL, period) <= 1.0
    assert sampled_growth(model, 1.001 * largest * direction, ALL, period) > 1.0


@pytest.mark.parametrize("scale", [1.0e-6, 1.0e6])
@pytest.mark.parametrize("period", [2.0e-3, 2.0e-2])
def test_the_largest_damping_does_not_depend_on_what_it_is_a_multiple_of(scale, period):
    """A direction a million times as long has a millionth of the factor."""
    usual, scaled = (largest_stable_damping(model_of(), k * np.array(B0), ALL, period) for k in (1.0, scale))
    assert 0.0 < usual < np.inf
    assert scaled == pytest.approx(usual / scale, rel=1e-6)


def test_no_axial_damping_at_all_is_stable_for_an_undamped_panel_at_2_ms():
    assert largest_stable_damping(model_of("panel.strain_rate_damping=0"), B0, ALL, 2.0e-3) == 0.0


def test_light_tip_node_of_several_elements_bears_less():
    """The tip's velocity must not reverse within a sample: ``B T phi' phi < 2`` over all modes."""
    models = [model_of(f"panel.elements={n}", "panel.bending_cut=1.0e+9") for n in (1, 2, 4)]
    limits = [largest_stable_damping(model, [0, 0, 1], ALL, 5.0e-4) for model in models]
    assert limits[0] > 10.0 * limits[1] > 50.0 * limits[2]
    stiffest = [np.sum(tip_rows(model)[0, 2] ** 2) for model in models]
    assert limits[0] == pytest.approx(2.0 / (5.0e-4 * stiffest[0]), rel=1e-2)


@pytest.mark.parametrize("period", [0.0, -1.0, np.nan])
def test_period_must_be_positive(period):
    with pytest.raises(ValueError, match="period must be a positive"):
        sampled_growth(model_of(), B0, ALL, period)


def test_panels_are_needed():
    with pytest.raises(ValueError, match="no panels"):
        sampled_growth(model_of("panel.mounts=[]"), B0, ALL, 1.0e-3)


def test_direction_must_be_damped():
    with pytest.raises(ValueError, match="no part in the damped"):
        largest_stable_damping(model_of(), [3500.0, 0.0, 0.0], BENDING, 1.0e-3)
