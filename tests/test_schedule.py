"""Schedules of the virtual damping: what they see, what the network makes of it, and when they yield to the law."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import eigh

from sffr_baselines import make_policy
from sffr_baselines.damping_env import SFFRFlexDampingEnv
from sffr_baselines.learned import LearnedSchedule, Network, load_schedule, save_schedule
from sffr_baselines.schedule import BASE_ERROR, N_FEATURES
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.kinematics import rotation

MASS, LENGTH, EI = 9.0, 4.0, 20.0
M = MASS * np.array([[13 / 35, -11 / 210 * LENGTH], [-11 / 210 * LENGTH, LENGTH**2 / 105]])  # of q5 and q6
K = EI / LENGTH**3 * np.array([[12.0, -6.0 * LENGTH], [-6.0 * LENGTH, 4.0 * LENGTH**2]])
BOUND = np.array([1.0] * 4 + [3.0, 5.0, 5.0] + [1.0] * 8 + [2.0, 2.0, 3.0])  # of what is seen, as documented
PUSHED = -np.linalg.solve(K, MASS * np.array([0.5, -LENGTH / 12.0]))  # tip under a root's acceleration of 1 m/s2


def pair(seed, **arguments):
    """A scheduled environment and the plain one, both at the start of the same episode, with their observations."""
    damping = SFFRFlexDampingEnv(law="hsc", **arguments)
    bare = SFFRFlexEnv(damping._distribution(damping.scenario), damping.params)
    return damping, bare, damping.reset(seed=seed)[0], bare.reset(seed=seed)[0]


def features(env, obs, heading_turns):
    """The observation of a schedule (n_p, 18) at the start, from a plain one by the case study's numbers."""
    path, rows = env.params.path, []
    speed, turn = path.speed, path.speed / path.radius if heading_turns else 0.0
    field = {name: obs[each.slice] for name, each in env.fields.items()}
    base = np.array([env.episode.reference.base_x, env.episode.reference.base_y])
    values, modes = eigh(K, M)
    for i, mount in enumerate(env.params.panel.mounts):
        across = rotation(mount.angle)[:, 1]
        push = across @ (field["reference_acceleration"] - turn**2 * (base + mount.root))
        spin = speed / path.radius - turn  # of the acceleration in the observation's axes
        push_rate = spin * across @ rotation(np.pi / 2) @ field["reference_acceleration"]
        side = np.sign(push)
        x = modes.T @ M @ (field["elastic"].reshape(-1, 3)[i, 1:] - PUSHED * push) * np.sqrt(values)
        xd = modes.T @ M @ (field["elastic_rate"].reshape(-1, 3)[i, 1:] - PUSHED * push_rate)
        energy, scale = 0.5 * (x @ x + xd @ xd), env.params.reward.vibration.scale
        motion = side * np.column_stack([x, xd]).ravel() / np.sqrt(2.0 * (energy + 1e-6 * scale))
        first, second = motion[0] + 1j * motion[1], motion[2] + 1j * motion[3]
        rows.append([
            *motion, 0.5 * np.log10(energy / scale + 1e-6), side * push / (speed**2 / path.radius),
            side * push_rate / (speed**3 / path.radius**2), (first**2).real, (first**2).imag, (second**2).real,
            (second**2).imag, *2.0 * np.outer(motion[:2], motion[2:]).ravel(), *np.log10([1e-2, 1e-2]),
            np.log10(off_path(env, field) / 3e-3 + 1e-3),
        ])  # fmt: skip
    return np.array(rows)


def off_path(env, field):
    """Error of the base [m]: turns as the shifts that they make, rates as the errors of half a second."""
    lever = np.hypot(*env.params.panel.mounts[0].root) + 0.5 * env.params.panel.length
    shift = np.hypot(*field["base_error"]) + lever * abs(field["yaw_error"][0])
    return shift + 0.5 * (np.hypot(*field["base_error_rate"]) + lever * abs(field["yaw_error_rate"][0]))


