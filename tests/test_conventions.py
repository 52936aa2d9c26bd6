"""What users of Gymnasium take for granted, in all four environments: specs, seeds, limits, ends."""

import copy
import json
import pickle
from dataclasses import astuple

import gymnasium as gym
import numpy as np
import pytest
from both_ids import IDS, SHORT, SINGLES, VECTORS, zeros
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import sffr_gym
from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv
from sffr_gym.config.params import load_params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.task.scenario import load_scenario


@pytest.mark.parametrize("env_id", IDS)
@pytest.mark.parametrize(
    "arguments",
    [
        {"params": load_params().with_overrides("base.mass=60")},
        {"params": {"base": {"mass": 60.0}}},
        {"scenario": load_scenario("fast"), "overrides": ("panel.EI=25",)},
        {"scenario": {"name": "mine", "description": "a mapping", "duration": 1.0}},
        {"dtype": np.float32},
        {"dtype": np.dtype("float64")},
    ],
)
def test_a_spec_survives_json_whatever_was_given(env_id, arguments):
    """Objects, mappings and types become plain values, of which the same environment is made again."""
    single, batch = gym.make(env_id, **arguments), gym.make_vec(env_id, num_envs=2, **arguments)
    again = gym.make(EnvSpec.from_json(single.spec.to_json()))
    twice = gym.make_vec(EnvSpec.from_json(batch.spec.to_json()))
    assert again.spec.to_json() == single.spec.to_json() and twice.spec.to_json() == batch.spec.to_json()
    for one, other in ((single, again), (batch, twice)):
        assert one.unwrapped.params == other.unwrapped.params and one.unwrapped.scenario == other.unwrapped.scenario
        np.testing.assert_array_equal(one.reset(seed=1)[0], other.reset(seed=1)[0], strict=True)


def test_a_spec_names_files_so_that_they_are_found_from_anywhere(tmp_path, monkeypatch):
    """A relative path becomes an absolute one; a shipped name stays one."""
    (tmp_path / "mine.yaml").write_text(json.dumps({"name": "mine", "description": "a test's"}))
    monkeypatch.chdir(tmp_path)
    env = gym.make("SFFRFlex-v0", scenario=(tmp_path / "mine.yaml").relative_to(tmp_path))
    batch = gym.make_vec("SFFRFlex-v0", scenario="fast", autoreset_mode=AutoresetMode.SAME_STEP)
    monkeypatch.chdir("/")
    assert gym.make(EnvSpec.from_json(env.spec.to_json())).unwrapped.scenario.name == "mine"
    assert json.loads(batch.spec.to_json())["kwargs"]["scenario"] == "fast"
    assert gym.make_vec(EnvSpec.from_json(batch.spec.to_json())).unwrapped.autoreset_mode == AutoresetMode.SAME_STEP


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"params": 3}, "params = 3: must be Params, a file"),
        ({"params": {"base": {"mas": 3.0}}}, "params: base.mas: unknown key.*'mass'"),
        ({"scenario": 3}, "scenario = 3: must be a name"),
        ({"scenario": {"name": "mine"}}, "scenario: description"),
        ({"scenario": load_scenario("fast").model_copy(update={"duration": -1.0})}, "scenario: duration"),
        ({"overrides": "panel.EI=25"}, "overrides = 'panel.EI=25': must be a list"),
        ({"overrides": [3]}, "must be a list of assignments"),
    ],
)
@pytest.mark.parametrize("kind", [*SINGLES, *VECTORS])
def test_arguments_of_another_kind_are_refused(kind, arguments, message):
    """At construction, in a line that names the argument."""
    with pytest.raises(ConfigError, match=message):
        kind(**arguments)


@pytest.mark.parametrize("kind", VECTORS)
def test_a_limit_of_minus_one_is_none_and_what_is_no_limit_is_refused(kind):
    """As `gymnasium.make` has it."""
    for none in (-1, None, np.int64(-1)):
        env = kind(2, scenario=SHORT, max_episode_steps=none)
        env.reset(seed=0)
        assert not env.step(zeros(env))[3].any()
    for limit in (0, -2, 1.0, True, "3", np.nan):
        with pytest.raises(ValueError, match=r"max_episode_steps = .*: must be a whole number from 1 on, or -1"):
            kind(2, max_episode_steps=limit)
    env = kind(2, max_episode_steps=np.int64(2))
    env.reset(seed=0)
    assert [env.step(zeros(env))[3].all() for _ in range(2)] == [False, True]


