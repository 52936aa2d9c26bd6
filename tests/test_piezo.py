"""Piezo arrays: virtual work of the patches, what reaches which mode, allocation, and arrays in the whole loop."""

from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from sffr_baselines import make_policy
from sffr_gym import Params, Simulator, load_params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.physics.actuators import generalized_forces, pack_actuators, saturate
from sffr_gym.physics.model import mode_slice, nodal, pack
from sffr_gym.physics.piezo import authority, thickness
from sffr_workbench.evaluation import evaluate

Array = NDArray[np.float64]

ARRAYS = {"generalized": 3, "patches": 8, "tip": 2}  # channels of a panel


def robot(array: str, *overrides: str) -> Params:
    """Return the case study with another array."""
    return load_params().with_overrides(f"actuators.piezo.array={array}", *overrides)


def face_stretch(params: Params, nodes: Array, span: tuple[float, float], y: float) -> float:
    """Integrate the strain ``u' - y w''`` of a face between two places, from the nodes' coordinates (n, 3)."""
    length, elements = params.panel.length, params.panel.elements
    x = np.linspace(0.0, length, elements + 1)
    u, w, slope = np.vstack([np.zeros(3), nodes]).T
    bending = CubicHermiteSpline(x, w, slope).derivative(2)
    points, weights = np.polynomial.legendre.leggauss(3)
    cuts = np.unique([span[0] * length, *x[(x > span[0] * length) & (x < span[1] * length)], span[1] * length])
    total = 0.0
    for start, stop in pairwise(cuts):
        middle, half = (start + stop) / 2, (stop - start) / 2
        element = min(int(middle / length * elements), elements - 1)
        strain = (u[element + 1] - u[element]) * elements / length - y * bending(middle + half * points)
        total += half * weights @ strain
    return total


