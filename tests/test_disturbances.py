"""Noise, delay and impulses: what they are, that they reach observation or base alone and depend on nothing else."""

import numpy as np
import pytest

from sffr_gym import Simulator
from sffr_gym.compile.kernels import kernel
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.physics.kinematics import rotation
from sffr_gym.task.disturbances import Sensing, add_noise, philox, sense
from sffr_gym.task.episode import draw, nominal
from sffr_gym.task.reward import REWARDS
from sffr_gym.task.scenario import load_scenario
from sffr_gym.task.signals import SIGNALS
from sffr_gym.task.task_model import make_task_model

N_ACTIONS, N_OBS = 15, 52
MASK = 0xFFFFFFFF


@kernel
def words(tick, block, key):
    """Four random words."""
    return philox(tick, block, key)


@kernel
def fill_noises(level, bound, key, noise):
    """Fill the noise (n_ticks, n_o) of an episode."""
    for tick in range(len(noise)):
        add_noise(Sensing(level, key, 0, 0.0 * level, 0), tick, bound, noise[tick])


def noises(level, key, n_ticks):
    """The noise (n_ticks, n_o) of an episode."""
    noise = np.zeros((n_ticks, len(level)))
    fill_noises(level, np.full(len(level), 1e3), key, noise)
    return noise


def philox_in_words(counter, key):
    """Philox4x32-10 as its authors write it, in Python's integers."""
    c, k = list(counter), list(key)
    for _ in range(10):
        low, high = 0xD2511F53 * c[0], 0xCD9E8D57 * c[2]
        c = [(high >> 32) ^ c[1] ^ k[0], high & MASK, (low >> 32) ^ c[3] ^ k[1], low & MASK]
        k = [(k[0] + 0x9E3779B9) & MASK, (k[1] + 0xBB67AE85) & MASK]
    return c


def run(scenario, count, seed=0, size=0.05, action_seed=0):
    """Step an environment with random actions; return it, the observations and the infos, those of the reset first."""
    env, rng = SFFRFlexEnv(scenario), np.random.default_rng(action_seed)
    outputs = [env.reset(seed=seed)]
    for _ in range(count):
        obs, reward, terminated, _, info = env.step(size * rng.uniform(-1.0, 1.0, N_ACTIONS))
        outputs.append((obs, info | {"reward": reward, "terminated": terminated}))
    observations, infos = zip(*outputs, strict=True)
    return env, np.array(observations), infos


def test_random_words_are_those_of_philox():
    """The generator gives the published words of a zero counter and key, and an independent writing's elsewhere."""
    assert [int(word) for word in words(0, 0, 0)] == [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]
    rng = np.random.default_rng(0)
    for tick, block, key in rng.integers(0, 2**32, (200, 3)).tolist():
        assert [int(word) for word in words(tick, block, key)] == philox_in_words((tick, block, 0, 0), (key, 0))


def test_noise_is_white_noise_of_box_and_muller():
    """Two normal numbers of two words, the next two of the other words of a block; each at its own level."""
    level, tick, key = np.linspace(0.5, 3.0, 18), 7, 12345
    words_of = np.array([philox_in_words((tick, block, 0, 0), (key, 0)) for block in range(5)], np.float64).ravel()
    u, v = ((words_of + 0.5) / 2.0**32).reshape(10, 2)[:9].T
    normal = np.sqrt(-2.0 * np.log(u)) * np.array([np.cos(2.0 * np.pi * v), np.sin(2.0 * np.pi * v)])
    np.testing.assert_allclose(noises(level, key, tick + 1)[tick], level * normal.T.ravel(), rtol=1e-11)


@pytest.mark.parametrize(("key", "coarse"), [(0, 0), (1, 0), (0, 1), (1, 1), (2**32 - 1, 1)])
def test_sensors_add_white_noise_and_round_it_where_they_do(params, key, coarse):
    """Noise first, for any key but 0, and then steps."""
    task, true = make_task_model(params), np.linspace(-0.09, 0.11, N_OBS)
    level, quantum, obs, expected = np.full(N_OBS, 1e-3), np.full(N_OBS, 5e-3), true.copy(), true.copy()
    sense(task, None, Sensing(level, key, 0, quantum, coarse), 3, None, None, None, obs)
    if key:
        add_noise(Sensing(level, key, 0, quantum, 0), 3, task.bound, expected)
        assert (expected != true).all()
    if coarse:
        expected = np.floor(expected / 5e-3 + 0.5) * 5e-3
    np.testing.assert_allclose(obs, np.clip(expected, -task.bound, task.bound), rtol=0, atol=1e-15)


