"""Infos hold numbers alone, as tools for arrays take them, and texts if asked for."""

import gymnasium as gym
import numpy as np
import pytest
from both_ids import IDS, SINGLES, VECTORS, zeros

from sffr_gym.task.scenario import scenario_names
from sffr_gym.task.status import REASONS

EARLY = {"scenario": "excited", "overrides": ["limits.tip=0.03"]}  # ends at once, since tips swing further


@pytest.mark.parametrize("kind", SINGLES)
@pytest.mark.parametrize("scenario", scenario_names())
def test_an_info_is_of_plain_numbers_and_arrays(kind, scenario):
    """Whatever the scenario draws: by exact type, since Gymnasium makes objects of relatives of int."""
    env = kind(scenario=scenario)
    for info in (env.reset(seed=0)[1], env.step(zeros(env))[4]):
        assert {type(value) for value in info.values()} <= {int, float, np.ndarray}
        assert not any(isinstance(value, np.ndarray) and value.dtype == object for value in info.values())
        drawn = {key.removeprefix("drawn_"): value for key, value in info.items() if key.startswith("drawn_")}
        assert drawn == env.episode.drawn


@pytest.mark.parametrize("kind", VECTORS)
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_infos_of_a_batch_are_of_plain_arrays(kind, mode):
    """Those of finished episodes too."""
    env = kind(2, autoreset_mode=mode, **EARLY)
    outputs = [env.reset(seed=0)[1]] + [env.step(zeros(env))[4] for _ in range(3)]
    for infos in outputs:
        for each in (infos, infos.get("final_info", {})):
            numbers = {key: value for key, value in each.items() if not key.startswith(("final_", "_final"))}
            assert {value.dtype.kind for value in numbers.values()} <= set("fib")
    finished = outputs[1].get("final_info", outputs[1])
    assert finished["failure"].tolist() == [1, 1] and mode in ("NextStep", "SameStep")


@pytest.mark.parametrize("kind", [*SINGLES, *VECTORS])
def test_texts_are_there_if_asked_for(kind):
    """The reason in words beside its number; all else stays the same."""
    plain, told = kind(**EARLY), kind(**EARLY, texts=True)
    infos = []
    for env in (plain, told):
        env.reset(seed=0)
        infos.append(env.step(zeros(env))[4])
    text = infos[1]["failure_text"]
    assert (text if isinstance(text, str) else text[0]) == REASONS[1]
    assert set(infos[1]) - set(infos[0]) == {"failure_text"} | ({"_failure_text"} if kind in VECTORS else set())


@pytest.mark.parametrize("env_id", IDS)
@pytest.mark.parametrize("mode", ["vector_entry_point", "sync"])
def test_gymnasiums_conversion_to_torch_takes_infos(env_id, mode):
    """Of the native batch and of the loop over single environments, in a scenario that draws and one that ends."""
    torch = pytest.importorskip("torch")
    from gymnasium.wrappers.vector import NumpyToTorch

    env = NumpyToTorch(gym.make_vec(env_id, num_envs=2, vectorization_mode=mode, **EARLY))
    env.reset(seed=0)
    for _ in range(3):
        obs, reward, *_, infos = env.step(torch.zeros(env.action_space.shape))
        assert torch.is_tensor(obs) and torch.is_tensor(reward) and torch.is_tensor(infos["vibration"])
        assert torch.is_tensor(infos["failure"])
    env.close()