@pytest.mark.parametrize("number", [0, -1, 2.0, True, None])
def test_a_number_of_environments_is_a_whole_one(number):
    """Anything else is refused by name."""
    with pytest.raises(ValueError, match="num_envs must be at least 1"):
        SFFRFlexVectorEnv(number)


@pytest.mark.parametrize("kind", SINGLES)
def test_seeds_are_told_and_generators_given_as_by_gymnasiums_loop(kind):
    """`np_random_seed` is the seed of each environment's stream, -1 for a generator of the user's."""
    batch = (SFFRFlexVectorEnv if kind is SFFRFlexEnv else SFFRFlexDampingVectorEnv)(3, scenario="excited")
    loop = SyncVectorEnv([lambda: kind(scenario="excited")] * 3)
    assert len(set(batch.np_random_seed)) == 3
    for seed in (7, None, [None, 30, None], 2**70):
        first, second = batch.reset(seed=seed)[0], loop.reset(seed=seed)[0]
        np.testing.assert_array_equal(first, second)
        assert batch.np_random_seed == loop.np_random_seed
        for one, other in zip(batch.np_random, loop.np_random, strict=True):
            assert one.bit_generator.state == other.bit_generator.state
    generators = [np.random.Generator(np.random.MT19937(i)) for i in range(3)]
    batch.np_random = copy.deepcopy(generators)
    loop.set_attr("np_random", copy.deepcopy(generators))
    np.testing.assert_array_equal(batch.reset()[0], loop.reset()[0])
    assert batch.np_random_seed == loop.np_random_seed == (-1, -1, -1)
    with pytest.raises(ValueError, match="3 of numpy's generators"):
        batch.np_random = generators[:2]


@pytest.mark.parametrize("kind", [*SINGLES, *VECTORS])
def test_seeds_that_are_none_are_refused_before_anything_changes(kind):
    """In Gymnasium's words; and numpy's whole numbers are seeds."""
    env = kind(scenario="excited")
    first = env.reset(seed=np.int64(3))[0]
    np.testing.assert_array_equal(first, env.reset(seed=3)[0])
    before = pickle.dumps(env.get_state())
    for seed, message in ((-1, "greater or equal to zero"), (1.0, "python integer"), (True, "python integer")):
        for given in (seed, [seed]) if kind in VECTORS else (seed, [3]):
            with pytest.raises(gym.error.Error, match=message if given is seed else ".*"):
                env.reset(seed=given, options={"scenario": "fast"})
    assert pickle.dumps(env.get_state()) == before


@pytest.mark.parametrize("kind", [*SINGLES, *VECTORS])
def test_options_that_are_none_are_refused_before_anything_changes(kind):
    """Whatever they are."""
    env = kind(scenario="excited")
    env.reset(seed=3)
    before = pickle.dumps(env.get_state())
    for options in (3, "scenario", ["scenario"], {"seed": 3}, {3: 3}, {"scenario": None}, {"scenario": "exited"}):
        with pytest.raises(ValueError, match=r"option|scenario|no such file"):
            env.reset(seed=4, options=options)
    if kind in VECTORS:
        for mask in (True, [True], np.ones(1), np.ones(2, dtype=np.bool_), "all"):
            with pytest.raises(ValueError, match="reset_mask"):
                env.reset(seed=4, options={"reset_mask": mask, "scenario": "fast"})
    assert pickle.dumps(env.get_state()) == before
    options = {"scenario": "fast"}
    env.reset(options=options)
    assert options == {"scenario": "fast"} and env.scenario.name == "fast"


SETTLED = ["params", "scenario", "prior_task", "fields", "plant_task", "time", "positions", "ticks", "render_mode"]


