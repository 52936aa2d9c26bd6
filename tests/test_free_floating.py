"""A robot without thrusters: momentum is conserved, the law moves object and joints, the base gives way."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sffr_baselines import make_policy
from sffr_baselines.free_floating import _solve
from sffr_baselines.rollout import rollout
from sffr_gym import SFFRFlexEnv, load_params
from sffr_gym.physics.simulator import Simulator

FREE = ["actuators.thrusters=none", "path.radius=1.0e+5"]  # nearly a straight path, which momentum allows
SHORT = {"name": "short", "description": "a test's", "duration": 3.0}


def run(law, overrides=(), scenario=SHORT, periods=1500):
    """Return the environment at the end, its states on the way and the object's errors [m]."""
    env = SFFRFlexEnv(scenario, overrides=[*FREE, *overrides])
    policy = make_policy(law, env)
    obs, _ = env.reset(seed=0)
    policy.reset()
    states, errors = [env.state()], []
    for _ in range(periods):
        obs, _, terminated, _, info = env.step(policy(obs))
        assert not terminated, info["failure"]
        assert not info["applied"][6:9].any()
        states.append(env.state())
        errors.append(info["object_error"])
    return env, states, np.array(errors)


@pytest.mark.parametrize("law", ["ahsc", "none", "lqr-ff"])
def test_object_is_tracked_without_thrusters(law):
    """To nanometres where the plant is the law's, while the panels swing and the base gives way by millimetres."""
    env, states, errors = run(law)
    assert np.sqrt(np.mean(errors**2)) < 2.0e-8
    moved = np.hypot(*(states[-1].q[:2] - states[0].q[:2] - [0.85 * 3.0, 0.0]))
    assert 1.0e-4 < moved < 0.1 and abs(states[-1].q[2]) > 1.0e-3
    held = env.fields["hold_error"]
    assert np.abs(env.get_state()["batch"].obs[0, held.slice]).max() < 1.0e-6


def test_from_the_first_period_on_the_base_goes_where_momentum_takes_it():
    """Errors are those of holding a command: a tenth more of the base's acceleration gives thirty times as much."""
    env, _, errors = run("ahsc", periods=20)
    assert np.abs(errors).max() < 4.0e-9
    assert np.abs(env.get_state()["batch"].obs[0, env.fields["hold_error"].slice]).max() < 1.5e-7


@pytest.mark.parametrize("seed", range(4))
def test_the_base_is_solved_for_by_cramers_rule(seed):
    """Against LAPACK, for matrices without any symmetry."""
    rng = np.random.default_rng(seed)
    A, b, x = rng.normal(size=(3, 3)), rng.normal(size=3), np.full(3, np.nan)
    _solve(A, b, x)
    assert_allclose(x, -np.linalg.solve(A, b), rtol=1e-10)


def test_a_law_that_believes_in_a_held_base_does_worse():
    """The same torques without the base's own acceleration in them: what the momentum-consistent one is worth."""
    _, _, errors = run("ahsc")
    prior = load_params().with_overrides("path.radius=1.0e+5")
    env = SFFRFlexEnv({**SHORT, "plant": {"settings": ["actuators.thrusters=none"]}}, params=prior)
    policy = make_policy("ahsc", env)
    wrong = rollout(env, policy, seed=0).signals[:, 0]
    assert np.sqrt(np.mean(wrong**2)) > 1.0e3 * np.sqrt(np.mean(errors**2))


def test_momentum_is_conserved_and_says_where_the_base_goes():
    """Nothing pushes the robot: its centre of mass goes on straight, so that the base's drift is that of the rest."""
    env, states, _ = run("ahsc")
    sim = Simulator(env.params)
    momentum = np.array([sim.momentum(state) for state in states[::100]])
    assert_allclose(momentum - momentum[0], 0.0, atol=1e-7)
    params = env.params
    total = params.base.mass + 2 * params.panel.mass + params.object.mass
    total += sum(link.mass for arm in params.arms for link in arm.links)

    def centre(state):
        """The centre of mass, by the momentum of the same configuration with a unit velocity of each coordinate."""
        return _centre_of_mass(params, state) / total

    straight = centre(states[0]) + momentum[0, :2] / total * states[-1].t
    assert_allclose(centre(states[-1]), straight, atol=1e-8)


def _centre_of_mass(params, state):
    """The first moment of all masses [kg m], body by body; a panel's from its shape, of one element."""
    first = params.base.mass * state.q[:2] + params.object.mass * state.obj[:2]
    c, s = np.cos(state.q[2]), np.sin(state.q[2])
    turn = np.array([[c, -s], [s, c]])
    joint = 3
    for arm in params.arms:
        place, angle = state.q[:2] + turn @ arm.mount, state.q[2] + arm.mount_angle
        for link in arm.links:
            angle += state.q[joint]
            joint += 1
            direction = np.array([np.cos(angle), np.sin(angle)])
            first = first + link.mass * (place + link.com * direction)
            place = place + link.length * direction
    x, weights = np.polynomial.legendre.leggauss(5)
    for i, mount in enumerate(params.panel.mounts):
        axis = np.array([np.cos(state.q[2] + mount.angle), np.sin(state.q[2] + mount.angle)])
        normal, L = np.array([-axis[1], axis[0]]), params.panel.length
        u, w, slope = state.qf[i]
        for xi, weight in zip((x + 1) / 2, weights / 2, strict=True):
            across = w * (3 * xi**2 - 2 * xi**3) + slope * L * (xi**3 - xi**2)
            point = state.q[:2] + turn @ mount.root + (L + u) * xi * axis + across * normal
            first = first + params.panel.mass * weight * point
    return first


def test_thruster_channels_stay_in_the_action_and_do_nothing():
    """Spaces, indices and policies of the robot with thrusters fit; whatever is asked of these, nothing happens."""
    free, usual = SFFRFlexEnv(SHORT, overrides=FREE), SFFRFlexEnv(SHORT)
    assert free.action_space == usual.action_space and free.observation_space == usual.observation_space
    results = []
    for thrust in (0.0, 1.0):
        free.reset(seed=0)
        action = np.zeros(15)
        action[6:9] = thrust
        for _ in range(10):
            *_, info = free.step(action)
        assert info["thruster_saturated"] == 0.0 and not info["applied"].any()
        results.append(free.positions)
    np.testing.assert_array_equal(*results)


def test_without_an_object_the_grippers_go_where_they_should():
    """The formation of the start, with a robot that carries nothing."""
    env, _, _ = run("ahsc", ["object=null"], periods=200)
    held = env.fields["hold_error"]
    assert np.abs(env.get_state()["batch"].obs[0, held.slice]).max() < 1.0e-6
