"""``SFFRFlexDamping-v0``: the law inside, its damping that stays positive, and the interfaces of Gymnasium and SB3."""

import functools
import inspect

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as check_gymnasium_env
from gymnasium.vector import AutoresetMode
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from stable_baselines3.common.env_checker import check_env as check_sb3_env
from stable_baselines3.common.vec_env import VecMonitor

from sffr_agents.sb3_vec_env import DampingVecEnv, make_sb3_vec_env
from sffr_baselines import make_policy
from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv, make_damping_envs
from sffr_baselines.damping_loop import make_damping, see_range
from sffr_baselines.rollout import rollout
from sffr_baselines.schedule import BOUNDS, N_FEATURES, OTHER_DEMAND, PIEZO_DEMAND
from sffr_baselines.scheduled import SCHEDULED
from sffr_baselines.suppression import TRANSVERSE
from sffr_gym import ConfigError
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.reward import REWARDS
from sffr_gym.task.signals import VIBRATION

ACTIONS = arrays(np.float64, (6, 4), elements=st.one_of(st.sampled_from([-1.0, 0.0, 1.0]), st.floats(-1.0, 1.0)))


def make(**arguments):
    return SFFRFlexDampingEnv(**{"duration": 1.0} | arguments)


def steps(env, actions, seed=0):
    """Observations, rewards and infos of an episode."""
    env.reset(seed=seed)
    return list(zip(*[env.step(action) for action in actions], strict=True))


@pytest.mark.parametrize(
    ("law", "scenario"),
    [
        *(
            (law, scenario)
            for law in ("hsc", "ahsc")
            for scenario in ("excited", "noise", "mismatch", "degraded", "impulse")
        ),
        *((law, "excited") for law in SCHEDULED if law not in ("hsc", "ahsc")),
        *((law, scenario) for law in ("lqr-ff", "lqr-kf", "mpc") for scenario in ("weak", "patches", "noise")),
    ],
)
def test_action_zero_is_the_law_bit_for_bit(law, scenario):
    env = make(law=law, scenario=scenario, duration=1.0, random_phase=False)
    bare = SFFRFlexEnv(env._distribution(env.scenario))
    expected = rollout(bare, make_policy(law, bare), seed=5)
    _, rewards, _, truncated, infos = steps(env, np.zeros((10, *env.action_space.shape), np.float32), seed=5)
    last = expected.signals[49::50]
    np.testing.assert_array_equal([info["vibration"] for info in infos], last[:, VIBRATION])
    np.testing.assert_array_equal([info["object_error"] for info in infos], last[:, 0])
    assert truncated[-1] and not any(truncated[:-1])
    term = bare.params.reward.vibration
    earned = term.weight / (1.0 + np.log(1.0 + expected.signals[:, VIBRATION] / term.scale))
    total = earned.reshape(10, 50).sum(axis=1)
    np.testing.assert_allclose([info["reward_vibration"] for info in infos], total, rtol=1e-12)
    for reward, info in zip(rewards, infos, strict=True):
        assert reward == pytest.approx(sum(info[f"reward_{name}"] for name in REWARDS), rel=1e-12)


def test_action_multiplies_the_damping_by_powers_of_rho():
    env = make(law="hsc", rho=4.0)
    env.reset(seed=0)
    *_, info = env.step(np.array([1.0, -1.0, 0.5, 0.0]))
    B0 = env.params.suppression.B0
    np.testing.assert_allclose(
        info["damping"], [[0.0, 4.0 * B0[1], B0[2] / 4.0], [0.0, 2.0 * B0[1], B0[2]]], rtol=1e-15
    )


@pytest.mark.parametrize("law", ["lqr-ff", "mpc", "lqr"])
def test_action_multiplies_a_regulators_feedback_and_lowers_the_share_of_the_reaction(law):
    """Each panel has one factor of all its volts, and where the reaction is fed forward a share of it, at most 1."""
    env, plain = make(law=law, rho=4.0, agent_period=0.002), make(law=law, rho=4.0, agent_period=0.002)
    fed = ["reaction"] if law != "lqr" else []
    assert env.action_names == tuple(f"{side}_{name}" for side in ("left", "right") for name in ["feedback", *fed])
    for env_ in (env, plain):
        env_.reset(seed=2)
    action = np.array([1.0, -0.5, -0.5, 1.0] if fed else [1.0, -0.5])
    env.step(action)
    plain.step(np.zeros(env.action_space.shape))
    volts, alone = (each._batch.applied[0, :6].reshape(2, 3) for each in (env, plain))
    np.testing.assert_allclose(env._damping.law.factor[0, :, 1:], [[4.0, 4.0], [0.5, 0.5]], rtol=1e-12)
    for panel, factor in enumerate((4.0, 0.5)):
        np.testing.assert_allclose(volts[panel, 1:] / alone[panel, 1:], factor, rtol=1e-3)  # beside Q_v, which stays
    if fed:
        np.testing.assert_allclose(env._damping.law.share[0], [4.0**-0.5, 1.0], rtol=1e-12)