@pytest.mark.parametrize("kind", [*SINGLES, *VECTORS])
def test_what_is_read_only_once_cannot_be_set(kind):
    """The message says what to do instead; nothing changes."""
    env = kind()
    env.reset(seed=0)
    names = [name for name in SETTLED if hasattr(env, name)]
    names += ["num_envs", "autoreset_mode"] if kind in VECTORS else ["plant", "episode", "reference", "np_random_seed"]
    names += ["law", "law_name", "obs_names", "action_names", "damping"] if hasattr(env, "law") else []
    for name in names:
        before = getattr(env, name)
        with pytest.raises(AttributeError, match=f"^{name} of {kind.__name__} cannot be set, .*: .*"):
            setattr(env, name, before)
    if kind in SINGLES:
        with pytest.raises(AttributeError, match="scenario's `plant`"):
            gym.wrappers.RecordEpisodeStatistics(env).set_wrapper_attr("params", env.params)
    env.mine = 3  # what users keep with an environment is theirs
    assert copy.deepcopy(env).mine == pickle.loads(pickle.dumps(env)).mine == 3


@pytest.mark.parametrize("kind", VECTORS)
def test_environments_of_a_batch_are_asked_as_those_of_gymnasiums_loop(kind):
    """`call` and `get_attr` give for each environment what a single one has, or say what to use instead."""
    batch = kind(3, scenario="mismatch")
    loop = SyncVectorEnv([lambda: SINGLES[VECTORS.index(kind)](scenario="mismatch")] * 3)
    for env in (batch, loop):
        env.reset(seed=2)
        env.step(zeros(env))
    for one, other in zip(batch.call("state"), loop.call("state"), strict=True):
        for left, right in zip(astuple(one), astuple(other), strict=True):
            np.testing.assert_array_equal(left, right)
    names = [
        "params",
        "scenario",
        "time",
        "ticks",
        "np_random_seed",
        "render_mode",
        "action_space",
        "observation_space",
    ]
    for name in [*names, "positions", "velocities", *(["damping", "law_name"] if kind is VECTORS[1] else [])]:
        for one, other in zip(batch.get_attr(name), loop.get_attr(name), strict=True):
            assert np.array_equal(one, other) if isinstance(one, np.ndarray) else one == other, name
    np.testing.assert_array_equal(
        [task.model.link_mass for task in batch.get_attr("plant_task")],
        [task.model.link_mass for task in loop.get_attr("plant_task")],
    )
    assert [each.radius for each in batch.get_attr("reference")] == [15.0] * 3
    for name in ("reset", "step", "_batch", "set_state", "num_envs", "nothing"):
        with pytest.raises(AttributeError, match=f"no '{name}' of their own"):
            batch.call(name)
    with pytest.raises(AttributeError, match="params cannot be set for the environments of a batch: its plant"):
        batch.set_attr("params", load_params())
    batch.set_attr("np_random", [np.random.default_rng(i) for i in range(3)])
    assert batch.np_random_seed == (-1, -1, -1)


@pytest.mark.parametrize("kind", [*SINGLES, *VECTORS])
def test_an_environment_can_be_closed_twice(kind):
    """And used afterwards: it holds nothing that is gone."""
    env = kind(scenario=SHORT)
    env.reset(seed=0)
    env.close()
    env.close()
    assert np.isfinite(env.reset(seed=0)[0]).all() and np.isfinite(env.step(zeros(env))[0]).all()


def test_a_step_beyond_the_end_is_defined():
    """The plant goes on; with a law inside nothing moves after the time is over, and nothing is paid."""
    env = SFFRFlexEnv(SHORT.model_copy(update={"duration": 0.004}))
    env.reset(seed=0)
    assert [env.step(zeros(env))[3] for _ in range(4)] == [False, True, True, True] and env.time == pytest.approx(0.008)
    env = SFFRFlexDampingEnv(SHORT, duration=None)
    env.reset(seed=0)
    steps = [env.step(zeros(env)) for _ in range(4)]
    assert [step[3] for step in steps] == [False, True, True, True] and env.time == pytest.approx(0.2)
    assert steps[1][1] > 0.0 and steps[2][1] == steps[3][1] == 0.0 and steps[3][4]["reward_vibration"] == 0.0
    np.testing.assert_array_equal(steps[1][0], steps[3][0])


def test_a_subclass_adds_what_it_likes():
    """Its own attributes, infos and spaces."""

    class Mine(SFFRFlexEnv):
        def __init__(self, **arguments):
            super().__init__(**arguments)
            self.count = 0

        def step(self, action):
            self.count += 1
            obs, reward, *rest = super().step(action)
            return obs, 2.0 * reward, *rest

    env = Mine(scenario=SHORT)
    env.reset(seed=0)
    env.step(zeros(env))
    assert env.count == 1 and sffr_gym.SFFRFlexEnv in Mine.__mro__