def test_keys_of_noise_have_32_bits(params):
    """Any of them but 0, which is none."""
    scenario = load_scenario("noise")
    known = nominal(params, scenario)
    keys = np.array([draw(scenario, known, np.random.default_rng(seed)).sensing.key for seed in range(24)])
    assert (keys >= 1).all() and 2**31 < keys.max() < 2**32 and keys.min() < 2**30


def test_noise_is_white_and_normal():
    """Every number has its own level, normal, and knows neither its neighbours, nor its past, nor other keys."""
    level = np.linspace(0.5, 2.0, 7)  # not a multiple of four
    ticks = 20_000
    noise, other = noises(level, 1, ticks) / level, noises(level, 2, ticks) / level
    five_sigma = 5.0 / np.sqrt(ticks)
    np.testing.assert_allclose(noise.mean(axis=0), 0.0, atol=five_sigma)
    np.testing.assert_allclose(noise.std(axis=0), 1.0, atol=five_sigma)
    np.testing.assert_allclose((noise**4).mean(axis=0), 3.0, atol=5.0 * np.sqrt(96.0 / ticks))
    for lag in (1, 2):
        assert np.abs(noise[lag:].T @ noise[:-lag] / ticks).max() < five_sigma
    assert np.abs(noise.T @ noise / ticks - np.diag((noise**2).mean(axis=0))).max() < five_sigma
    assert np.abs(noise.T @ other / ticks).max() < five_sigma


def test_noise_ends_at_each_numbers_own_bounds():
    """Far larger than these, which differ: every number ends at its lower one and at its upper one."""
    bound, ends = 1.0 + np.arange(7.0), []
    for tick in range(200):
        obs = np.zeros(7)
        add_noise(Sensing(np.full(7, 1e9), 3, 0, np.zeros(7), 0), tick, bound, obs)
        ends.append(obs)
    np.testing.assert_array_equal([np.min(ends, axis=0), np.max(ends, axis=0)], [-bound, bound])


def test_noise_reaches_the_observation_alone(user_scenario):
    """Under the same actions all else is that of a clean episode, bit for bit; numbers have the noise of their unit."""
    levels = {"position": 1e-3, "angle": 2e-3, "velocity": 3e-3, "rate": 4e-3}
    env, noisy, infos = run(user_scenario(sensors=levels), 400)
    _, clean, clean_infos = run("nominal", 400)
    for info, other in zip(infos, clean_infos, strict=True):
        for name in (*SIGNALS, *(f"reward_{name}" for name in REWARDS), "time", "failure", "cost"):
            assert info[name] == other[name]
        np.testing.assert_array_equal(info["applied"], other["applied"])
        assert info.get("reward") == other.get("reward") and info.get("terminated") == other.get("terminated")
    noise = noisy - clean
    by_unit = dict(zip(("m", "rad", "m/s", "rad/s"), levels.values(), strict=True))
    for field in env.fields.values():
        units = field.unit.split(", ")
        for k in range(field.size):
            level = 0.0 if field.name.startswith("reference") else by_unit[units[k % len(units)]]
            spread = noise[:, field.start + k].std()
            assert spread == pytest.approx(level, rel=0.2), field.name  # 401 samples, five standard deviations
    assert np.abs(noise[0]).max() > 0.0, "the observation of the reset is measured too"


def test_noise_does_not_depend_on_actions_or_neighbours(user_scenario):
    """The noise of a seed is the same under other actions, and in a batch of any size."""
    noisy, clean = user_scenario(sensors={"position": 1e-2, "rate": 1e-2}), user_scenario()
    first, second = (run(noisy, 20, 5, action_seed=k)[1] - run(clean, 20, 5, action_seed=k)[1] for k in (1, 2))
    np.testing.assert_allclose(first, second, rtol=0, atol=1e-13)
    alone = run(noisy, 20, seed=5, size=0.0)[1]
    many = SFFRFlexVectorEnv(40, scenario=noisy)
    assert (many.reset(seed=3)[0][2] == alone[0]).all()
    for obs in alone[1:]:
        np.testing.assert_array_equal(many.step(np.zeros((40, N_ACTIONS)))[0][2], obs)
    assert (run(noisy, 1, seed=6)[1][0] != alone[0]).any()


def test_a_noisy_observation_stays_in_its_space(user_scenario):
    """Whatever the noise, the observation keeps its bounds, and the episode goes on."""
    env, observations, infos = run(
        user_scenario(sensors={"position": 100.0, "angle": 1.0, "velocity": 100.0, "rate": 100.0}), 50
    )
    assert all(env.observation_space.contains(obs) for obs in observations)
    assert (np.abs(observations) == env.observation_space.high).any()
    assert not any(info["failure"] for info in infos)


