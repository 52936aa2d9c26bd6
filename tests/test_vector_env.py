"""The native batch against the single environments: the same bits for any size and number of threads, in all modes."""

import functools
import os
import pickle
import subprocess
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from stepping import N_ACTIONS, actions_of

from sffr_gym.compile.arguments import Structures
from sffr_gym.compile.lanes import WIDTH
from sffr_gym.config.params import load_params
from sffr_gym.envs import batch, vector
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.task.episode import draw, nominal
from sffr_gym.task.scenario import load_scenario, scenario_names
from sffr_gym.task.status import REASONS, RUNNING
from sffr_gym.task.task_model import make_task_model

SINCE_1_4 = pytest.mark.skipif(
    tuple(map(int, gym.__version__.split(".")[:2])) < (1, 4), reason="the wrapper miscounts SAME_STEP before 1.4"
)
MODES = list(AutoresetMode)


def actions(steps, n, seed=0):
    """Random actions with a constant pull on the panels, so that some episodes fail and others last."""
    rng = np.random.default_rng(seed)
    inputs = 0.2 * rng.uniform(-1.0, 1.0, (steps, n, N_ACTIONS))
    inputs[:, :, [1, 4]] += rng.uniform(-2.0, 2.0, (n, 2))
    return inputs


def assert_infos_agree(native, single):
    """Every entry that a mask declares valid is the same in both, and nothing else is declared."""
    assert {key for key in native if key.startswith("_")} == {key for key in single if key.startswith("_")}
    for key, values in single.items():
        if key.startswith("_"):
            np.testing.assert_array_equal(native[key], values, err_msg=key)
        elif isinstance(values, dict):
            assert_infos_agree(native[key], values)
        else:
            mask = single[f"_{key}"]
            left, right = (np.array([*found[key][mask]]) for found in (native, single))
            np.testing.assert_array_equal(left, right, err_msg=key)


def assert_outputs_agree(native, single):
    """Two outputs of reset or step are the same to the last bit."""
    for left, right in zip(native[:-1], single[:-1], strict=True):
        assert left.dtype == right.dtype
        np.testing.assert_array_equal(left, right, strict=True)
    assert_infos_agree(native[-1], single[-1])


@pytest.fixture
def scenario(user_scenario):
    """Return the path of a scenario of 0.15 s whose panels swing widely."""
    return user_scenario(duration=0.15, panel_modes=[{"mode": 1, "amplitude": [0.1, 0.99]}])


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("n", [1, 3, 70])
def test_batch_equals_single_environments(scenario, mode, n):
    """Outputs, infos and autoreset are those of Gymnasium's loop over single environments, whatever ends them."""
    native = SFFRFlexVectorEnv(n, scenario=scenario, autoreset_mode=mode)
    single = SyncVectorEnv([lambda: SFFRFlexEnv(scenario, native.params)] * n, autoreset_mode=mode)
    assert native.observation_space == single.observation_space and native.action_space == single.action_space
    assert native.metadata["autoreset_mode"] == single.metadata["autoreset_mode"] == mode
    assert_outputs_agree(native.reset(seed=100), single.reset(seed=100))
    ends = np.zeros(2, dtype=int)
    for inputs in actions(250 if n < 70 else 160, n):
        output = native.step(inputs)
        assert_outputs_agree(output, single.step(inputs))
        ends += [output[2].sum(), output[3].sum()]
        done = output[2] | output[3]
        if mode == AutoresetMode.DISABLED and done.any():
            assert_outputs_agree(
                native.reset(options={"reset_mask": done}), single.reset(options={"reset_mask": done.copy()})
            )
    assert ends.min() > 0 or n == 1
    assert ends.sum() > 0


@pytest.mark.parametrize("name", scenario_names())
def test_batch_equals_single_environments_in_every_scenario(name):
    """Plants, faults, sensors and impulses of each environment are those of its seed, and its info tells them."""
    n = 11  # eight in lanes where all plants are alike, and three more
    native = SFFRFlexVectorEnv(n, scenario=name)
    single = SyncVectorEnv([lambda: SFFRFlexEnv(name)] * n)
    assert_outputs_agree(native.reset(seed=30), single.reset(seed=30))
    for inputs in actions_of(native, 60):
        assert_outputs_agree(native.step(inputs), single.step(inputs))
    native.close()


def test_plants_come_and_go_with_the_scenario():
    """Environments of one batch may be in scenarios of one plant for all and of one for each, in any order."""
    n = 3
    native = SFFRFlexVectorEnv(n, autoreset_mode=AutoresetMode.DISABLED)
    singles = [SFFRFlexEnv() for _ in range(n)]
    native.reset(seed=7)
    for i, env in enumerate(singles):
        env.reset(seed=7 + i)
    for name, who in (
        ("mismatch", [1]),
        ("degraded", [0, 1]),
        ("nominal", [0]),
        ("payload", [2]),
        ("nominal", [0, 1, 2]),
    ):
        native.reset(options={"scenario": name, "reset_mask": np.isin(np.arange(n), who)})
        for i in who:
            singles[i].reset(options={"scenario": name})
        for inputs in actions(10, n):
            obs, reward, *_ = native.step(inputs)
            for i, env in enumerate(singles):
                alone = env.step(inputs[i])
                np.testing.assert_array_equal(obs[i], alone[0])
                assert reward[i] == alone[1]


