"""Policies by name: what makes them, what they take and give, and what a reset forgets."""

import gymnasium as gym
import numpy as np
import pytest

from sffr_baselines import POLICIES, make_policy
from sffr_baselines.laws import ORACLES, make_law
from sffr_baselines.learned import shipped_policies
from sffr_baselines.policies import check_titles, names_policy, policy_file, policy_title
from sffr_baselines.rollout import rollout
from sffr_gym import ConfigError, load_params
from sffr_gym.config.strict_yaml import config_dir
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv

ONE_PANEL = "panel.mounts=[{name: one, root: [0.3, -0.7], angle: 2.1}]"

LAWS = ["none", "hsc", "ahsc", "ahsc-filtered"]


def observations(count, seed=0):
    """Return observations (count, 52) on the way of a swinging robot under random actions."""
    env, rng = SFFRFlexEnv("excited"), np.random.default_rng(seed)
    rows = [env.reset(seed=seed)[0]]
    while len(rows) < count:
        rows.append(env.step(0.1 * rng.uniform(-1.0, 1.0, 15))[0])
    return np.array(rows)


def test_names():
    """Baselines and learned policies are there, each with its name and a line that says what it is."""
    assert {"none", "random", "hsc", "ahsc", "ahsc-filtered", "hsc-oracle", "ahsc-oracle"} <= set(POLICIES)
    assert {"sac", "ppo", "mpc-scheduled"} == set(shipped_policies()) <= set(POLICIES)
    assert all(POLICIES.values())
    for name in POLICIES:
        assert make_policy(name, load_params()).name == name


def test_what_is_written_as_a_policy_names_the_file_that_decides(tmp_path):
    (tmp_path / "mine.py").write_text("class Law: ...\n")
    own = f"{tmp_path}/mine.py:Law"
    assert all(names_policy(name) for name in ("hsc", "sac", "x/best.npz", own, "package.module:Law,gain=2"))
    assert not any(names_policy(name) for name in ("nominal", "mine.py", "best.np"))
    assert policy_file(own) == tmp_path / "mine.py"
    assert policy_file("sac") == config_dir() / "policies" / "sac.npz" and policy_file("hsc") is None


@pytest.mark.parametrize(
    ("name", "nearest"),
    [("ahcs", "ahsc"), ("HSC", "hsc"), ("ahsc_filtered", "ahsc-filtered"), ("sca", "sac"), ("runs/best", None)],
)
def test_unknown_name_raises(name, nearest):
    """A name that does not exist is rejected with the nearest one and all there are."""
    with pytest.raises(ConfigError, match=f"unknown policy '{name}'") as error:
        make_policy(name, load_params())
    assert (f"did you mean '{nearest}'?" if nearest else "'runs/best' (known") in str(error.value)
    assert all(known in str(error.value) for known in POLICIES)


def test_policies_for_the_scheduled_law_are_schedules_and_that_law():
    """By their names, and by files; whatever commands the actuators, or is unknown, is refused by its name."""
    env, bare = gym.make("SFFRFlexDamping-v0"), gym.make("SFFRFlex-v0")
    for name in ("sac", policy_file("sac"), "random", "ahsc"):
        policy, acts = make_policy(name, env), (4,)
        assert policy(env.reset(seed=0)[0]).shape == acts
    assert make_policy(policy_file("sac"), bare)(bare.reset(seed=0)[0]).shape == (15,)
    with pytest.raises(ConfigError, match=r"hsc commands the actuators of SFFRFlex-v0; .* ahsc \(action 0\)"):
        make_policy("hsc", env)
    with pytest.raises(ConfigError, match="unknown policy 'ahcs'; did you mean 'ahsc'"):
        make_policy("ahcs", env)


def test_a_law_of_ones_own_commands_actuators_and_schedules_nothing(tmp_path):
    """Inside of a law it is refused as the others are; it is called by its class."""
    (tmp_path / "mine.py").write_text(
        "from sffr_baselines import ControlLaw\nimport numpy as np\n\n"
        "class Calm(ControlLaw):\n    def __call__(self, obs):\n        return np.zeros(len(self.limit))\n"
    )
    name = f"{tmp_path / 'mine.py'}:Calm"
    assert policy_title(name) == make_policy(name, SFFRFlexEnv()).name == "Calm"
    with pytest.raises(ConfigError, match=r"Calm commands the actuators of SFFRFlex-v0"):
        make_policy(name, gym.make("SFFRFlexDamping-v0"))


