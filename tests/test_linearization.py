"""Linear models against natural frequencies, long runs of the nonlinear plant, a sweep, and a regulator made of one."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from sffr_gym import Simulator, State, load_params
from sffr_gym.physics.linearization import LinearModel, closed

Array = NDArray[np.float64]


def simulator(*overrides: str) -> Simulator:
    return Simulator(load_params().with_overrides(*overrides))


def oscillations(A: Array) -> Array:
    """Return the eigenvalues (n,) above the real axis, by size."""
    values = np.linalg.eigvals(A)
    values = values[values.imag > 1e-3]
    return np.asarray(values[np.argsort(abs(values))])


@pytest.mark.parametrize(
    "overrides",
    [["object=null"], [], ["panel.foreshortening=true"], ["object=null", "panel.elements=4"]],
    ids=["free", "object", "foreshortened", "four elements"],
)
def test_eigenvalues_at_rest_are_the_natural_frequencies(overrides: list[str]) -> None:
    """Damping in proportion to stiffness keeps the size of an eigenvalue, and gives its share ``eta omega / 2``."""
    plant = simulator(*overrides)
    omega, found = plant.frequencies(plant.rest_state()), oscillations(plant.linearize().A)
    np.testing.assert_allclose(abs(found), omega, rtol=1e-9)
    eta = plant.params.panel.strain_rate_damping
    np.testing.assert_allclose(-found.real, eta * omega**2 / 2, rtol=1e-6, atol=1e-9)


def test_rest_is_an_equilibrium_of_small_error() -> None:
    model = simulator().linearize()
    assert abs(model.drift).max() < 1e-12
    assert model.error < 1e-9


def test_eigenvalues_are_those_of_a_long_run() -> None:
    """Tips swing freely for 160 s with the object held; their Hankel matrix (Ho and Kalman) has the eigenvalues."""
    plant, dt = simulator(), 0.1
    expected = oscillations(plant.linearize().A)[:4]
    state = plant.rest_state()
    state.qfd[:] = [[0.0, 1e-4, 3e-4], [0.0, 2e-4, -2e-4]]
    tips = []
    for _ in range(1600):
        state = plant.step(state, dt=dt)
        tips.append(state.qf[:, 1:].ravel())
    y = np.array(tips)[10:]  # axial motion has died out
    rows, columns = 40, len(y) - 40
    hankel = np.vstack([y[k : k + columns].T for k in range(rows)])
    U, s, _ = np.linalg.svd(hankel, full_matrices=False)
    U = U[:, :8] * np.sqrt(s[:8])
    sampled = np.linalg.lstsq(U[:-4], U[4:], rcond=None)[0]
    found = np.log(np.linalg.eigvals(sampled)) / dt
    found = found[found.imag > 0]
    found = found[np.argsort(abs(found))]
    np.testing.assert_allclose(found.imag, expected.imag, rtol=1e-4)
    assert (abs(found - expected) < 1e-4 * abs(expected)).all()


def test_transfer_from_volts_to_tips_is_that_of_a_sine_sweep() -> None:
    """A sweep of the nonlinear plant from rest; on ``|z| > 1`` the ratio of z-transforms is free of its end."""
    plant, dt, n = simulator(), 0.01, 12_000
    model = plant.linearize().discrete(dt)
    state, t = plant.rest_state(), dt * np.arange(n)
    sweep = np.where(t < 40.0, 2e-3 * np.sin(2 * np.pi * (0.05 + t * 1.0 / 40.0) * t), 0.0)  # V, 0.05 to 2 Hz
    response = np.zeros((n, 2))
    for k, volts in enumerate(sweep):
        response[k] = state.qf[:, 1]
        state = plant.step(state, piezo_volts=[[0, volts, 0], [0, 0, 0]], dt=dt)
    rows, column = (
        model.find("outputs", "left_tip_transverse", "right_tip_transverse"),
        model.find("inputs", "left_piezo2"),
    )
    worst = 0.0
    for omega in np.geomspace(0.4, 10.0, 40):
        z = np.exp((0.12 + 1j * omega) * dt)
        weight = z ** -np.arange(n)
        swept = (weight @ response) / (weight @ sweep)
        inner = np.linalg.solve(z * np.eye(len(model.A)) - model.A, model.B[:, column])
        predicted = (model.C[rows] @ inner + model.D[np.ix_(rows, column)])[:, 0]
        worst = max(worst, (abs(swept - predicted) / abs(predicted)).max())
    assert worst < 0.01, worst


def regulator(model: LinearModel, plant: Simulator) -> Array:
    """Return the gain of a discrete linear-quadratic regulator made from a linear model alone."""
    n = len(model.A)
    limit = plant.actuators.limit
    Q = np.diag(np.repeat([1e2, 1.0], n // 2))
    R = np.diag((0.01 / limit) ** 2 * 1e4)
    P = solve_discrete_are(model.A, model.B, Q, R)
    return np.asarray(np.linalg.solve(R + model.B.T @ P @ model.B, model.B.T @ P @ model.A))


def test_a_regulator_made_of_the_model_is_stable_on_the_nonlinear_plant() -> None:
    """From swinging panels, off its place, with limits, at the control period."""
    plant = simulator("initial.q=[0.01, -0.02, 0.01, 0.6, 4.2, 5.6, 2.1, 0.45, 0.09]")
    model = simulator().linearize().discrete()
    gain = regulator(model, plant)
    state = plant.rest_state()
    state.qf[:, 1], state.qfd[:, 1] = [0.1, -0.05], [-0.05, 0.1]
    sizes = [energy_about(model, state)]
    for _ in range(15_000):
        volts, base, joints = plant.split(model.u0 - gain @ model.deviation(state))
        state = plant.step(state, base=base, joints=joints, piezo_volts=volts)
        sizes.append(energy_about(model, state))
    assert sizes[-1] < 1e-3 * sizes[0]
    assert plant.constraint_drift(state) < 1e-6


def energy_about(model: LinearModel, state: State) -> float:
    return float(np.linalg.norm(model.deviation(state)))


def test_model_in_motion_predicts_the_accelerations_of_neighbours_that_hold_the_object() -> None:
    """About a state that turns and swings under a command; neighbours' grasps are closed by Newton's method."""
    plant = simulator("initial.qd=[0.3, -0.2, 0.4, 0.2, 0.1, 0.2, -0.2, 0.3, -0.1]", "initial.qf=[0, 0.2, 0.1]")
    command = {"base": [3.0, -2.0, 1.0], "joints": [0.1, -0.2, 0.3, 0.1, 0.0, 0.2]}
    start, small = plant.initial_state(), 1e-4
    model = plant.linearize(start, **command)
    p, v = plant._flat(start)
    free, m = model.free, len(model.free)
    x = np.random.default_rng(1).normal(size=2 * m)

    def accelerations(sign: float) -> Array:
        there, moving = p.copy(), v.copy()
        there[free] += sign * small * x[:m]
        moving[free] += sign * small * x[m:]
        there, moving = closed(plant.model, there, moving, gap=1e-2)
        moved = plant.unflatten(0.0, there, moving)
        np.testing.assert_allclose(model.deviation(moved), sign * small * x, rtol=0, atol=1e-12)
        qdd, qfdd, objdd = plant.acceleration(moved, **command)
        amplitudes = np.einsum("pmf,pf->pm", plant.model.inverse, qfdd)
        return np.asarray(np.concatenate([qdd, amplitudes.ravel(), objdd])[free])

    difference = (accelerations(1.0) - accelerations(-1.0)) / (2 * small)
    np.testing.assert_allclose(difference, model.A[m:] @ x, rtol=1e-6, atol=1e-6 * abs(x).max())
    np.testing.assert_allclose(accelerations(0.0), model.drift[m:], rtol=0, atol=1e-8)


def test_outputs_are_those_of_the_simulator() -> None:
    plant = simulator(
        "initial.q.2=0.7", "initial.qd=[0.3, -0.2, 0.4, 0.2, 0.1, 0.2, -0.2, 0.3, -0.1]", "initial.qf=[0, 0.2, 0.1]"
    )
    state = plant.initial_state()
    assert state.q[2] == 0.7  # else axes of base and space would be the same
    base = [3.0, -2.0, 1.0]
    model = plant.linearize(state, base=base)
    qdd, _, _ = plant.acceleration(state, base=base)
    value = dict(zip([label.name for label in model.outputs], model.y0, strict=True))
    assert value["arm2_joint2"] == pytest.approx(state.q[6], abs=1e-9)
    assert value["antenna_joint1_rate"] == pytest.approx(state.qd[7], abs=1e-9)
    assert value["right_tip_slope"] == pytest.approx(state.qf[1, 2], abs=1e-12)
    assert value["object_phi_rate"] == pytest.approx(state.objd[2], abs=1e-9)  # type: ignore[index]
    assert value["base_yaw_acceleration"] == pytest.approx(qdd[2], abs=1e-9)
    forces = plant.grasp_forces(state, base=base)
    assert value["arm2_grasp_y"] == pytest.approx(forces[1, 1], abs=1e-8)
    assert [label.name for label in model.inputs][:7] == [
        "left_piezo1", "left_piezo2", "left_piezo3", "right_piezo1", "right_piezo2", "right_piezo3", "thrust_x",
    ]  # fmt: skip
    assert len(model.outputs) == len(model.C) == len(model.D)
    assert {label.unit for label in model.states} == {"m", "rad", "kg^0.5 m", "m/s", "rad/s", "kg^0.5 m/s"}


def test_packages_take_the_model_over() -> None:
    model = simulator().linearize()
    continuous, sampled = model.state_space(), model.discrete().state_space()
    assert continuous.dt is None
    assert sampled.dt == model.control_period == 2e-3
    np.testing.assert_array_equal(continuous.A, model.A)
    control = pytest.importorskip("control")
    system = model.discrete().control()
    assert system.dt == 2e-3
    assert system.input_labels[6] == "thrust_x"
    np.testing.assert_array_equal(system.B, model.discrete().B)
    assert isinstance(system, control.StateSpace)


def test_open_grasps_and_straight_arms_have_no_model() -> None:
    plant = simulator()
    state = plant.rest_state()
    state.q[3] += 1e-3
    with pytest.raises(ValueError, match="grasps are open"):
        plant.linearize(state)
    with pytest.raises(ValueError, match="sampled already"):
        plant.linearize().discrete().discrete()
    with pytest.raises(KeyError, match="thrust_z"):
        plant.linearize().find("inputs", "thrust_z")
