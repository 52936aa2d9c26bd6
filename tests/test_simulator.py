"""The simulator's face: states, commands and their limits, bad input, grasps and frames."""

import dataclasses
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sffr_gym import ConfigError, Simulator, State, load_params
from sffr_gym.physics.kinematics import grasp_points, rotation
from sffr_gym.physics.monolithic import constraint_jacobian

Array = NDArray[np.float64]

FIELDS = ("q", "qd", "qf", "qfd", "obj", "objd")
ALL_MODES = ("panel.axial_cut=1.0e+9", "panel.bending_cut=1.0e+9")
TABLE_IV = [0.0, 0.0, 0.0, 0.6, 4.2, 5.6, 2.1, np.pi / 7, np.pi / 36]
N_U = 6 + 3 + 6


@pytest.fixture(scope="module")
def simulator() -> Simulator:
    """Return the case study."""
    return Simulator()


@pytest.fixture(scope="module")
def free() -> Simulator:
    """Return the case study without its object, at rest."""
    rest = ("initial.qd=[0,0,0,0,0,0,0,0,0]", "initial.qfd=[0,0,0]")
    return Simulator(load_params().with_overrides("object=null", *rest))


def assert_same(a: State, b: State, atol: float = 0.0) -> None:
    """Compare every number of two states."""
    for name in FIELDS:
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=0, atol=atol, err_msg=name)


def test_start_is_that_of_table_iv(simulator: Simulator) -> None:
    """Coordinates, rates, and the object in the closed grippers, at rest relative to them."""
    state = simulator.initial_state()
    assert state.t == 0.0
    np.testing.assert_allclose(state.q, TABLE_IV, rtol=0, atol=1e-8)
    np.testing.assert_allclose(state.qd, [0.85, *[0.0] * 8], rtol=0, atol=1e-12)
    np.testing.assert_allclose(state.qf, np.zeros((2, 3)), rtol=0, atol=1e-15)
    np.testing.assert_allclose(state.qfd, np.tile([0.0, -0.1, 0.0], (2, 1)), rtol=0, atol=1e-13)
    np.testing.assert_allclose(state.obj, [1.420887, -0.037310, 0.075973], rtol=0, atol=5e-7)  # the digits given
    np.testing.assert_allclose(state.objd, [0.85, 0.0, 0.0], rtol=0, atol=1e-12)
    assert simulator.constraint_drift(state) < 1e-13


@pytest.mark.parametrize("elements", [1, 4])
def test_elastic_size_follows_the_elements(elements: int) -> None:
    """Shapes, and a start whose tips are the configured ones and whose panels carry no load but at the tip."""
    overrides = (f"panel.elements={elements}", "initial.qf=[[0, 0.2, 0.04], [0, -0.1, 0.0]]", *ALL_MODES)
    simulator = Simulator(load_params().with_overrides(*overrides))
    state = simulator.initial_state()
    assert (state.q.shape, state.qd.shape) == ((9,), (9,))
    assert (state.qf.shape, state.qfd.shape) == ((2, 3 * elements), (2, 3 * elements))
    assert simulator.mass_matrix(state).shape == (9 + 6 * elements, 9 + 6 * elements)
    assert simulator.bias(state).shape == (9 + 6 * elements,)
    qdd, qfdd, objdd = simulator.acceleration(state)
    assert (qdd.shape, qfdd.shape, objdd.shape) == ((9,), (2, 3 * elements), (3,))
    np.testing.assert_allclose(state.qf[:, -3:], [[0, 0.2, 0.04], [0, -0.1, 0.0]], rtol=0, atol=1e-12)
    rest = replace(state, qd=0 * state.qd, qfd=0 * state.qfd)
    load = simulator.bias(rest)[9:].reshape(2, -1)
    assert np.abs(load[:, -3:]).max() > 0.1
    np.testing.assert_allclose(load[:, :-3], 0.0, atol=1e-9)


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_start_with_moving_joints_keeps_the_grasps_closed(yaw: float) -> None:
    """Positions and velocities satisfy the pins, whatever the yaw and the rates; what is not held stays as given."""
    q, qd = [0.3, -0.2, yaw, *TABLE_IV[3:]], [0.85, 0.1, 0.2, 0.3, -0.1, 0.2, 0.1, 0.4, -0.3]
    simulator = Simulator(load_params().with_overrides(f"initial.q={q}", f"initial.qd={qd}"))
    state = simulator.initial_state()
    J, gap = constraint_jacobian(simulator.model, state.q, state.qd, state.obj)
    np.testing.assert_allclose(gap, 0.0, atol=1e-13)
    np.testing.assert_allclose(J @ np.concatenate([state.qd, state.objd]), 0.0, atol=1e-13)
    assert state.obj[2] == pytest.approx(yaw + 0.0759733, abs=1e-6)
    np.testing.assert_allclose(state.qd[[0, 1, 2, 7, 8]], [0.85, 0.1, 0.2, 0.4, -0.3], rtol=1e-14)


