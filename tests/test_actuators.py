"""Actuators: authority, limits, the order of a command, and the forces they make."""

import numpy as np
import pytest
from numpy.typing import NDArray

from sffr_gym import Params, load_params
from sffr_gym.physics.actuators import Actuators, generalized_forces, pack_actuators, saturate
from sffr_gym.physics.model import Model, joint_slice, mode_slice, nodal, object_slice, pack

Array = NDArray[np.float64]

LIMITS = (
    "thruster_force=30",
    "thruster_torque=20",
    "joint_torque=5",
    "piezo.force=12",
    "piezo.moment=7",
    "piezo.voltage=150",
)


def make(*overrides: str) -> tuple[Params, Model, Actuators]:
    """Return parameters, model and actuators."""
    params = load_params().with_overrides(*overrides)
    model = pack(params)
    return params, model, pack_actuators(params, model)


def forces(model: Model, actuators: Actuators, command: Array, before: float = 0.0) -> Array:
    """Return the generalised forces of a command, written over a vector filled with `before`."""
    tau = np.full(model.at.end, before)
    generalized_forces(model, actuators, command, tau)
    return tau


def test_authority_is_that_of_table_iii() -> None:
    """47.5 N, 47.5 N and 47.5 N m at 200 V, one channel for each tip coordinate of each panel."""
    _, _, actuators = make()
    assert actuators.K_PZ.shape == (2, 3, 3)
    for K_PZ in actuators.K_PZ:
        np.testing.assert_allclose(K_PZ @ np.full(3, 200.0), [47.5, 47.5, 47.5], rtol=1e-14)
        assert np.count_nonzero(K_PZ) == 3
    np.testing.assert_array_equal(actuators.limit, [200.0] * 6 + [100.0] * 3 + [7.0] * 6)


def test_every_limit_is_configured() -> None:
    """Force, torque, moment and voltage have their own keys and places: voltages, thrust, torque, joints."""
    _, _, actuators = make(*(f"actuators.{each}" for each in LIMITS))
    np.testing.assert_array_equal(actuators.limit, [150.0] * 6 + [30.0, 30.0, 20.0] + [5.0] * 6)
    np.testing.assert_allclose(actuators.K_PZ[1], np.diag([12, 12, 7]) / 150, rtol=1e-14)


def test_command_grows_with_the_robot() -> None:
    """One panel, one arm of one link: 3 voltages, 3 thrusts, 1 torque."""
    mounts = "panel.mounts=[{name: only, root: [0.0, 0.5], angle: 1.5}]"
    link = "{mass: 1, length: 1, inertia: 0.1, com: 0.5}"
    arm = f"arms=[{{name: boom, mount: [0.5, 0.0], mount_angle: 0.0, links: [{link}]}}]"
    _, _, actuators = make("object=null", mounts, arm, "initial.q=[0,0,0,0]", "initial.qd=[0,0,0,0]")
    np.testing.assert_array_equal(actuators.limit, [200.0] * 3 + [100.0] * 3 + [7.0])
    assert actuators.allocation.shape == (1, 3, 3)


def test_saturation_clips_at_the_limits_only() -> None:
    """Just inside stays, beyond is cut on either side, and NaN is not taken for a limit."""
    _, _, actuators = make()
    limit, applied = actuators.limit, np.empty(15)
    for factor in (0.999, 1.0, 1.001, 1e6):
        for sign in (1.0, -1.0):
            saturate(actuators, sign * factor * limit, applied)
            np.testing.assert_array_equal(applied, sign * min(factor, 1.0) * limit)
    command = np.zeros(15)
    command[[0, 7, 14]] = np.nan
    saturate(actuators, command, applied)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(applied)), [0, 7, 14])


def test_allocation_inverts_the_authority() -> None:
    """Wanted tip forces to volts and back."""
    _, _, actuators = make(*(f"actuators.{each}" for each in LIMITS))
    for K_PZ, allocation in zip(actuators.K_PZ, actuators.allocation, strict=True):
        np.testing.assert_allclose(K_PZ @ allocation, np.eye(3), atol=1e-14)


@pytest.mark.parametrize("elements", [1, 3])
def test_piezo_forces_act_on_the_tips_of_their_panels(elements: int) -> None:
    """By virtual work: modal forces times modal rates equal tip forces times tip rates, and nothing rigid is pushed."""
    _, model, actuators = make(f"panel.elements={elements}", *(f"actuators.{each}" for each in LIMITS))
    rng = np.random.default_rng(0)
    command, rates = np.zeros(15), rng.uniform(-1, 1, model.omega2.size)
    tip_rates = nodal(model, rates)[:, -3:]
    for channel in range(6):
        command[:] = 0.0
        command[channel] = volts = rng.uniform(-150, 150)
        tau = forces(model, actuators, command)
        authority = (12, 12, 7)[channel % 3] / 150
        power = authority * volts * tip_rates[channel // 3, channel % 3]
        assert tau[mode_slice(model)] @ rates == pytest.approx(power, rel=1e-10)
        assert not tau[: mode_slice(model).start].any()
        assert not tau[object_slice(model)].any()


def test_thrusters_and_joints_act_on_their_own_coordinates() -> None:
    """Base wrench first, then the joints in the order of q; no panel is pushed, the object's forces are left alone."""
    _, model, actuators = make()
    command = np.zeros(15)
    command[6:] = np.arange(1.0, 10.0)
    tau = forces(model, actuators, command, before=77.0)
    np.testing.assert_array_equal(tau[:3], [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(tau[joint_slice(model)], np.arange(4.0, 10.0))
    np.testing.assert_array_equal(tau[mode_slice(model)], 0.0)
    np.testing.assert_array_equal(tau[object_slice(model)], 77.0)


def test_command_is_linear_in_all_its_parts() -> None:
    """What is applied together is the sum of what is applied alone, panel by panel."""
    _, model, actuators = make()
    a, b = np.random.default_rng(1).uniform(-5, 5, (2, 15))
    total = forces(model, actuators, a + b)
    np.testing.assert_allclose(total, forces(model, actuators, a) + forces(model, actuators, b), atol=1e-12)
    half = np.where(np.arange(15) < 3, a, 0.0)  # the left panel's
    n_m = model.omega2.shape[1]
    modal = forces(model, actuators, half)[mode_slice(model)]
    assert modal[:n_m].all()
    assert not modal[n_m:].any()