def test_actions_are_as_commanded_or_fit_the_action_space():
    """Of float64 beyond the limits, or of float32 within them; of no other type."""
    env = SFFRFlexEnv("excited")
    obs = 50.0 * env.reset(seed=1)[0]
    commanded, fitted = (make_policy("hsc", env, dtype)(obs) for dtype in ("float64", "float32"))
    assert commanded.dtype == np.float64 and np.abs(commanded).max() > 1.0
    np.testing.assert_array_equal(fitted, np.clip(commanded, -1.0, 1.0).astype(np.float32), strict=True)
    with pytest.raises(ValueError, match="dtype = 'float16': must be float64 or float32"):
        make_policy("hsc", env, "float16")


@pytest.mark.parametrize("name", ["lqr", "mpc", "ppf"])
def test_laws_that_feed_the_panels_back_do_not_damp_them_twice(name):
    """What Eq. 20 has beside the virtual damping, they keep, on the coordinates of HSC."""
    own, hsc = (make_law(law, load_params()).suppression for law in (name, "hsc"))
    assert not own.B0.any() and not own.Gamma.any() and hsc.B0.any()
    np.testing.assert_array_equal(own.damped, hsc.damped)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["ahsc", "hsc", "ahsc"], "policy 'ahsc' is given twice"),
        (["one/best.npz", "ahsc", "two/one/best.npz"], "two policies would be called 'one/best'"),
        (["a\nb.npz"], "its name must be text on one line"),
    ],
)
def test_tables_can_tell_policies_apart(names, message):
    """A file is called by its folder and its own name."""
    with pytest.raises(ConfigError, match=message):
        check_titles(names)
    check_titles(["ahsc", "hsc", "one/best.npz", "two/best.npz", "two/last.npz"])


@pytest.mark.parametrize("name", [name for name in POLICIES if name not in ORACLES.values()])
def test_actions_fit_the_environment(name):
    """An observation gives an action of the environment's shape, a batch one for each, finite and of float64."""
    env = gym.make("SFFRFlex-v0")
    policy = make_policy(name, env)
    obs, _ = env.reset(seed=0)
    action = policy(obs)
    assert action.shape == env.action_space.shape and action.dtype == np.float64
    assert np.isfinite(action).all()
    policy.reset()
    assert policy(np.array([obs, obs])).shape == (2, 15)


@pytest.mark.parametrize("name", LAWS)
def test_every_way_to_make_a_policy_gives_the_same(name):
    """Wrapped, bare and vector environments and the parameters themselves make one and the same law."""
    overrides = ["control.Kd=250", "suppression.B0=[1, 2, 3]"]
    params, rows = load_params().with_overrides(*overrides), observations(30)
    sources = [
        params,
        SFFRFlexEnv(overrides=overrides),
        gym.make("SFFRFlex-v0", overrides=overrides),
        SFFRFlexVectorEnv(4, overrides=overrides),
        gym.make_vec("SFFRFlex-v0", num_envs=2, overrides=overrides),
    ]
    actions = []
    for source in sources:
        policy = make_policy(name, source)
        actions.append([policy(obs) for obs in rows])
    for other in actions[1:]:
        np.testing.assert_array_equal(actions[0], other)
    default = make_policy(name, load_params())
    assert (np.array([default(obs) for obs in rows]) != actions[0]).any()


@pytest.mark.parametrize("name", LAWS)
def test_a_batch_is_many_single_ones(name):
    """Rows of a batch are controlled as if each were alone, its adaptation included."""
    histories = np.array([observations(25, seed) for seed in range(3)])
    together = make_policy(name, load_params())
    batched = np.array([together(rows) for rows in histories.swapaxes(0, 1)])
    for i, history in enumerate(histories):
        alone = make_policy(name, load_params())
        np.testing.assert_array_equal(batched[:, i], [alone(obs) for obs in history])
        np.testing.assert_array_equal(together.B_hat[i], alone.B_hat[0])


@pytest.mark.parametrize("name", LAWS)
def test_observations_are_left_alone_and_actions_are_new(name):
    """A policy changes nothing that it is given and hands out a new array each time; lists do as well as arrays."""
    policy, obs = make_policy(name, load_params()), observations(5)
    kept = obs.copy()
    first = policy(obs[3])
    second = policy(obs[4])
    assert not np.shares_memory(first, second)
    np.testing.assert_array_equal(obs, kept)
    policy.reset()
    np.testing.assert_array_equal(policy(obs[3].tolist()), first)