def test_what_a_law_asks_beyond_its_limits_is_seen():
    env = make(scenario="weak", law="lqr", agent_period=0.002)
    env.reset(seed=4)
    asked = np.abs(make_policy("lqr", env.params)(env._batch.obs[0].copy()))
    obs, *_ = env.step(np.zeros(2))
    seen, piezos = obs.reshape(2, N_FEATURES), asked[:6].reshape(2, 3).max(axis=1)
    np.testing.assert_allclose(seen[:, PIEZO_DEMAND], np.log10(piezos + 0.01), rtol=1e-5)
    np.testing.assert_allclose(seen[:, OTHER_DEMAND], np.log10(asked[6:].max() + 0.01), rtol=1e-5)
    assert piezos.max() > 1.0 and asked[6:].max() > 0.01


def test_actions_yield_to_the_law_while_the_base_is_off_its_path():
    """With an error e of the base, an action counts 1 / (1 + (e / tolerance)^2); turns and rates count as shifts."""
    action = np.array([1.0, -1.0, 0.5, 0.0])
    env = make(scenario="offset", law="hsc", base_tolerance=0.02)
    env.reset(seed=3)
    env.step(np.zeros(4))  # on its way back the base moves
    x, y, turn, vx, vy, spin = env._batch.obs[0, :6]
    lever = np.hypot(*env.params.panel.mounts[0].root) + 0.5 * env.params.panel.length
    error = np.hypot(x, y) + lever * abs(turn) + 0.5 * (np.hypot(vx, vy) + lever * abs(spin))
    assert error > 0.02 and np.hypot(vx, vy) > 0.1 * error and lever * abs(spin) > 0.1 * error
    *_, info = env.step(action)
    factor = info["damping"][:, 1:].ravel() / np.tile(env.params.suppression.B0[1:], 2)
    np.testing.assert_allclose(np.log10(factor), action / (1.0 + (error / 0.02) ** 2), rtol=1e-9)


def test_each_panel_feels_its_own_action():
    still = steps(make(), np.zeros((5, 4)))[4][-1]["damping"]
    moved = steps(make(), np.tile([1.0, 1.0, 0.0, 0.0], (5, 1)))[4][-1]["damping"]
    assert (moved[0, 1:] > 5.0 * still[0, 1:]).all()
    np.testing.assert_allclose(moved[1], still[1], rtol=1e-2)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(actions=ACTIONS, seed=st.integers(0, 1000))
def test_no_sequence_of_actions_feeds_energy_into_a_panel(actions, seed):
    """At every sample the damping's force opposes the tip, and over the time it is held it does no work in all."""
    env = make(agent_period=0.002, duration=0.2)  # one control period for each action, so that all can be seen
    env.reset(seed=seed)
    tips, work = env.prior_task.actuators.tips, np.zeros(2)

    def tip(values):
        modes = values[9 : 9 + tips[:, :, 0].size].reshape(tips.shape[:2])
        return np.einsum("imk,im->ik", tips, modes)

    for action in np.repeat(actions, 10, axis=0):
        place, rate, B_hat = tip(env.positions), tip(env.velocities), env._damping.law.B_hat[0].copy()
        env.step(action)
        B = env._damping.law.factor[0] * B_hat
        assert (B[:, 1:] > 0.0).all() and (B[:, 1:] <= 10.0 * B_hat[:, 1:] * (1.0 + 1e-12)).all()
        work -= (B * rate * (tip(env.positions) - place)).sum(axis=1)
        assert (work <= 1e-9).all()


def see(law, obs, demand=(0.0, 0.0, 0.0)):
    """Return what an agent sees of an observation after a law has asked for so much."""
    damping = make_damping(law, 1)
    damping.law.demand[0] = demand
    see_range(law, damping, obs[None], np.ones(1, dtype=np.bool_), 0, 1)
    return damping.law.seen[0]


@functools.cache
def default_law():
    return make().law


@settings(max_examples=50, deadline=None)
@given(obs=arrays(np.float64, 52, elements=st.floats(-10.0, 10.0)))
def test_observation_stays_in_its_bounds_whatever_is_measured(obs):
    seen = see(default_law(), obs, (0.0, 1e300, 3.0))
    assert (np.abs(seen[np.isfinite(seen)]) <= np.tile(BOUNDS, 2)[np.isfinite(seen)]).all()