def test_delay_shows_the_robot_of_a_period_ago(user_scenario):
    """Late sensors show the last state against the present desired one; the reference's motion is not late."""
    env, late, infos = run(user_scenario(sensors={"delay": 1}), 30)
    _, clean, clean_infos = run("nominal", 30)
    assert infos[0]["drawn_delay_periods"] == 1.0 and env.episode.drawn == {"delay_periods": 1.0}
    assert [info["object_error"] for info in infos] == [info["object_error"] for info in clean_infos]
    at = {name: field.slice for name, field in env.fields.items()}
    np.testing.assert_array_equal(late[0], clean[0])  # nothing older is known
    for name in ("joint_angle", "joint_rate", "elastic", "elastic_rate", "yaw_rate", "hold_error"):
        np.testing.assert_array_equal(late[1:, at[name]], clean[:-1, at[name]])
    for name in ("reference_velocity", "reference_acceleration", "reference_turn"):
        np.testing.assert_array_equal(late[:, at[name]], clean[:, at[name]])
    way = 15.0 * np.sin(0.85 / 15.0 * 2e-3 * np.arange(31))
    passed = np.diff(way)  # by the desired position along x in each period, 1.7 mm
    for x in (at["object_error"].start, at["base_error"].start, *range(at["tip_error"].start, at["tip_error"].stop, 2)):
        np.testing.assert_allclose(late[1:, x], clean[:-1, x] + passed, rtol=0, atol=1e-14)


def test_half_of_the_noisy_episodes_are_late():
    """The shipped scenario's delay shows in info, and in the lag of 1.7 mm that it brings."""
    env = SFFRFlexEnv("noise")
    lags = {}
    for seed in range(12):
        _, info = env.reset(seed=seed)
        obs = env.step(np.zeros(N_ACTIONS))[0]
        lags.setdefault(info["drawn_delay_periods"], []).append(obs[env.fields["object_error"].start])
    np.testing.assert_allclose(lags[0.0], 0.0, atol=5e-4)  # five times the noise
    np.testing.assert_allclose(lags[1.0], 1.7e-3, atol=5e-4)


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_blows_change_the_momentum_by_their_impulse(user_scenario, yaw):
    """In the drawn periods, and only there, the momentum of everything changes by the drawn impulse in base axes."""
    file = user_scenario(duration=0.3, impulses={"count": 3, "linear": 2.0, "angular": 0.5})
    start = f"initial.q=[0.3, -0.2, {yaw}, 0.6, 4.2, 5.6, 2.1, 0.4, 0.1]", "initial.qd=[0, 0, 0, 0, 0, 0, 0, 0, 0]"
    env = SFFRFlexEnv(file, overrides=["object=null", *start])
    env.reset(seed=2)
    simulator, drawn = Simulator(env.params), env.episode.drawn
    expected = np.zeros((150, 3))
    for k in range(3):
        tick = round(drawn[f"impulse{k}_time_s"] / 2e-3)
        expected[tick] += [drawn[f"impulse{k}_{name}"] for name in ("x_N_s", "y_N_s", "moment_N_m_s")]
    momentum, base = [simulator.momentum(env.state())], []
    for _ in range(150):
        base.append(env.positions[:3])
        env.step(np.zeros(N_ACTIONS))
        momentum.append(simulator.momentum(env.state()))
    assert np.count_nonzero(np.abs(expected).sum(axis=1)) == 3
    for change, blow, (x, y, angle) in zip(np.diff(momentum, axis=0), expected, base, strict=True):
        force = rotation(angle) @ blow[:2]
        angular = blow[2] + x * force[1] - y * force[0]  # about the origin
        # The base turns and moves while the force acts; 1e-6 is what long steps make of the axial modes' ringing.
        np.testing.assert_allclose(change, [*force, angular], rtol=0, atol=1e-2 * np.abs(blow).sum() + 1e-6)


def test_blows_hit_a_batch_as_they_hit_one(user_scenario):
    """Every environment of a batch has its own impulses, and scenarios of other counts may follow one another."""
    many = SFFRFlexVectorEnv(3, scenario="impulse")
    for name, count in (
        ("impulse", 3),
        (user_scenario(duration=0.1, impulses={"count": 8, "linear": 9, "angular": 1}), 8),
    ):
        env = SFFRFlexEnv(name)
        assert load_scenario(name).impulses.count == count
        _, infos = many.reset(seed=7, options={"scenario": name})
        assert sum(key.endswith("_time_s") and key[0] != "_" for key in infos if key.startswith("drawn_")) == count
        env.reset(seed=8)
        for _ in range(50):
            obs = many.step(np.zeros((3, N_ACTIONS)))[0]
            np.testing.assert_array_equal(obs[1], env.step(np.zeros(N_ACTIONS))[0])