@pytest.mark.parametrize(
    ("seed", "heading", "scenario"),
    [(seed, heading, "excited") for heading in ("fixed", "tangent") for seed in (0, 1, 2)] + [(3, "fixed", "offset")],
)
def test_features_are_the_modes_about_the_quasi_static_shape(seed, heading, scenario):
    """The sign of a mode's shape is free, the same for displacement and rate and for all panels."""
    _, bare, seen, obs = pair(seed, overrides=(f"path.heading={heading}",), scenario=scenario)
    expected = features(bare, obs, heading == "tangent")
    found = seen.reshape(expected.shape).astype(float)
    signs = np.ones(2)
    for m in range(2):
        signs[m] = np.sign((found[:, 2 * m : 2 * m + 2] * expected[:, 2 * m : 2 * m + 2]).sum())
        expected[:, 2 * m : 2 * m + 2] *= signs[m]
    expected[:, 11:15] *= signs.prod()
    np.testing.assert_allclose(found, np.clip(expected, -BOUND, BOUND), rtol=1e-4, atol=1e-5)
    if scenario == "offset":  # off its path by centimetres, where the panels of Table IV begin straight
        assert (found[:, BASE_ERROR] > 0.5).all()
    else:
        assert np.abs(found[:, :4]).min() > 1e-4


def test_observations_have_the_documented_ranges():
    """Of both signs, panel by panel."""
    space = SFFRFlexDampingEnv().observation_space
    np.testing.assert_array_equal(space.high, np.tile(BOUND, 2))
    np.testing.assert_array_equal(space.low, -space.high)


@pytest.mark.parametrize("squash", [True, False])
@pytest.mark.parametrize("relu", [True, False])
@pytest.mark.parametrize("panels", [1, 2])
def test_compiled_network_decides_as_in_numpy(panels, relu, squash):
    damping, bare, seen, obs = pair(3)
    rng, widths = np.random.default_rng(0), (N_FEATURES * panels, 5, 6, 4, 2 * panels)
    matrices = tuple(0.4 * rng.normal(size=(n_out, n_in)) for n_in, n_out in pairwise(widths))
    biases = (*(0.4 * rng.normal(size=n) for n in widths[1:-1]), np.tile([0.3, -3.0], panels))  # some beyond the bound
    network = Network(matrices, biases, relu, squash)
    schedule = LearnedSchedule.of(network, damping, {})
    obs[bare.fields["yaw_rate"].slice] = 0.0  # whose force is not the damping's
    scheduled, law = (
        policy(obs)[:6].reshape(2, 3)[:, 1:] for policy in (schedule.policy(bare.params), make_policy("hsc", bare))
    )
    decision = schedule.predict(seen)[0].reshape(2, 2)
    np.testing.assert_allclose(scheduled / law, 10.0**decision, rtol=1e-4)
    assert np.ptp(decision) > 0.1 and np.abs(decision).max() <= 1.0
    assert squash or decision.min() == -1.0


def test_exported_schedule_yields_to_the_law_as_in_training(tmp_path):
    """The tolerance goes with the file: an action counts less while the base is off its path, or drifts off it."""
    env = SFFRFlexDampingEnv(law="hsc", base_tolerance=0.1)
    network = Network((np.zeros((2, N_FEATURES)),), (np.ones(2),), relu=False, squash=False)
    save_schedule(tmp_path / "policy.npz", LearnedSchedule.of(network, env, {}))
    schedule = load_schedule(tmp_path / "policy.npz")
    assert schedule.base_tolerance == 0.1
    bare = SFFRFlexEnv()
    lever = np.hypot(*bare.params.panel.mounts[0].root) + 0.5 * bare.params.panel.length  # of a panel's middle
    obs, _ = bare.reset(seed=0)
    obs[bare.fields["elastic_rate"].slice] = [0.0, 0.01, 0.02, 0.0, -0.01, 0.03]
    obs[bare.fields["yaw_rate"].slice] = 0.0  # whose force is not the damping's
    for part, error in (
        ({}, 0.0),
        ({"base_error": [0.03, -0.04], "yaw_error": [-0.01]}, 0.05 + 0.01 * lever),
        ({"base_error_rate": [0.06, 0.08]}, 0.5 * 0.1),
        ({"yaw_error_rate": [0.02]}, 0.5 * 0.02 * lever),
    ):
        seen = obs.copy()
        for name in ("base_error", "yaw_error", "base_error_rate", "yaw_error_rate"):
            seen[bare.fields[name].slice] = part.get(name, 0.0)
        policies = schedule.policy(bare.params), make_policy("hsc", bare.params)
        scheduled, law = (policy(seen)[:6] for policy in policies)
        driven = law != 0.0
        weight = 1.0 / (1.0 + (error / 0.1) ** 2)
        np.testing.assert_allclose(scheduled[driven] / law[driven], 10.0**weight, rtol=1e-9)
        assert driven.any()