def test_panels_see_themselves_alike():
    """A panel at rest on its quasi-static shape has hardly any energy, wherever on the circle."""
    env = make(scenario="nominal", overrides=["initial.qfd=[0, 0, 0]"])
    for seed in range(5):
        obs, _ = env.reset(seed=seed)
        first, second = obs.reshape(2, N_FEATURES)
        assert (obs[4::N_FEATURES] < -1.5).all()  # a thousandth of the reward's energy scale
        np.testing.assert_allclose(first[5:7], second[5:7], atol=1e-6)  # both are pushed to their positive side
        assert first[5] >= 0.0
        assert np.hypot(*first[5:7]) == pytest.approx(1.0, abs=1e-5)


def test_a_mirrored_panel_is_seen_alike():
    """Nothing tells a panel from its mirror image: bent, moved and pushed to the other side."""
    env, rng = make(), np.random.default_rng(0)
    for _ in range(20):
        obs = rng.uniform(-1.0, 1.0, 52)
        obs[env.fields["reference_turn"].slice] = 0.0
        seen = see(env.law, obs)
        for name in ("elastic", "elastic_rate", "reference_velocity", "reference_acceleration"):
            obs[env.fields[name].slice] *= -1.0
        np.testing.assert_array_equal(seen, see(env.law, obs))
        assert (seen[5::N_FEATURES] > 0.0).all() and np.abs(seen[:4]).min() > 0.0


def test_a_panel_without_any_energy_has_no_direction():
    """Its tip where the quasi-static shape has it, and as fast."""
    law = default_law()
    for push in (0.0, 0.3):
        obs = np.zeros(52)
        obs[law.at.reference_velocity] = 1.0
        obs[law.at.reference_acceleration + 1] = push
        for i in range(2):
            across, spin = law.regulator.across[i], push  # the path turns by its acceleration over its speed
            obs[law.at.elastic + 3 * i : law.at.elastic + 3 * i + 3] = law.regulator.shape[i] * across[1] * push
            rate = -law.regulator.shape[i] * across[0] * push * spin
            obs[law.at.elastic_rate + 3 * i : law.at.elastic_rate + 3 * i + 3] = rate
        seen = see(law, obs).reshape(2, N_FEATURES)
        np.testing.assert_allclose(seen[:, :4], 0.0, atol=1e-9)
        np.testing.assert_allclose(seen[:, 4], -3.0, atol=1e-9)


def test_batch_equals_single_environments():
    batch = SFFRFlexDampingVectorEnv(3, scenario="mismatch", duration=0.5)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 3, 4))
    batch.reset(seed=7)
    together = [batch.step(action)[:2] for action in actions]
    for i in range(3):
        obs, rewards, *_ = steps(make(scenario="mismatch", duration=0.5), actions[:, i], seed=7 + i)
        np.testing.assert_array_equal([each[0][i] for each in together], obs)
        np.testing.assert_array_equal([each[1][i] for each in together], rewards)


def test_batch_and_single_environment_have_the_same_defaults():
    single, batch = (inspect.signature(kind).parameters for kind in (SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv))
    assert all(batch[name].default == parameter.default for name, parameter in single.items())
    assert make().action_space == gym.spaces.Box(-1.0, 1.0, (4,), np.float32) == make_damping_envs().single_action_space


def test_a_batch_has_one_environment_unless_it_says_otherwise():
    assert make_damping_envs().num_envs == 1
    with pytest.raises(TypeError):
        make_damping_envs(1, "cpu")  # what runs them is said by name


def test_last_step_of_an_episode_ends_with_it():
    env = make(duration=0.25)
    env.reset(seed=0)
    ends = [env.step(np.zeros(4))[3:] for _ in range(3)]
    assert [truncated for truncated, _ in ends] == [False, False, True]
    assert ends[-1][1]["time"] == pytest.approx(0.25)


