"""Memory of kernels: described arrays over a block, the same for compiled code and for Python."""

from typing import NamedTuple

import numpy as np
import pytest
from small_kernels import Inner, Outer, call, fill_links, links

from sffr_baselines.damping_env import SFFRFlexDampingVectorEnv
from sffr_baselines.policies import make_policy
from sffr_baselines.rollout import rollout
from sffr_gym.compile.lanes import ALIGNMENT, WIDTH
from sffr_gym.compile.workspace import Integers, allocate, new_workspace, structure, workspace
from sffr_gym.config.params import load_params
from sffr_gym.envs.batch import group_shapes
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.task.task_model import make_task_model
from sffr_gym.types import Array


def outer_shapes(n):
    return Outer(first=(n,), inner=Inner(matrix=(2, n), vector=(n + 1,)), last=(1,))


def leaves(value):
    return [leaf for field in value for leaf in leaves(field)] if isinstance(value, tuple) else [value]


@pytest.mark.parametrize("n", [0, 1, 5])
@pytest.mark.parametrize("lanes", [False, True])
def test_arrays_lie_one_after_another_without_gap_or_overlap(n, lanes):
    block = allocate(outer_shapes(n), lanes=lanes)[0]
    places = np.arange(4 * n + 2.0)
    block[: 4 * n + 2] = places[:, None] if lanes else places
    work = workspace(block, outer_shapes(n))
    width = [WIDTH] if lanes else []
    assert work.inner.matrix.shape == (2, n, *width) and work.last.shape == (1, *width)
    seen = [leaf[..., 0] if lanes else leaf for leaf in leaves(work)]
    assert np.concatenate([np.ravel(leaf) for leaf in seen]).tolist() == places.tolist()
    for leaf in leaves(work):
        assert np.shares_memory(leaf, block) == (leaf.size > 0)


@pytest.mark.parametrize("lanes", [False, True])
def test_blocks_are_aligned_and_large_enough(lanes):
    task = make_task_model(load_params())
    blocks = allocate(group_shapes(task), 3, lanes=lanes)
    size = sum(leaf.size for leaf in leaves(new_workspace(group_shapes(task))))
    assert blocks.shape[0] == 3 and blocks.shape[1] >= size and blocks.shape[2:] == ((WIDTH,) if lanes else ())
    assert all(block.ctypes.data % ALIGNMENT == 0 for block in blocks)


@pytest.mark.parametrize("lanes", [False, True])
@pytest.mark.parametrize("n", [1, 2, 3])
def test_interleaved_arrays_lie_entry_by_entry(small_libraries, lanes, n):
    """As compiled code sees them, whatever their length."""
    work, block = links(n, lanes)
    call(next(iter(small_libraries.values())), fill_links, work)
    places = np.arange(4.0, 4.0 + 4 * n)
    assert (block[4 : 4 + 4 * n] == (places[:, None] if lanes else places)).all()
    assert not block[:4].any() and not block[4 + 4 * n :].any()
    for k, leaf in enumerate(leaves(work.vector)):
        assert (leaf == (places[k::4, None] if lanes else places[k::4])).all()


def test_python_sees_interleaved_arrays_likewise():
    work, block = links(3)
    fill_links.function(work)
    assert block[4:16].tolist() == list(range(4, 16))


class Row(NamedTuple):
    number: float
    whole: int
    vector: Array
    wholes: Array


def test_rows_hold_numbers_and_whole_numbers():
    numbers, integers = np.array([0.25, 2.0, 3.0]), np.array([7, 1, 0, 2])
    shapes = Row(number=(), whole=Integers(()), vector=(2,), wholes=Integers((3,)))
    row = structure(numbers, integers, shapes)
    assert (row.number, row.whole, row.vector.tolist(), row.wholes.tolist()) == (0.25, 7, [2.0, 3.0], [1, 0, 2])
    assert type(row.number) is float and type(row.whole) is int
    numbers[1] = 5.0
    assert row.vector[0] == 5.0


def poison(call):
    """Fill the memory of a prepared call, which are its named tuples with ``Work`` in their name, with NaN."""
    count = 0
    for argument in call.arguments:
        if type(argument).__name__.endswith("Work"):
            for leaf in leaves(argument):
                leaf[...] = np.nan
                count += leaf.size
    return count


@pytest.mark.parametrize("make", [SFFRFlexVectorEnv, SFFRFlexDampingVectorEnv])
def test_kernels_read_nothing_that_they_have_not_written(make):
    """What a block held before does not matter: filled with NaN before each step, it gives the same bits."""
    clean, poisoned = make(WIDTH + 3, scenario="noise"), make(WIDTH + 3, scenario="noise")
    rng = np.random.default_rng(0)
    for env in (clean, poisoned):
        env.reset(seed=0)
    for _ in range(5):
        actions = rng.uniform(-0.2, 0.2, clean.action_space.shape)
        calls = [each for chunk in poisoned._stepper._in_lanes for each in chunk]
        assert len(calls) >= 2 and all(poison(each) > 1000 for each in calls)
        for left, right in zip(clean.step(actions)[:2], poisoned.step(actions)[:2], strict=True):
            np.testing.assert_array_equal(left, right)


@pytest.mark.parametrize("policy", ["lqr", "sac"])
def test_the_closed_loop_reads_nothing_that_it_has_not_written(policy, monkeypatch):
    env, made = SFFRFlexEnv(scenario="excited"), []
    env.reset(options={"scenario": env.scenario.model_copy(update={"duration": 0.4})})
    clean = rollout(env, make_policy(policy, env), seed=0)

    def poisoned_workspace(shapes):
        made.append(new_workspace(shapes))
        for leaf in leaves(made[-1]):
            leaf[...] = np.nan
        return made[-1]

    monkeypatch.setattr("sffr_baselines.rollout.new_workspace", poisoned_workspace)
    poisoned = rollout(env, make_policy(policy, env), seed=0)
    assert made
    for name in ("p", "v", "signals", "B_hat", "q_flex", "lam"):
        np.testing.assert_array_equal(getattr(clean, name), getattr(poisoned, name))