def test_grasp_out_of_reach_is_rejected() -> None:
    """Nothing is moved by more than rounding; the message names the keys to change."""
    far = Simulator(load_params().with_overrides("object.grasps.0.point=[0.0, 0.5]"))
    with pytest.raises(ConfigError, match=r"initial\.q: the end-effectors do not reach .* object\.grasps"):
        far.initial_state()


def test_without_an_object_there_is_none(free: Simulator) -> None:
    """No pose, no velocity, no grasp forces, and a step that works."""
    state = free.step(free.initial_state(), base=[1.0, 0.0, 0.0])
    assert state.obj is None
    assert state.objd is None
    assert free.grasp_forces(state).shape == (0, 2)
    assert free.constraint_drift(state) == 0.0
    assert state.qd[0] > 0.0


def test_step_returns_a_new_state_and_touches_nothing_else(simulator: Simulator) -> None:
    """The old state keeps its numbers, results share no memory with it or with each other, and cannot be reassigned."""
    start = simulator.initial_state()
    before = {name: getattr(start, name).copy() for name in FIELDS}
    first = simulator.step(start, base=[5.0, 0.0, 0.0])
    kept = {name: getattr(first, name).copy() for name in FIELDS}
    second = simulator.step(first, base=[-50.0, 3.0, 0.0])
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(start, name), before[name])
        np.testing.assert_array_equal(getattr(first, name), kept[name])
        assert not np.shares_memory(getattr(first, name), getattr(start, name))
        assert not np.shares_memory(getattr(first, name), getattr(second, name))
    with pytest.raises(dataclasses.FrozenInstanceError):
        start.t = 1.0


def test_a_step_takes_the_control_period_unless_told(simulator: Simulator) -> None:
    """Time and motion follow dt; the default is the control period."""
    start = simulator.initial_state()
    assert simulator.step(start).t == 0.002
    assert_same(simulator.step(start), simulator.step(start, dt=0.002))
    later = simulator.step(replace(start, t=3.0), dt=np.float64(0.5))
    assert later.t == 3.5
    assert later.q[0] == pytest.approx(0.85 * 0.5, rel=0.01)
    slower = Simulator(load_params().with_overrides("control.period=0.005"))
    assert slower.step(slower.initial_state()).t == 0.005


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"base": [1.0, 2.0]}, r"base must have shape \(3,\), got \(2,\)"),
        ({"joints": 1.0}, r"joints must have shape \(6,\), got \(\)"),
        ({"joints": np.zeros((1, 6))}, r"joints must have shape \(6,\), got \(1, 6\)"),
        ({"piezo_tau": np.zeros(6)}, r"piezo_tau must have shape \(2, 3\), got \(6,\)"),
        ({"piezo_volts": np.zeros((3, 2))}, r"piezo_volts must have shape \(2, 3\), got \(3, 2\)"),
        ({"wrench": np.zeros(6)}, r"wrench must have shape \(3,\)"),
        ({"base": [0.0, np.nan, 0.0]}, "base has entries that are not finite"),
        ({"joints": np.full(6, np.inf)}, "joints has entries that are not finite"),
        ({"piezo_tau": np.full((2, 3), np.nan)}, "piezo_tau has entries that are not finite"),
        ({"piezo_volts": np.full((2, 3), -np.inf)}, "piezo_volts has entries that are not finite"),
        ({"wrench": [np.nan, 0.0, 0.0]}, "wrench has entries that are not finite"),
        ({"piezo_tau": np.zeros((2, 3)), "piezo_volts": np.zeros((2, 3))}, "piezo_tau or piezo_volts, not both"),
    ],
)
def test_bad_commands_are_rejected(simulator: Simulator, bad: dict[str, Any], message: str) -> None:
    """By everything that takes a command, with the name, what is allowed and what was given."""
    state = simulator.initial_state()
    for function in (simulator.step, simulator.acceleration, simulator.q_flex, simulator.grasp_forces):
        with pytest.raises(ValueError, match=message):
            function(state, **bad)


@pytest.mark.parametrize("dt", [-0.002, 0.0, np.nan, np.inf])
def test_durations_must_be_positive(simulator: Simulator, dt: float) -> None:
    """Backwards, nothing, no number and for ever are rejected."""
    with pytest.raises(ValueError, match=r"dt must be a positive number of seconds, got"):
        simulator.step(simulator.initial_state(), dt=dt)