def test_state_is_restored_bit_for_bit():
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (6, 4))
    env = make()
    env.reset(seed=3)
    env.step(actions[0])
    kept = env.get_state()
    first = [env.step(action)[0] for action in actions]
    env.set_state(kept)
    np.testing.assert_array_equal(first, [env.step(action)[0] for action in actions])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"law": "none"}, "law = 'none': must be one of hsc, ahsc, "),
        ({"law": "ppf"}, "law = 'ppf'"),
        ({"law": "lqr_ff"}, "did you mean 'lqr-ff'"),
        ({"law": "lqr", "rho": 1000.0}, "times the regulator's gain"),
        ({"rho": 0.5}, "rho = 0.5"),
        ({"agent_period": 0.003}, "multiple of control.period"),
        ({"base_tolerance": 0.0}, "base_tolerance = 0.0: must be at least 1e-09"),
        ({"stack_size": 0}, "stack_size = 0: must be at least 1"),
        ({"stack_size": 101}, "stack_size = 101: must be at most 100"),
        ({"stack_size": 2.5}, "stack_size = 2.5: must be a whole number"),
        ({"overrides": ["panel.elements=8", "panel.bending_cut=1.0e6"]}, "rho = 10: with the virtual damping"),
        ({"overrides": ["panel.mounts=[]", "initial.qf=[0, 0, 0]", "initial.qfd=[0, 0, 0]"]}, "no panels"),
    ],
)
def test_what_cannot_be_run_is_rejected(arguments, message):
    with pytest.raises(ConfigError, match=message):
        make(**arguments)


def test_gymnasium_and_sb3_find_nothing_wrong():
    env = gym.make("SFFRFlexDamping-v0", duration=1.0)
    check_gymnasium_env(env.unwrapped, skip_render_check=True)
    check_sb3_env(env.unwrapped)
    batch = gym.make_vec("SFFRFlexDamping-v0", num_envs=2, duration=0.3)
    obs, _ = batch.reset(seed=0)
    assert obs in batch.observation_space
    assert batch.step(batch.action_space.sample())[0] in batch.observation_space


@pytest.mark.parametrize("per_panel", [False, True])
def test_vec_env_gives_last_observations_and_says_why_episodes_end(per_panel):
    env = make_sb3_vec_env(3, per_panel, duration=0.3)
    twin = SFFRFlexDampingVectorEnv(3, duration=0.3, autoreset_mode=AutoresetMode.DISABLED)
    env.seed(4)
    twin.reset(seed=4)
    assert env.num_envs == 3 * (2 if per_panel else 1)
    assert env.reset().shape == (env.num_envs, *env.observation_space.shape)
    actions = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 3, 4))
    for k, action in enumerate(actions):
        obs, rewards, dones, infos = env.step(action.reshape(env.num_envs, -1))
        expected, *_ = twin.step(action)
        np.testing.assert_allclose(rewards.reshape(3, -1).sum(axis=1), -twin.step_prices.sum(axis=1), rtol=1e-5)
        assert dones.all() == (k == 2) and dones.any() == (k == 2)
    last = [info["terminal_observation"] for info in infos]
    np.testing.assert_array_equal(last, expected.reshape(env.num_envs, -1))
    assert all(info["TimeLimit.truncated"] for info in infos)
    assert (obs != last).any()


@pytest.mark.parametrize("per_panel", [False, True])
def test_vec_monitor_keeps_the_statistics_of_episodes(per_panel):
    env = VecMonitor(make_sb3_vec_env(2, per_panel, duration=0.3))
    env.seed(4)
    env.reset()
    steps = [env.step(np.zeros((env.num_envs, *env.action_space.shape), np.float32)) for _ in range(4)]
    total = sum(rewards for _, rewards, _, _ in steps[:3])
    assert [[("episode" in info) for info in infos] for *_, infos in steps] == [
        [k == 2] * env.num_envs for k in range(4)
    ]  # fmt: skip
    for info, value in zip(steps[2][3], total, strict=True):
        assert info["episode"]["l"] == 3 and info["episode"]["r"] == pytest.approx(value, rel=1e-4)


def test_vec_env_needs_the_autoreset_of_sb3():
    with pytest.raises(ValueError, match="SAME_STEP"):
        DampingVecEnv(SFFRFlexDampingVectorEnv(2))


def test_pictures_show_the_damping_that_acts():
    """The strip has a line for each panel's damping, single and batched alike, and it moves with the actions."""
    pytest.importorskip("PIL")
    single = gym.make("SFFRFlexDamping-v0", render_mode="rgb_array").unwrapped
    batch = SFFRFlexDampingVectorEnv(2, render_mode="rgb_array")
    single.reset(seed=5)
    batch.reset(seed=5)
    rng, dampings = np.random.default_rng(0), [single.damping[:, TRANSVERSE]]
    for _ in range(30):
        action = rng.uniform(-1.0, 1.0, single.action_space.shape)
        single.step(action)
        batch.step(np.tile(action, (2, 1)))
        dampings.append(single.damping[:, TRANSVERSE])
    trace = single.get_state()["trace"].rows
    np.testing.assert_array_equal(trace[:, -2:], dampings)
    assert np.ptp(trace[:, -2]) > 1.0
    picture = single.render()
    assert picture.shape == (600, 600, 3)
    np.testing.assert_array_equal(batch.render()[0][60:], picture[60:])  # beside the subtitle