@pytest.mark.parametrize("name", ["ahsc", "ahsc-filtered"])
def test_reset_puts_the_damping_back(name):
    """What was adapted is forgotten by a reset, and by nothing else; the number of environments is free again."""
    policy, rows = make_policy(name, load_params()), observations(40)
    first = [policy(obs) for obs in rows]
    adapted = policy.B_hat.copy()
    assert (adapted[0] != policy.initial_damping())[:, 1:].all()
    assert (policy(rows[0]) != first[0]).any()
    policy.reset()
    np.testing.assert_array_equal([policy(obs) for obs in rows], first)
    np.testing.assert_array_equal(policy.B_hat, adapted)
    with pytest.raises(ValueError, match="1 environments expected, got 3; call reset"):
        policy(rows[:3])
    policy.reset()
    assert policy(rows[:3]).shape == (3, 15)


def test_damping_starts_at_the_configured_value():
    """The damping of the first period is B(0) on the damped coordinates of every panel; HSC keeps it."""
    policy = make_policy("hsc", load_params())
    np.testing.assert_array_equal(policy.initial_damping(), [[0.0, 1.5, 5.0]] * 2)
    for obs in observations(20):
        policy(obs)
    np.testing.assert_array_equal(policy.B_hat, [policy.initial_damping()])
    single = load_params().with_overrides("panel.mounts=[{name: only, root: [0, 0.5], angle: 1.5}]")
    assert make_policy("hsc", single).initial_damping().shape == (1, 3)


def test_random_policy_is_seeded_and_uniform():
    """The same seed draws the same actions over the whole range, another seed others."""
    policy, obs = make_policy("random", load_params()), np.zeros(52)

    def drawn(seed, count=3):
        policy.reset(seed=seed)
        return np.array([policy(obs) for _ in range(count)])

    np.testing.assert_array_equal(drawn(1), drawn(1))
    assert not np.isin(drawn(1), drawn(2)).any()
    many = drawn(3, 400)
    assert -1.0 <= many.min() < -0.99 and 0.99 < many.max() < 1.0
    np.testing.assert_allclose(many.mean(axis=0), 0.0, atol=0.15)  # 400 draws, five standard deviations
    policy.reset(seed=3)
    np.testing.assert_array_equal(policy(np.zeros((4, 52))), many[:4])


@pytest.mark.parametrize("base", ORACLES)
def test_an_oracle_is_the_law_of_the_plant(base):
    """It acts as the law that is made for the plant, and not at all before it was told, after each reset."""
    plant, rows = load_params().with_overrides("object.mass=30", "panel.EI=15"), observations(30)
    oracle, wrong = (make_policy(name, load_params()) for name in (ORACLES[base], base))
    right = make_policy(base, plant)
    for _ in range(2):
        oracle.reset()
        right.reset()
        with pytest.raises(ValueError, match="needs the plant after each reset"):
            oracle(rows[0])
        oracle.set_plant(plant)
        with pytest.raises(ValueError, match="model of one plant"):
            oracle(rows[:2])
        actions = [oracle(obs) for obs in rows]
        np.testing.assert_array_equal(actions, [right(obs) for obs in rows])
    assert (np.array([wrong(obs) for obs in rows]) != actions).any()


@pytest.mark.parametrize("change", [ONE_PANEL, "object=null", "actuators.piezo.array=patches"])
def test_a_law_of_another_robot_runs_nowhere(change):
    """Neither in the compiled loop nor by itself: it would read and write beyond the arrays of this one."""
    env, other = SFFRFlexEnv(), SFFRFlexEnv(overrides=[change])
    for own, foreign in ((env, other), (other, env)):
        policy = make_policy("ahsc", foreign)
        with pytest.raises(ValueError, match="ahsc was made for a robot with other observations or actuators"):
            rollout(own, policy, 0)
    wide, narrow = make_policy("ahsc", env), make_policy("ahsc", other)
    obs, _ = env.reset(seed=0)
    if len(obs) != other.observation_space.shape[0]:
        for policy, own in ((narrow, env), (wide, other)):
            with pytest.raises(ValueError, match="ahsc expects observations of"):
                policy(own.reset(seed=0)[0])