@pytest.mark.parametrize(("threads", "chunk", "spans"), [(1, 1, 1), (2, 16, 2), (3, 8, 3), (3, 20, 2), (8, 8, 5)])
def test_threads_do_not_matter(monkeypatch, scenario, threads, chunk, spans):
    """However a batch is cut up for the threads, it goes through the same states."""
    n, results = 45, []  # forty in lanes, and five
    for setting in ((1, 32), (threads, chunk)):
        monkeypatch.setattr(batch, "THREADS", setting[0])
        monkeypatch.setattr(vector, "Stepper", functools.partial(batch.Stepper, smallest=setting[1]))
        env = SFFRFlexVectorEnv(n, scenario=scenario)
        env.reset(seed=3)
        results.append([env.step(inputs) for inputs in actions(90, n)])
        parts = [call.arguments[-2:] for calls in env._stepper._in_lanes for call in calls]
    assert len(parts) == spans + 1
    assert [first for first, _ in parts] == [0] + [last for _, last in parts[:-1]] and parts[-1] == (40, n)
    for left, right in zip(*results, strict=True):
        assert_outputs_agree(left, right)


@pytest.mark.parametrize("n", [3, WIDTH])
def test_a_neighbour_that_blows_up_does_no_harm(n):
    """A state that overflows ends its own episode alone; the others do not feel it, one after the other or in lanes."""
    robot, params = make_task_model(load_params()), load_params()
    rng = np.random.default_rng(0)
    episodes = [draw(load_scenario("excited"), nominal(params), rng) for _ in range(n)]
    envs, alone = batch.make_batch(robot, n), batch.make_batch(robot, n)
    steppers = []
    for each in (envs, alone):
        stepper = batch.Stepper(batch.step_range, Structures([robot]), each, N_ACTIONS, batch.group_shapes(robot))
        for i, episode in enumerate(episodes):
            batch.put_episode(each, i, episode)
        stepper.observe()
        stepper.actions[:] = actions(1, n)[0]
        steppers.append(stepper)
    envs.v[1, 4] = 1.0e200
    seen, measured = envs.obs[1].copy(), envs.signals[1].copy()
    others = steppers[1].active[:] = np.arange(n) != 1
    with np.errstate(all="ignore"):  # where the kernels are not compiled
        steppers[0].step()
    steppers[1].step()
    assert REASONS[envs.status[1]] == "non-finite state"
    np.testing.assert_array_equal(envs.obs[1], seen)  # what it was before, as positions are
    np.testing.assert_array_equal(envs.signals[1], measured)
    for left, right in zip(envs, alone, strict=True):
        np.testing.assert_array_equal(left[others], right[others])
        assert np.isfinite(left).all()
    assert (envs.status[others] == RUNNING).all() and list(alone.tick) == list(others)


def test_reset_mask_touches_no_other_environment(scenario):
    """A partial reset returns the present observations of the others, which go on as if nothing had happened."""
    env, undisturbed = (SFFRFlexVectorEnv(3, scenario=scenario, autoreset_mode="Disabled") for _ in range(2))
    for each in (env, undisturbed):
        each.reset(seed=0)
    for inputs in 0.1 * actions(10, 3):
        before = env.step(inputs)[0]
        undisturbed.step(inputs)
    mask = np.array([False, True, False])
    obs, infos = env.reset(seed=[7, 7, 7], options={"reset_mask": mask})
    np.testing.assert_array_equal(obs[~mask], before[~mask])
    np.testing.assert_array_equal(obs[mask], SFFRFlexVectorEnv(1, scenario=scenario).reset(seed=7)[0])
    for key in ("object_error", "failure", "applied", *(key for key in infos if key.startswith("drawn_"))):
        np.testing.assert_array_equal(infos[f"_{key}"], mask)
    inputs = 0.1 * actions(1, 3, 5)[0]
    left, right = env.step(inputs), undisturbed.step(inputs)
    np.testing.assert_array_equal(left[0][~mask], right[0][~mask])
    np.testing.assert_allclose(left[4]["time"], [0.022, 0.002, 0.022], rtol=1e-12)


def test_a_new_scenario_for_some_replaces_what_they_drew():
    """After a partial reset into another scenario, info agrees with that of single environments, reset and step."""
    native = SFFRFlexVectorEnv(3, scenario="excited", autoreset_mode=AutoresetMode.DISABLED)
    single = SyncVectorEnv([lambda: SFFRFlexEnv("excited")] * 3, autoreset_mode=AutoresetMode.DISABLED)
    for env in (native, single):
        env.reset(seed=0)
    outputs = [
        [env.reset(options={"reset_mask": np.array([True, False, True]), "scenario": name}) for env in (native, single)]
        for name in ("nominal", "offset")
    ]
    outputs.append([env.step(np.zeros((3, N_ACTIONS))) for env in (native, single)])
    for left, right in outputs:
        assert_outputs_agree(left, right)