@pytest.mark.parametrize("elements", [1, 3])
@pytest.mark.parametrize("array", ["patches", "tip"])
def test_patches_do_the_work_of_their_force_on_the_strain_of_their_face(array: str, elements: int) -> None:
    spans = "[[0.05, 0.3], [0.3, 0.45], [0.7, 1.0]]"
    params = robot(array, f"panel.elements={elements}", f"actuators.piezo.{array}={spans}", "actuators.piezo.force=30")
    model = pack(params)
    actuators = pack_actuators(params, model)
    rng = np.random.default_rng(0)
    motion = rng.normal(size=model.omega2.size)
    nodes = nodal(model, motion).reshape(2, elements, 3)
    half = np.sqrt(3.0 * params.panel.EI / params.panel.E / params.panel.area)
    for panel in range(2):
        for channel in range(6):
            span = getattr(params.actuators.piezo, array)[channel // 2]
            stretch = face_stretch(params, nodes[panel], span, half * (-1.0) ** channel)
            command, tau = np.zeros(len(actuators.limit)), np.zeros(model.at.end)
            command[6 * panel + channel] = volts = rng.uniform(-200.0, 200.0)
            generalized_forces(model, actuators, command, tau)
            assert tau[mode_slice(model)] @ motion == pytest.approx(30.0 * volts / 200.0 * stretch, rel=1e-9)
            assert not tau[: mode_slice(model).start].any()


def test_thickness_is_that_of_the_section() -> None:
    """I = b h^3 / 12 and a = b h; the case study's panel is 1.58 mm thick."""
    panel = load_params().panel
    h = thickness(panel)
    assert panel.area * h**2 / 12.0 == pytest.approx(panel.EI / panel.E, rel=1e-12)
    assert h == pytest.approx(1.58e-3, abs=5e-6)


@pytest.mark.parametrize("elements", [1, 2])
def test_generalized_array_gives_the_same_bits_as_forces_on_the_tip(elements: int) -> None:
    """Voltages to tip forces by K_PZ, tip forces to modal forces by the tips' motion, in this order."""
    params = robot("generalized", f"panel.elements={elements}")
    model = pack(params)
    actuators = pack_actuators(params, model)
    command, tau = np.random.default_rng(0).uniform(-200.0, 200.0, 15), np.zeros(model.at.end)
    generalized_forces(model, actuators, command, tau)
    for i in range(2):
        force = np.diag(actuators.K_PZ[i]) * command[3 * i : 3 * i + 3]
        expected = actuators.tips[i, :, 0] * force[0]
        for k in (1, 2):
            expected = expected + actuators.tips[i, :, k] * force[k]
        np.testing.assert_array_equal(tau[mode_slice(model)].reshape(2, -1)[i], expected)


def test_patches_at_the_tip_hardly_reach_the_first_bending_mode() -> None:
    """There is no curvature: 33 times less than those at the root for the paper's element, 470 for a good beam."""
    for elements, least, most in ((1, 30.0, 36.0), (8, 400.0, 550.0)):
        reached = {}
        for array in ("patches", "tip"):
            modes, forces = authority(robot("generalized", f"panel.elements={elements}"), array)
            reached[array] = np.abs(forces[modes.n_axial]).sum()
        assert least < reached["patches"] / reached["tip"] < most


@pytest.mark.parametrize("array", ARRAYS)
def test_authority_is_what_the_simulator_applies(array: str) -> None:
    """Modal force of one volt, on any number of elements."""
    params = robot(array, "panel.elements=2")
    model = pack(params)
    actuators = pack_actuators(params, model)
    modes, forces = authority(load_params().with_overrides("panel.elements=2"), array)
    assert forces.shape == (len(modes.omega), ARRAYS[array])
    np.testing.assert_allclose(actuators.reach[1] * actuators.gain[1], forces, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("array", ["patches", "tip"])
def test_allocation_is_the_least_squares_one_of_the_controllers_own_element(array: str) -> None:
    """No voltages come nearer to a wanted tip force, none as near are smaller; the plant's elements play no part."""
    params = robot(array, "panel.elements=4")
    actuators = pack_actuators(params, pack(params))
    K_PZ, allocation = actuators.K_PZ[0], actuators.allocation[0]
    np.testing.assert_array_equal(K_PZ, pack_actuators(robot(array), pack(robot(array))).K_PZ[0])
    wanted = np.array([0.3, -0.2, 0.1])
    expected = np.linalg.lstsq(K_PZ, wanted, rcond=1e-12)[0]
    np.testing.assert_allclose(allocation @ wanted, expected, rtol=1e-8)
    residual = K_PZ @ allocation @ wanted - wanted
    assert np.linalg.norm(residual) < 1e-9 or array == "tip"


def test_overlooked_directions_get_no_voltage() -> None:
    """Two pairs whose places differ by a rounding error do not ask for astronomical voltages."""
    near = "actuators.piezo.patches=[[0.0, 0.1], [0.1, 0.10000000000001]]"
    params = robot("patches", near)
    assert np.abs(pack_actuators(params, pack(params)).allocation).max() < 1e7


def test_channels_saturate_one_by_one() -> None:
    params = robot("patches")
    actuators = pack_actuators(params, pack(params))
    command, applied = np.zeros(25), np.empty(25)
    command[[2, 5, 9]] = 201.0, 199.0, -1000.0
    saturate(actuators, command, applied)
    assert applied[[2, 5, 9]].tolist() == [200.0, 199.0, -200.0] and np.count_nonzero(applied) == 3
    volts = Simulator(params).applied(piezo_volts=command[:16].reshape(2, 8))
    assert set(np.flatnonzero(volts.saturated)) == {2, 9}


@pytest.mark.parametrize("array", ["patches", "tip"])
def test_hsc_in_environment_batch_and_evaluation(array: str, user_scenario) -> None:
    """Action space, batch against single, efforts by the channels' number, and less vibration with root patches."""
    file = user_scenario(duration=1.0, panel_modes=[{"mode": 1, "amplitude": [0.1, 0.1]}])
    overrides = [f"actuators.piezo.array={array}"]
    env, batch = (
        SFFRFlexEnv(file, overrides=overrides),
        SFFRFlexVectorEnv(2, scenario=file, overrides=overrides),
    )
    n_c = ARRAYS[array]
    assert env.action_space.shape == (2 * n_c + 9,) and batch.action_space.shape == (2, 2 * n_c + 9)
    single, many = make_policy("hsc", env), make_policy("hsc", batch)
    (obs, _), (all_obs, _) = env.reset(seed=3), batch.reset(seed=[3, 4])
    for _ in range(20):
        obs, _, _, _, info = env.step(single(obs))
        all_obs, *_ = batch.step(many(all_obs))
        np.testing.assert_array_equal(all_obs[0], obs)
    assert info["piezo_square"] == pytest.approx(np.sum(info["applied"][: 2 * n_c] ** 2)) and info["piezo_square"] > 0
    found = evaluate(["none", "hsc"], file, episodes=1, seed=1_000_000, overrides=overrides).results
    none, hsc = (found[policy][0].measures for policy in ("none", "hsc"))
    assert hsc["piezo_effort"] > 0.0 and hsc["piezo_saturation"] > 0.1
    assert (hsc["vibration"] < 0.99 * none["vibration"]) is (array == "patches")


def test_environment_passes_the_checker_with_patches() -> None:
    env = gym.make("SFFRFlex-v0", overrides=["actuators.piezo.array=patches"])
    check_env(env.unwrapped, skip_render_check=True)