@pytest.mark.parametrize(("key", "value"), [("integrator", "euler"), ("coupling", "loose"), ("max_step", -1e-3)])
def test_unknown_settings_are_rejected(key: str, value: Any) -> None:
    """At construction, by a ValueError that names the key."""
    with pytest.raises(ValueError, match=f"simulation.{key} = "):
        Simulator(**{key: value})


@pytest.mark.parametrize("defect", ["not a number", "no object", "other panels"])
def test_bad_states_are_rejected(simulator: Simulator, defect: str) -> None:
    """A state that is not finite or not this robot's raises a ValueError that says so."""
    state = simulator.initial_state()
    bad = {
        "not a number": {"q": state.q * np.nan},
        "no object": {"obj": None, "objd": None},
        "other panels": {"qf": np.zeros((2, 6)), "qfd": np.zeros((2, 6))},
    }[defect]
    with pytest.raises(ValueError, match=r"state|finite"):
        simulator.step(replace(state, **bad))


def test_limits_clip_each_actuator_and_say_so(simulator: Simulator) -> None:
    """Beyond its limit a command is cut, at the limit and below it is not; the flags follow an action's order."""
    base, joints = [150.0, -100.0, -101.0], [7.5, -8.0, 6.9, 0.0, 7.0, -7.0]
    tau = np.array([[60.0, -1.0, 0.0], [0.0, 47.5, -47.6]])
    applied = simulator.applied(base=base, joints=joints, piezo_tau=tau)
    np.testing.assert_allclose(applied.base, [100.0, -100.0, -100.0])
    np.testing.assert_allclose(applied.joints, [7.0, -7.0, 6.9, 0.0, 7.0, -7.0])
    np.testing.assert_allclose(applied.piezo_tau, [[47.5, -1.0, 0.0], [0.0, 47.5, -47.5]])
    np.testing.assert_allclose(applied.volts, np.array([[47.5, -1.0, 0.0], [0.0, 47.5, -47.5]]) * 200.0 / 47.5)
    assert applied.saturated.dtype == bool
    assert applied.saturated.shape == (N_U,)
    assert set(np.flatnonzero(applied.saturated)) == {0, 5, 6, 8, 9, 10}
    volts = simulator.applied(piezo_volts=np.array([[201.0, -200.0, 3.0], [0.0, -500.0, 199.0]]))
    np.testing.assert_allclose(volts.volts, [[200.0, -200.0, 3.0], [0.0, -200.0, 199.0]])
    assert set(np.flatnonzero(volts.saturated)) == {0, 4}
    assert not simulator.applied().saturated.any()
    start = simulator.initial_state()
    cut = {"base": applied.base, "joints": applied.joints, "piezo_volts": applied.volts}
    assert_same(simulator.step(start, base=base, joints=joints, piezo_tau=tau), simulator.step(start, **cut))


def test_piezo_forces_become_voltages_and_back(simulator: Simulator) -> None:
    """Within the limits tau -> volts -> tau is the identity, and both ways of asking give the same motion."""
    tau = np.random.default_rng(0).uniform(-47.0, 47.0, (2, 3))
    applied = simulator.applied(piezo_tau=tau)
    np.testing.assert_allclose(applied.piezo_tau, tau, rtol=1e-13)
    start = simulator.initial_state()
    by_force, by_volts = simulator.step(start, piezo_tau=tau), simulator.step(start, piezo_volts=applied.volts)
    assert_same(by_force, by_volts, 1e-14)
    assert np.abs(by_force.qfd - simulator.step(start).qfd).max() > 0.01


def test_wrench_adds_to_the_thrust_without_limit(simulator: Simulator) -> None:
    """Five times the thrusters' limit accelerates five times as much."""
    state, thrust = simulator.initial_state(), np.array([100.0, -50.0, 20.0])
    rest, pushed, loaded = (np.concatenate(simulator.acceleration(state, **command)[::2]) for command in (
        {}, {"base": thrust}, {"base": thrust, "wrench": 4 * thrust}
    ))  # fmt: skip
    np.testing.assert_allclose(loaded - rest, 5 * (pushed - rest), rtol=0, atol=1e-10)