def test_a_new_scenario_keeps_the_length_of_running_episodes(user_scenario):
    """A partial reset into a shorter scenario does not truncate the others."""
    long, short = user_scenario(duration=0.1), user_scenario(duration=0.01)
    env = SFFRFlexVectorEnv(2, scenario=long, autoreset_mode="Disabled")
    env.reset(seed=0)
    for _ in range(6):
        env.step(np.zeros((2, N_ACTIONS)))
    env.reset(options={"reset_mask": np.array([True, False]), "scenario": short})
    assert list(env.step(np.zeros((2, N_ACTIONS)))[3]) == [False, False]


@pytest.mark.parametrize("mode", MODES)
def test_infos_have_constant_keys_and_returned_arrays_are_new(scenario, mode):
    """Keys and masks never change but for the final ones, and no array is handed out twice."""
    env = SFFRFlexVectorEnv(2, scenario=scenario, autoreset_mode=mode)
    seen, keys = [], set(env.reset(seed=0)[1])
    for inputs in 0.1 * actions(74, 2):
        obs, reward, terminated, truncated, infos = env.step(inputs)
        assert set(infos) == keys
        assert all(infos[f"_{key}"].dtype == bool for key in infos if not key.startswith("_"))
        new = [obs, reward, terminated, truncated, infos["applied"], infos["vibration"], infos["_vibration"]]
        assert not any(np.shares_memory(one, other) for one in new for other in seen)
        seen = new
    *_, infos = env.step(np.zeros((2, N_ACTIONS)))  # the last of 75
    final = {"final_obs", "_final_obs", "final_info", "_final_info"} if mode == AutoresetMode.SAME_STEP else set()
    assert set(infos) == keys | final


def test_vector_environment_survives_pickling(scenario):
    """A pickled batch goes on as the original does."""
    env = SFFRFlexVectorEnv(3, scenario=scenario)
    env.reset(seed=0)
    for inputs in actions(40, 3):
        env.step(inputs)
    other = pickle.loads(pickle.dumps(env))
    for inputs in actions(60, 3, 1):
        assert_outputs_agree(env.step(inputs), other.step(inputs))


def test_make_vec_passes_the_time_limit(scenario):
    """`gymnasium.make_vec` takes the native batch, and its limit and arguments reach it."""
    env = gym.make_vec("SFFRFlex-v0", num_envs=2, max_episode_steps=3, scenario=scenario, overrides=["panel.EI=25"])
    assert isinstance(env.unwrapped, SFFRFlexVectorEnv) and env.unwrapped.params.panel.EI == 25
    env.reset(seed=0)
    ends = [list(env.step(np.zeros((2, N_ACTIONS)))[3]) for _ in range(5)]
    assert ends == [[False, False]] * 2 + [[True, True]] + [[False, False]] * 2
    assert gym.make_vec("SFFRFlex-v0", num_envs=5).unwrapped.num_envs == 5


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, pytest.param(AutoresetMode.SAME_STEP, marks=SINCE_1_4)])
def test_gymnasiums_episode_statistics_work(scenario, mode):
    """Gymnasium's wrapper counts lengths and returns of the batch as they are."""
    env = RecordEpisodeStatistics(SFFRFlexVectorEnv(3, scenario=scenario, autoreset_mode=mode))
    env.reset(seed=0)
    total, length = np.zeros(3), np.zeros(3, dtype=int)
    finished = 0
    for inputs in actions(200, 3):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            _, reward, terminated, truncated, infos = env.step(inputs)
        total, length = total + reward, length + 1
        done = terminated | truncated
        if done.any():
            np.testing.assert_array_equal(infos["_episode"], done)
            np.testing.assert_allclose(infos["episode"]["r"][done], total[done], rtol=1e-12)
            np.testing.assert_array_equal(infos["episode"]["l"][done], length[done])
            finished += done.sum()
            # With NEXT_STEP the reset takes a step of its own, which counts for no episode.
            total[done], length[done] = 0.0, -1 if mode == AutoresetMode.NEXT_STEP else 0
    assert finished > 3


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_process_can_step():
    """A worker forked after the batch has run in threads, as process pools do, steps and does not wait for ever."""
    code = (
        "import os, signal, time, numpy as np\n"
        "from sffr_gym.envs import batch\n"
        "from sffr_gym.envs.vector import SFFRFlexVectorEnv\n"
        "batch.THREADS, batch.SMALLEST_CHUNK = 2, 1\n"
        "env = SFFRFlexVectorEnv(4)\n"
        "env.reset(seed=0)\n"
        "for _ in range(50):\n"
        "    env.step(np.zeros((4, 15)))\n"
        "time.sleep(0.2)\n"  # until both threads are idle
        "child = os.fork()\n"
        "if child == 0:\n"
        "    signal.alarm(10)\n"
        "    env.step(np.zeros((4, 15)))\n"
        "    os._exit(0)\n"
        "print(os.waitpid(child, 0)[1])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "0", "the child did not return"
