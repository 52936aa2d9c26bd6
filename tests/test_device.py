"""Environments on a GPU: their code, compiled for the processor as well, gives the processor's bits."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from drawn import everything
from gymnasium.vector import AutoresetMode

from sffr_baselines import make_policy
from sffr_baselines.damping_env import SFFRFlexDampingVectorEnv
from sffr_baselines.device_law import DeviceLaw
from sffr_baselines.rollout import result_of, rollout
from sffr_gym import ConfigError
from sffr_gym.compile.cuda.program import Processor
from sffr_gym.compile.library import load_library
from sffr_gym.envs.device import DeviceVectorEnv
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.task.scenario import load_scenario, scenario_names
from sffr_workbench.benchmark.device_episodes import run_on_device

pytestmark = [
    pytest.mark.skipif(load_library() is None, reason="compares compiled code"), pytest.mark.usefixtures("programs")
]  # fmt: skip
SAME_ROBOT = ["nominal", "excited", "offset", "noise", "impulse", "fast"]  # as the controllers believe: one program
OTHERS = [name for name in scenario_names() if name != "nominal"]


def pair(kind, n, mode=AutoresetMode.NEXT_STEP, **arguments):
    """The same environments on the processor, and as a GPU runs them."""
    native = kind(n, autoreset_mode=mode, **arguments)
    return native, DeviceVectorEnv(kind(1, **arguments), n, mode, Processor())


def actions(space, steps, seed=0):
    """Random actions, with a constant pull on the panels, so that some episodes fail and others last."""
    rng = np.random.default_rng(seed)
    inputs = 0.2 * rng.uniform(-1.0, 1.0, (steps, *space.shape))
    if space.shape[1] > 4:
        inputs[:, :, [1, 4]] += 2.0 * np.linspace(-1.0, 1.0, space.shape[0])[:, None]
    return inputs


def assert_same(native, device):
    for left, right in zip(native[:-1], device[:-1], strict=True):
        np.testing.assert_array_equal(left, right, strict=True)
    for key, mask in native[-1].items():
        if key.startswith("_") and key in device[-1] and key[1:] not in ("final_obs", "final_info"):
            values, others = native[-1][key[1:]], device[-1][key[1:]]
            np.testing.assert_array_equal(values[mask], others[mask], err_msg=key)


def assert_same_episodes(kind, scenario, mode, steps, **arguments):
    native, device = pair(kind, 3, mode, scenario=scenario, **arguments)
    assert_same(native.reset(seed=7), device.reset(seed=7))
    ends = 0
    for action in actions(native.action_space, steps):
        expected = native.step(action)
        assert_same(expected, device.step(action))
        ends += int((expected[2] | expected[3]).sum())
    assert ends > 3, "more than each environment's first episode shall end"


@pytest.mark.parametrize("scenario", ["nominal", everything()], ids=["nominal", "everything"])
def test_episodes_are_those_of_the_processor(scenario):
    """Of one that draws nothing, and of one that draws all that is drawn on the device."""
    assert_same_episodes(SFFRFlexVectorEnv, scenario, AutoresetMode.NEXT_STEP, 500, max_episode_steps=200)


def test_what_was_drawn_is_told():
    """Of the scenario that is asked for; new seeds draw anew, and environments that are not reset keep theirs."""
    native, device = pair(SFFRFlexVectorEnv, 3)
    device.reset(seed=7)
    assert device.drawn(0) == {}
    for seed in (7, 8):
        _, infos = native.reset(seed=seed, options={"scenario": everything()})
        obs, _ = device.reset(seed=seed, options={"scenario": everything()})
        np.testing.assert_array_equal(obs, native._observed())
        for i in range(3):
            assert device.drawn(i) == {
                name.removeprefix("drawn_"): infos[name][i] for name in infos if name.startswith("drawn_")
            }
    before, mask = device.drawn(0), np.array([False, True, False])
    device.reset(options={"reset_mask": mask})
    native.reset(options={"reset_mask": mask})
    assert device.drawn(0) == before
    assert device.drawn(1)["path_phase_rad"] == native._drawn["path_phase_rad"][0][1]
    for each in (native, device):
        each.reset(options={"scenario": "nominal"})
    np.testing.assert_array_equal(device.batch.p, native._batch.p)
    assert device.drawn(1) == {}


@pytest.mark.slow
@pytest.mark.parametrize("scenario", OTHERS)
def test_episodes_are_those_of_the_processor_in_all_scenarios(scenario):
    assert_same_episodes(SFFRFlexVectorEnv, scenario, AutoresetMode.NEXT_STEP, 500, max_episode_steps=200)


@pytest.mark.slow
def test_plants_that_differ_are_those_of_the_processor():
    assert_same_episodes(SFFRFlexVectorEnv, "mismatch", AutoresetMode.SAME_STEP, 300, max_episode_steps=100)


@pytest.mark.slow
@pytest.mark.parametrize(
    "override", ["panel.foreshortening=true", "simulation.integrator=rk4", "object=null", "panel.elements=4"]
)
def test_robots_of_other_kinds_are_those_of_the_processor(override):
    more = ["panel.bending_cut=20"] if "foreshortening" in override else []
    assert_same_episodes(
        SFFRFlexVectorEnv, "nominal", AutoresetMode.NEXT_STEP, 120, max_episode_steps=50, overrides=[override, *more]
    )


@pytest.mark.slow
def test_a_law_inside_is_that_of_the_processor():
    assert_same_episodes(SFFRFlexDampingVectorEnv, "excited", AutoresetMode.NEXT_STEP, 13, duration=0.5)


def test_same_step_returns_the_new_and_the_last_observation():
    native, device = pair(SFFRFlexVectorEnv, 3, AutoresetMode.SAME_STEP, scenario=everything(), max_episode_steps=3)
    native.reset(seed=3)
    device.reset(seed=3)
    for action in actions(native.action_space, 5):
        expected, found = native.step(action), device.step(action)
        assert_same(expected, found)
        for i in np.flatnonzero(found[-1]["_final_obs"]):
            np.testing.assert_array_equal(found[-1]["final_obs"][i], expected[-1]["final_obs"][i])
        assert found[-1]["_final_obs"].any() == ("final_obs" in expected[-1])


def test_finished_environments_wait_for_their_reset_when_disabled():
    native, device = pair(SFFRFlexVectorEnv, 2, AutoresetMode.DISABLED, max_episode_steps=2)
    native.reset(seed=0)
    device.reset(seed=0)
    still = np.zeros(native.action_space.shape)
    for _ in range(2):
        assert_same(native.step(still), device.step(still))
    with pytest.raises(gym.error.ResetNeeded, match="done"):
        device.step(still)
    mask = np.array([True, False])
    assert_same(native.reset(options={"reset_mask": mask}), device.reset(options={"reset_mask": mask}))
    with pytest.raises(gym.error.ResetNeeded, match="done"):
        device.step(still)


def test_arrays_are_taken_without_a_copy():
    torch = pytest.importorskip("torch")
    _, device = pair(SFFRFlexVectorEnv, 2)
    obs, _ = device.reset(seed=0)
    shared = torch.from_dlpack(obs)
    before = shared.clone()
    device.step(torch.ones(device.action_space.shape))
    assert shared.shape == (2, 52)
    assert not torch.equal(shared, before), "the tensor is the environments' own array"


def test_wrong_calls_are_refused():
    _, device = pair(SFFRFlexVectorEnv, 2)
    with pytest.raises(gym.error.ResetNeeded, match="reset"):
        device.step(np.zeros((2, 15)))
    device.reset()
    with pytest.raises(ValueError, match=r"actions must be real numbers of the shape \(2, 15\)"):
        device.step(np.zeros((2, 14)))
    with pytest.raises(ValueError, match="reset_mask"):
        device.reset(options={"reset_mask": np.ones(3, dtype=bool)})
    with pytest.raises(ValueError, match="draws plants"):
        device.reset(options={"scenario": "payload"})
    with pytest.raises(ValueError, match="num_envs"):
        DeviceVectorEnv(SFFRFlexVectorEnv(1), 0, AutoresetMode.NEXT_STEP, Processor())


@pytest.mark.parametrize("env_id", ["SFFRFlex-v0", "SFFRFlexDamping-v0"])
def test_backends_by_name(env_id):
    assert gym.make_vec(env_id, num_envs=2, backend="cpu").unwrapped.num_envs == 2
    with pytest.raises(ValueError, match="backend = 'tpu': must be one of cpu, cuda"):
        gym.make_vec(env_id, num_envs=2, backend="tpu")
    with pytest.raises(ValueError, match="draws no pictures"):
        gym.make_vec(env_id, num_envs=2, backend="cuda", render_mode="rgb_array")


def has_gpu():
    try:
        import cupy

        return cupy.cuda.runtime.getDeviceCount() > 0
    except Exception:
        return False


@pytest.mark.skipif(has_gpu(), reason="has a GPU")
def test_who_has_no_gpu_is_told_so():
    with pytest.raises(ConfigError, match="backend 'cuda': no"):
        gym.make_vec("SFFRFlex-v0", num_envs=2, backend="cuda")


@pytest.mark.skipif(not has_gpu(), reason="needs a GPU")
@pytest.mark.parametrize("scenario", SAME_ROBOT)
def test_a_gpu_agrees_with_the_processor(scenario):
    native = SFFRFlexVectorEnv(64, scenario=scenario)
    device: Any = gym.make_vec("SFFRFlex-v0", num_envs=64, backend="cuda", scenario=scenario)
    native.reset(seed=1)
    device.reset(seed=1)
    for action in actions(native.action_space, 500):
        expected, found = native.step(0.5 * action), device.step(0.5 * action)
        np.testing.assert_allclose(found[0].get(), expected[0], rtol=0, atol=1.0e-13)
        np.testing.assert_array_equal(found[2].get(), expected[2])


@pytest.mark.parametrize("policy", ["ahsc", pytest.param("ppo", marks=pytest.mark.slow)])
def test_a_law_acts_as_on_the_processor(policy):
    native, device = pair(SFFRFlexVectorEnv, 2, scenario="excited")
    obs, _ = native.reset(seed=1)
    device.reset(seed=1)
    on_processor = make_policy(policy, native)
    law = DeviceLaw(on_processor.law, device)
    for _ in range(120):  # more than two decisions of a schedule
        expected = on_processor(obs)
        found = law()
        np.testing.assert_array_equal(found, expected)
        obs = native.step(expected)[0]
        device.step(found)


def test_measures_are_those_of_the_processor():
    scenario, seeds = load_scenario("noise").with_changes(duration=1.0), [1_000_000, 1_000_001]
    host = SFFRFlexVectorEnv(1, scenario=scenario)
    envs = DeviceVectorEnv(host, len(seeds), AutoresetMode.DISABLED, Processor())
    policy, single = make_policy("ahsc", host), SFFRFlexEnv(scenario=scenario)
    for seed, found in zip(seeds, run_on_device(envs, policy, seeds), strict=True):
        expected = result_of(rollout(single, policy, seed))
        assert (found.scenario, found.policy, found.seed, found.failure) == ("noise", "ahsc", seed, expected.failure)
        assert found.drawn == expected.drawn
        assert found.measures == pytest.approx(expected.measures, rel=1.0e-12)


@pytest.mark.slow
def test_measures_of_episodes_that_fail_are_those_of_the_processor():
    scenario = load_scenario("excited").with_changes(duration=1.0)
    host = SFFRFlexVectorEnv(1, scenario=scenario, overrides=["limits.tip=0.02"])
    envs = DeviceVectorEnv(host, 1, AutoresetMode.DISABLED, Processor())
    policy, single = make_policy("hsc", host), SFFRFlexEnv(scenario=scenario, overrides=["limits.tip=0.02"])
    (found,), expected = run_on_device(envs, policy, [1_000_000]), result_of(rollout(single, policy, 1_000_000))
    assert found.failure == expected.failure != ""
    assert found.measures == pytest.approx(expected.measures, rel=1.0e-12)
