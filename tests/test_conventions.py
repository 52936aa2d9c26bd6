"""What users of Gymnasium take for granted, in all four environments: specs, seeds, limits, types, wrappers."""

import copy
import json
import pickle
import re
from dataclasses import astuple

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import vector as vector_wrappers

import sffr_gym
from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv
from sffr_baselines.rollout import rollout
from sffr_gym.config.params import load_params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.spaces import check_action
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.task.scenario import Scenario, load_scenario, scenario_names
from sffr_gym.task.status import REASONS, Failure

IDS = ("SFFRFlex-v0", "SFFRFlexDamping-v0")
SINGLES = (SFFRFlexEnv, SFFRFlexDampingEnv)
VECTORS = (SFFRFlexVectorEnv, SFFRFlexDampingVectorEnv)
SHORT = Scenario(name="short", description="a test's", duration=0.2)


def zeros(env):
    return np.zeros(env.action_space.shape)


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
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_observations_have_the_type_that_was_asked_for(kind, dtype):
    """In space, resets and steps; the state behind them is the same, and float32 is the rounded float64."""
    env, exact = kind(scenario=SHORT, dtype=dtype), kind(scenario=SHORT, dtype="float64")
    assert env.observation_space.dtype == dtype
    for each in (env, exact):
        each.reset(seed=0)
    obs, twin = env.step(zeros(env))[0], exact.step(zeros(env))[0]
    assert obs.dtype == dtype and obs in env.observation_space
    np.testing.assert_array_equal(obs, twin.astype(dtype))
    for wrong in ("float16", "int64", "nonsense", None, ">f8", complex):
        with pytest.raises(ValueError, match="must be one of float32, float64"):
            kind(dtype=wrong)


@pytest.mark.parametrize("limit", ["limits.position=0.3", "limits.velocity=1.1", "limits.rate=0.7"])
def test_rounded_observations_stay_in_the_rounded_space(limit):
    """Also those that lie on a bound that float32 does not have."""
    env = SFFRFlexEnv(overrides=[limit], dtype="float32")
    obs, _ = env.reset(seed=0)
    ended = False
    while not ended:
        assert obs in env.observation_space
        obs, _, ended, truncated, info = env.step(np.ones(15))
        assert not truncated
    assert obs in env.observation_space and info["failure"]


def test_laws_run_on_float32_observations():
    """A policy's closed loop takes the true observation whatever its type."""
    env = SFFRFlexEnv(scenario=SHORT, dtype="float32")
    policy = sffr_policy(env)
    assert not rollout(env, policy, 0).failure


def sffr_policy(env):
    from sffr_baselines import make_policy

    return make_policy("hsc", env)


REFUSED = [
    np.zeros(15) + 1j, np.zeros(15, dtype=object), ["0"] * 15, np.zeros(15, dtype=np.bool_), None, "action", {},
    np.ma.masked_array(np.zeros(15), mask=[True] + [False] * 14), np.zeros(15, dtype="m8[s]"), [0.0] * 14 + [None],
    np.array(["2020"] * 15, dtype="M8[s]"), [[0.0]] * 14 + [[1.0, 2.0]], np.zeros(14), np.zeros((15, 1)), np.zeros(0),
]  # fmt: skip


@pytest.mark.parametrize("action", REFUSED, ids=lambda action: str(action)[:20].replace("\n", " "))
def test_actions_that_are_no_real_numbers_are_refused(action):
    """Nothing is dropped or converted in silence, and nothing moves."""
    env = SFFRFlexEnv()
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"action|inhomogeneous"):
        env.step(action)
    assert env.time == 0.0


@pytest.mark.parametrize("kind", [np.int8, np.uint8, np.int64, np.float16, np.float32, np.float64, np.longdouble, list])
def test_real_numbers_of_every_kind_are_actions(kind):
    """As their float64 value."""
    values = [1, 0, 1]
    action = values if kind is list else np.array(values, dtype=kind)
    checked = check_action(action, (3,))
    assert checked.dtype == np.float64 and checked.tolist() == values


@pytest.mark.parametrize("name", scenario_names())
@pytest.mark.parametrize("kind", SINGLES)
def test_infos_are_numbers_that_files_can_hold(kind, name):
    """Every value is a number or an array of numbers, below `drawn` too, and of one type in resets and steps."""

    def check(values):
        for key, value in values.items():
            if isinstance(value, dict):
                assert value, f"{key} is empty"
                check(value)
            else:
                assert np.asarray(value).dtype.kind in "fiub", key

    env = kind(scenario=name)
    infos = [env.reset(seed=0)[1], env.step(zeros(env))[4]]
    for info in infos:
        check(info)
    assert {key: type(value) for key, value in infos[0].items()} == {k: type(value) for k, value in infos[1].items()}


def test_a_failure_is_a_number_and_a_reason():
    """False where there is none; texts as tables show them; files get the number."""
    assert [str(each) for each in Failure] == [REASONS[code] for code in sorted(REASONS)]
    assert not Failure.NONE and all(list(Failure)[1:])
    assert f"{Failure.GRASP_LOST}" == f"{Failure.GRASP_LOST:s}" == "lost grasp" and (Failure.NONE or "fine") == "fine"
    assert np.asarray([Failure.TIP_RANGE]).dtype == np.int64 and json.dumps(Failure.TIP_RANGE) == "1"
    assert copy.deepcopy(Failure.TIP_RANGE) is pickle.loads(pickle.dumps(Failure.TIP_RANGE)) is Failure.TIP_RANGE


