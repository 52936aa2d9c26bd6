"""The impedance law against an independent rigid robot: it commands exactly the accelerations of Eqs. 9 and 12."""

import numpy as np
import pytest
from commanded import Commanded
from grasping_robots import LIGHT, ROBOTS, grasping_params
from observer import Observer
from oracle import Oracle

from sffr_baselines import make_policy
from sffr_baselines.laws import LawPolicy, make_law
from sffr_gym.config.params import load_params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.initial import close_grasps, match_joint_rates
from sffr_gym.physics.kinematics import perpendicular, rotation
from sffr_gym.physics.simulator import Simulator
from sffr_gym.task.reference import desired


def rigid_oracle(params):
    """The independent model of the robot without its panels."""
    config = params.to_dict()
    config["panel"] = None
    return Oracle(config)


def task_accelerations(oracle, q, qd, qdd, grasping):
    """Accelerations of the base (3,) and of the tips (n_g, 2) that follow from qdd."""
    tips = [oracle.tip_jacobian(q, arm) @ qdd + oracle.tip_jacobian_dot_zd(q, qd, arm) for arm in grasping]
    return qdd[:3], np.array(tips)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize(("seed", "tick"), [(0, 0), (1, 12_345), (2, 40_000)])
def test_law_is_the_inverse_dynamics_of_the_commanded_accelerations(name, seed, tick):
    """At random states, the law and the reaction of the object give every task coordinate its acceleration."""
    params = ROBOTS[name]()
    observer = Observer(params)
    p, v = observer.perturbed(seed)
    state, wanted = Simulator(params).unflatten(0.0, p, v), Commanded(observer, p, v, tick)
    oracle = rigid_oracle(params)
    grasping = [int(arm) for arm in observer.model.grasp_arm]
    force = wanted.Q - oracle.bias(state.q, state.qd)
    for arm, grip in zip(grasping, wanted.grip, strict=True):
        force -= oracle.tip_jacobian(state.q, arm).T @ grip
    qdd = np.linalg.solve(oracle.mass_matrix(state.q), force)
    base, tips = task_accelerations(oracle, state.q, state.qd, qdd, grasping)
    scale = np.abs(qdd).max()
    np.testing.assert_allclose(base, wanted.base, rtol=0, atol=1e-10 * scale)
    np.testing.assert_allclose(tips.ravel(), wanted.tips.ravel(), rtol=0, atol=1e-10 * scale)
    for joint, acceleration in wanted.held.items():
        assert qdd[3 + joint] == pytest.approx(acceleration, abs=1e-10 * scale)
    assert len(wanted.held) + 2 * len(grasping) == params.n_links or name == "three arms"


def carried(observer, t):
    """Positions and velocities of robot and object that move as one with the desired motion, and that of the base."""
    now, p, v = desired(observer.reference, t), observer.p.copy(), np.zeros_like(observer.v)
    at, turn = observer.model.at.object, rotation(now.heading)
    away = turn @ (observer.p[:2] - observer.p[at : at + 2])
    p[:2], p[2] = np.add(away, [now.x, now.y]), observer.p[2] + now.heading
    p[at:] = now.x, now.y, observer.p[at + 2] + now.heading
    v[:2], v[2] = np.add(now.turn * perpendicular(away), [now.xd, now.yd]), now.turn
    v[at:] = now.xd, now.yd, now.turn
    return p, v


@pytest.mark.parametrize(
    "path",
    [
        ["kind=slew", "turn=1.0"],
        ["kind=figure-eight", "radius=5", "heading=tangent"],
        ["kind=waypoints", "heading=tangent"],
    ],
)
def test_a_formation_that_turns_unevenly_is_accelerated_with_its_path(path):
    """On it, without any error: base and object as differences of their desired motion have it, no joint at all."""
    params = grasping_params([*LIGHT, "initial.q.2=0.2"], arms=2).with_overrides(*(f"path.{key}" for key in path))
    params = params.with_overrides("initial.qd=null", "initial.qf=[0, 0, 0]")
    observer, tick, h = Observer(params), 1_200, 1.0e-3
    t = tick * params.control.period
    p, v = carried(observer, t)
    command = make_policy("none", params)(observer(p, v, tick)) * observer.robot.scale
    simulator = Simulator(params)
    volts, base, joints = simulator.split(command)
    qdd, _, xdd = simulator.acceleration(simulator.unflatten(t, p, v), base=base, joints=joints, piezo_volts=volts)
    (before, _), (after, _) = (carried(observer, t + shift) for shift in (-h, h))
    wanted = (before - 2.0 * p + after) / h**2
    scale = np.abs(wanted).max()
    np.testing.assert_allclose(qdd, wanted[: len(qdd)], rtol=0, atol=1e-4 * scale)
    np.testing.assert_allclose(xdd, wanted[observer.model.at.object :], rtol=0, atol=1e-4 * scale)
    assert abs(desired(observer.reference, t).turn_acceleration) > 1e-3


@pytest.mark.parametrize("name", ["paper", "yawed, tangent", "three arms"])
def test_grip_forces_are_those_of_the_pseudo_inverse(name):
    """What the object adds to the torques of the grasping arms is J' F_e with F_e = pinv(G) M v (Eqs. 10 and 11)."""
    params = ROBOTS[name]()
    observer = Observer(params)
    p, v = observer.perturbed(4)
    loaded = Commanded(observer, p, v, 5_000)
    empty = Observer(params.with_overrides("object.mass=1.0e-9", "object.inertia=1.0e-9"))
    torque = (loaded.Q - Commanded(empty, p, v, 5_000).Q)[3:]
    q = Simulator(params).unflatten(0.0, p, v).q
    oracle = rigid_oracle(params)
    for grip, arm in zip(loaded.grip, observer.model.grasp_arm, strict=True):
        joints = range(observer.model.arm_first[arm], observer.model.arm_first[arm + 1])
        J = oracle.tip_jacobian(q, int(arm))[:, [3 + k for k in joints]]
        np.testing.assert_allclose(np.linalg.solve(J.T, torque[joints]), grip, rtol=0, atol=1e-7 * np.abs(grip).max())


