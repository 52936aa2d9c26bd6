"""Steps of a single environment, and what every output of them must be."""

import numpy as np

N_ACTIONS = 15


def actions(count, seed=0, size=0.3):
    """Random actions that the robot survives for a while."""
    return size * np.random.default_rng(seed).uniform(-1.0, 1.0, (count, N_ACTIONS))


def actions_of(env, count, seed=0, size=0.3):
    """The same for any environment, single or vector, whatever its actuators are."""
    return size * np.random.default_rng(seed).uniform(-1.0, 1.0, (count, *env.action_space.shape))


def rollout(env, inputs):
    """Return the outputs of consecutive steps."""
    return [env.step(action) for action in inputs]


def assert_same(left, right):
    """Nested outputs are equal to the last bit, types included."""
    assert type(left) is type(right)
    if isinstance(left, dict):
        assert list(left) == list(right)
        left, right = list(left.values()), list(right.values())
    if isinstance(left, list | tuple):
        assert len(left) == len(right)
        for one, other in zip(left, right, strict=True):
            assert_same(one, other)
    elif isinstance(left, np.ndarray):
        np.testing.assert_array_equal(left, right, strict=True)
    else:
        assert left == right


def assert_healthy(env, outputs):
    """Check that every number of the outputs is finite and every observation lies in the space."""
    for obs, reward, _, _, info in outputs:
        floats = [value for value in info.values() if isinstance(value, float)]
        assert np.isfinite(np.concatenate([obs, [reward], floats, info["applied"]])).all()
        assert env.observation_space.contains(obs)
