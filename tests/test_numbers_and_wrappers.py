"""What users of Gymnasium take for granted, in all four environments: types of numbers, infos, wrappers."""

import copy
import json
import pickle
import re

import gymnasium as gym
import numpy as np
import pytest
from both_ids import IDS, SHORT, SINGLES, VECTORS, zeros
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import vector as vector_wrappers

from sffr_baselines import make_policy
from sffr_baselines.rollout import rollout
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.spaces import check_action
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.task.scenario import scenario_names
from sffr_gym.task.status import REASONS, Failure


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
    assert not rollout(env, make_policy("hsc", env), 0).failure


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
            assert set(left[-1]) == set(right[-1])
            assert any(key.startswith("drawn_panel") for key in left[-1])
            assert (left[-1]["failure"] == right[-1]["failure"]).all()
        assert other.call("time") == native.call("time")
    finally:
        other.close()