@pytest.mark.parametrize("name", ["paper", "third link", "yawed, tangent"])
def test_error_obeys_its_law_on_a_rigid_plant(name):
    """Robot and object, pinned together off the path, start with edd + Kd ed + Kp e = 0, the grip forces as planned."""
    params = ROBOTS[name]()
    observer = Observer(params)
    p, v = observer.p.copy(), observer.v.copy()
    turn = params.path.speed / params.path.radius if params.path.heading == "tangent" else 0.0
    # Base and object are off the path by themselves; the object keeps its orientation, so that errors of tips and
    # object agree beyond the first order. The arms close the gaps.
    p[:3] += [0.011, -0.013, 0.012]
    p[-3:-1] += [-0.007, 0.009]
    v[:3] += [0.02, -0.03, 0.05 + turn]
    v[-3:] += [0.03, 0.02, turn]
    close_grasps(observer.model, p)
    match_joint_rates(observer.model, p, v)
    state, wanted = Simulator(params).unflatten(0.0, p, v), Commanded(observer, p, v, 0)
    oracle = rigid_oracle(params)
    qdd, xdd, lam = oracle.constrained(state.q, state.qd, state.obj, state.objd, wanted.Q)
    scale = np.abs(wanted.base).max()
    base, tips = task_accelerations(oracle, state.q, state.qd, qdd, [0, 1])
    np.testing.assert_allclose(base, wanted.base, rtol=0, atol=1e-9 * scale)
    np.testing.assert_allclose(tips, wanted.tips, rtol=0, atol=1e-9 * scale)
    np.testing.assert_allclose(xdd, wanted.object, rtol=0, atol=1e-9 * scale)
    np.testing.assert_allclose(lam, -wanted.grip, rtol=0, atol=1e-9 * np.abs(wanted.grip).max())


def test_simulator_with_light_panels_obeys_the_same_law():
    """The plant of the environment, its panels nearly without mass, starts with the commanded accelerations."""
    params = load_params().with_overrides(*LIGHT)
    observer = Observer(params)
    p, v = observer.p.copy(), observer.v.copy()
    for pose in (slice(0, 2), slice(-3, -1)):
        p[pose] += [3e-4, -2e-4]
        v[pose] += [-2e-3, 1e-3]
    wanted = Commanded(observer, p, v, 0)
    simulator = Simulator(params)
    state = simulator.unflatten(0.0, p, v)
    assert state.q[2] == 0.0  # base and inertial axes agree
    qdd, _, xdd = simulator.acceleration(state, base=wanted.Q[:3], joints=wanted.Q[3:])
    np.testing.assert_allclose(qdd[:3], wanted.base, rtol=0, atol=1e-6)
    np.testing.assert_allclose(xdd, wanted.object, rtol=0, atol=1e-6)


def test_sampled_errors_decay_as_designed(user_scenario):
    """On a rigid plant, errors follow the double integrator under the sampled and held law for half a second."""
    file = user_scenario(offset_position=0.05, duration=0.5)
    env = SFFRFlexEnv(file, overrides=[*LIGHT, "actuators.thruster_force=1.0e+4", "actuators.joint_torque=1.0e+4"])
    policy = make_policy("none", env)
    obs, _ = env.reset(seed=2)
    T, Kp, Kd = env.params.control.period, env.params.control.Kp, env.params.control.Kd
    places = {name: env.fields[name].slice for name in ("base_error", "object_error", "tip_error")}
    e = {name: obs[at].copy() for name, at in places.items()}
    ed = {name: obs[env.fields[f"{name}_rate"].slice].copy() for name in places}
    largest = np.abs(e["object_error"]).max()
    assert largest > 0.02
    truncated = False
    while not truncated:
        obs, _, terminated, truncated, _ = env.step(policy(obs))
        assert not terminated
        for name, at in places.items():
            edd = -Kd * ed[name] - Kp * e[name]
            e[name] += T * ed[name] + T**2 / 2 * edd
            ed[name] += T * edd
            # Held forces are not quite held accelerations: joints and reference turn within a period.
            np.testing.assert_allclose(obs[at], e[name], rtol=0, atol=2e-3 * largest)
    assert np.abs(obs[places["object_error"]]).max() < 0.3 * largest


@pytest.mark.parametrize("name", ["paper", "yawed, tangent", "three arms", "no object"])
def test_integrals_add_to_the_error_law(name):
    """An integral z of each tracked error acts as Ki z / Kd more of the error's rate does."""
    params = ROBOTS[name]().with_overrides("control.Ki=600")
    observer = Observer(params)
    policy = LawPolicy("none", make_law("none", params))
    obs, tracked = observer(*observer.perturbed(5), 7_000), policy.law.observer
    z = np.random.default_rng(5).uniform(-0.3, 0.3, len(tracked.error))
    policy(obs)
    policy.states.integral[0] = z
    integrated = policy(obs)
    policy.states.integral[0] = 0.0
    assert np.abs(integrated - policy(obs)).max() > 1e-3
    policy.states.integral[0] = 0.0
    obs[tracked.rate] += 600.0 * z / params.control.Kd
    np.testing.assert_allclose(integrated, policy(obs), rtol=1e-9, atol=1e-12)