def test_thrust_is_along_the_base_axes(free: Simulator) -> None:
    """On a base turned by 2 rad and off the origin: impulse R F dt, and its moment about the origin."""
    state, force, dt = free.initial_state(), np.array([40.0, -15.0]), 1e-4
    state = replace(state, q=np.array([3.0, -2.0, 2.0, *state.q[3:]]))
    moved = free.step(state, base=[*force, 8.0], dt=dt)
    fx, fy = rotation(2.0) @ force
    expected = np.array([fx, fy, 3.0 * fy + 2.0 * fx + 8.0]) * dt
    np.testing.assert_allclose(free.momentum(moved) - free.momentum(state), expected, rtol=1e-6)  # dt is short


@pytest.mark.parametrize("joint", range(6))
def test_joint_torque_has_its_reaction(free: Simulator, joint: int) -> None:
    """A torque opens its joint, turns what comes before the other way, and gives the robot no momentum."""
    state, torque = free.initial_state(), np.zeros(6)
    torque[joint] = 5.0
    qdd, _, _ = free.acceleration(state, joints=torque)
    assert qdd[3 + joint] > 0.1
    before = qdd[2] + (qdd[2 + joint] if joint in (1, 3) else 0.0)  # base, or the first link of a two-link arm
    assert before < -1e-3
    moved = free.step(state, joints=torque, dt=0.2)
    np.testing.assert_allclose(
        free.momentum(moved), 0.0, atol=1e-6
    )  # a truncation error; the torque's impulse is 1 N m s
    assert free.energy(moved) > 1e-2


def test_object_moves_as_the_grasp_forces_say(simulator: Simulator) -> None:
    """Newton and Euler for the object under minus the forces on the grippers."""
    command = {"base": [20.0, -10.0, 30.0], "joints": [1.0, -2.0, 0.5, 1.5, 0.2, -0.1]}
    state = simulator.initial_state()
    for _ in range(100):
        state = simulator.step(state, **command)
    assert abs(state.objd[2]) > 1e-3
    lam, (_, _, objdd) = simulator.grasp_forces(state, **command), simulator.acceleration(state, **command)
    r = grasp_points(simulator.model, state.obj) - state.obj[:2]
    np.testing.assert_allclose(-lam.sum(axis=0), 3.0 * objdd[:2], rtol=1e-10)
    assert -np.sum(r[:, 0] * lam[:, 1] - r[:, 1] * lam[:, 0]) == pytest.approx(0.5 * objdd[2], rel=1e-9)
    assert np.abs(lam).min() > 0.1


@pytest.mark.parametrize("kappa", [20.0, 0.0])
def test_grasps_stay_closed(kappa: float) -> None:
    """20 s of random small forces: drift below 1e-8 m as configured, and worse without the stabilisation."""
    simulator = Simulator(load_params().with_overrides(f"simulation.baumgarte={kappa}"))
    state, rng, drift = simulator.initial_state(), np.random.default_rng(1), 0.0
    for _ in range(1000):
        command = {"base": rng.uniform(-2, 2, 3), "joints": rng.uniform(-0.1, 0.1, 6)}
        state = simulator.step(state, **command, piezo_tau=rng.uniform(-0.1, 0.1, (2, 3)), dt=0.02)
        drift = max(drift, simulator.constraint_drift(state))
    assert np.abs(state.q[3:] - TABLE_IV[3:]).max() > 0.1
    assert (drift < 1e-8) == (kappa > 0)


def test_motion_is_the_same_in_every_inertial_frame(simulator: Simulator) -> None:
    """The same robot, moved by (5, -3) m, turned by 2 rad and drifting at (0.4, -0.7) m/s, moves in the same way."""
    shift, angle, drift = np.array([5.0, -3.0]), 2.0, np.array([0.4, -0.7])
    start = simulator.initial_state()
    start = replace(start, qfd=np.array([[0.0, -0.1, 0.05], [0.0, 0.1, 0.1]]))
    R = rotation(angle)

    def seen(state: State) -> State:
        def pose(x: Array) -> Array:
            return np.array([*(R @ x[:2] + shift + drift * state.t), x[2] + angle, *x[3:]])

        def velocity(x: Array) -> Array:
            return np.array([*(R @ x[:2] + drift), *x[2:]])

        obj, objd = pose(state.obj), velocity(state.objd)
        return replace(state, q=pose(state.q), qd=velocity(state.qd), obj=obj, objd=objd)

    command = {"base": [6.0, -3.0, 30.0], "joints": [0.5, -0.3, 0.2, 0.4, 0.1, -0.1], "piezo_tau": np.full((2, 3), 0.2)}
    here, there = start, seen(start)
    for _ in range(200):
        here, there = simulator.step(here, **command), simulator.step(there, **command)
    assert abs(here.q[2]) > 1e-3
    assert_same(there, seen(here), 1e-9)