WRAPPERS = {
    "ReshapeObservation": lambda env: vector_wrappers.ReshapeObservation(env, (2, -1)),
    "FlattenObservation": vector_wrappers.FlattenObservation,
    "RescaleObservation": lambda env: vector_wrappers.RescaleObservation(env, -1.0, 1.0),
    "DtypeObservation": lambda env: vector_wrappers.DtypeObservation(env, np.float32),
    "NormalizeObservation": vector_wrappers.NormalizeObservation,
    "NormalizeReward": vector_wrappers.NormalizeReward,
    "RecordEpisodeStatistics": vector_wrappers.RecordEpisodeStatistics,
    "DictInfoToList": lambda env: vector_wrappers.DictInfoToList(vector_wrappers.RecordEpisodeStatistics(env)),
    "RescaleAction": lambda env: vector_wrappers.RescaleAction(env, -2.0, 2.0),
    "ClipReward": lambda env: vector_wrappers.ClipReward(env, -1.0, 1.0),
}


@pytest.mark.filterwarnings("ignore:.*precision lowered")  # of bounds by Gymnasium's own wrappers
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("name", WRAPPERS)
@pytest.mark.parametrize("k", [0, 1])
def test_gymnasiums_vector_wrappers_work_as_on_its_loop(name, mode, k):
    """Over the end of episodes, with the same outputs and infos."""
    scenario, steps = (SHORT, 4) if k else (SHORT.model_copy(update={"duration": 0.006}), 5)
    arguments = {"scenario": scenario, "duration": None} if k else {"scenario": scenario}
    native = VECTORS[k](2, autoreset_mode=mode, **arguments)
    loop = SyncVectorEnv([lambda: SINGLES[k](**arguments)] * 2, autoreset_mode=mode)
    outputs = []
    for env in (native, loop):
        try:
            with np.errstate(over="ignore"):  # the largest float64 as float32
                wrapped = WRAPPERS[name](env)
            outputs.append([wrapped.reset(seed=0), *(wrapped.step(zeros(wrapped)) for _ in range(steps))])
        except (AssertionError, ValueError) as error:  # some know no SAME_STEP
            outputs.append(re.sub(r"0x\w+|SFFRFlex\w+|SyncVectorEnv", "", str(error)))
    assert type(outputs[0]) is type(outputs[1]), outputs
    if isinstance(outputs[0], str):
        return
    for one, other in zip(*outputs, strict=True):
        for left, right in zip(one[:-1], other[:-1], strict=True):
            np.testing.assert_allclose(left, right, rtol=1e-6)
        if isinstance(one[-1], dict):
            assert set(one[-1]) == set(other[-1])
            for i in np.flatnonzero(other[-1].get("_final_obs", [])):
                np.testing.assert_allclose(one[-1]["final_obs"][i], other[-1]["final_obs"][i], rtol=1e-6)
            if "final_info" in other[-1]:
                assert set(one[-1]["final_info"]) == set(other[-1]["final_info"])
        else:
            assert [set(each) for each in one[-1]] == [set(each) for each in other[-1]]


@pytest.mark.filterwarnings("ignore:.*precision lowered")  # of bounds by Gymnasium's own wrappers
@pytest.mark.parametrize("kind", SINGLES)
def test_gymnasiums_wrappers_work(kind):
    """One on the other, over an episode's end, with the spec that tells them all."""
    env = gym.make(IDS[SINGLES.index(kind)], scenario=SHORT, max_episode_steps=-1)
    for wrap in (
        lambda env: gym.wrappers.TimeLimit(env, 2),
        lambda env: gym.wrappers.RescaleAction(env, -2.0, 2.0),
        gym.wrappers.RecordEpisodeStatistics,
        gym.wrappers.FlattenObservation,
        gym.wrappers.ClipAction,
        gym.wrappers.NormalizeObservation,
        gym.wrappers.Autoreset,
    ):
        env = wrap(env)
    env.reset(seed=0)
    steps = [env.step(np.zeros(env.action_space.shape, np.float32)) for _ in range(3)]
    assert [step[3] for step in steps] == [False, True, False] and "episode" in steps[1][4]
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    np.testing.assert_allclose(again.reset(seed=0)[0], env.reset(seed=0)[0], atol=10.0)


@pytest.mark.parametrize("shared", [True, False])
def test_processes_of_gymnasium_give_the_same_infos(shared):
    """Failures and what was drawn go through pipes and shared memory."""
    other = gym.make_vec(
        "SFFRFlex-v0", num_envs=2, scenario="excited", dtype="float32", vectorization_mode="async",
        vector_kwargs={"shared_memory": shared},
    )  # fmt: skip
    native = SFFRFlexVectorEnv(2, scenario="excited", dtype="float32")
    try:
        for left, right in (
            (native.reset(seed=0), other.reset(seed=0)),
            (native.step(zeros(native)), other.step(zeros(other))),
        ):
            np.testing.assert_array_equal(left[0], right[0], strict=True)
            assert set(left[-1]) == set(right[-1]) and set(left[-1]["drawn"]) == set(right[-1]["drawn"])
            assert (left[-1]["failure"] == right[-1]["failure"]).all()
        assert other.call("time") == native.call("time")
    finally:
        other.close()


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
    assert steps[1][1] < 0.0 and steps[2][1] == steps[3][1] == 0.0 and steps[3][4]["reward_vibration"] == 0.0
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
