"""Memory of kernels: described arrays over a block, the same for kernels and for Python."""

from typing import NamedTuple

import numpy as np
import pytest

from sffr_baselines.damping_env import SFFRFlexDampingVectorEnv
from sffr_baselines.policies import make_policy
from sffr_baselines.rollout import rollout
from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.lanes import ALIGNMENT, WIDTH, columns
from sffr_gym.compile.workspace import Constant, Integers, Interleaved, allocate, new_workspace, structure, workspace
from sffr_gym.config.params import load_params
from sffr_gym.envs.batch import group_shapes
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.task.task_model import make_task_model
from sffr_gym.types import Array


class Inner(NamedTuple):
    matrix: Array
    vector: Array


class Outer(NamedTuple):
    first: Array
    inner: Inner
    last: Array


def outer_shapes(n):
    return Outer(first=(n,), inner=Inner(matrix=(2, n), vector=(n + 1,)), last=(1,))


@kernel
def fill(block, n):
    """Write the place of each number into it."""
    work = workspace(block, outer_shapes(n))
    for lane in range(columns(work.last).shape[1]):
        for k in range(n):
            columns(work.first)[k, lane] = k
        for i in range(2):
            for k in range(n):
                columns(work.inner.matrix[i])[k, lane] = n * (1 + i) + k
        for k in range(n + 1):
            columns(work.inner.vector)[k, lane] = 3 * n + k
        columns(work.last)[0, lane] = 4 * n + 1


def leaves(value):
    return [leaf for field in value for leaf in leaves(field)] if isinstance(value, tuple) else [value]


@pytest.mark.parametrize("n", [0, 1, 5])
def test_arrays_lie_one_after_another_without_gap_or_overlap(n):
    block = allocate(outer_shapes(n))[0]
    fill(block, n)
    assert block[: 4 * n + 2].tolist() == list(range(4 * n + 2))
    assert np.concatenate([np.ravel(leaf) for leaf in leaves(workspace(block, outer_shapes(n)))]).tolist() == list(
        range(4 * n + 2)
    )


@pytest.mark.parametrize("n", [1, 5])
def test_lanes_have_the_same_places(n):
    block = allocate(outer_shapes(n), lanes=True)[0]
    fill(block, n)
    assert (block[: 4 * n + 2] == np.arange(4 * n + 2)[:, None]).all()


@pytest.mark.parametrize("lanes", [False, True])
def test_blocks_are_aligned_and_large_enough(lanes):
    task = make_task_model(load_params())
    blocks = allocate(group_shapes(task), 3, lanes=lanes)
    size = sum(leaf.size for leaf in leaves(new_workspace(group_shapes(task))))
    assert blocks.shape[0] == 3 and blocks.shape[1] >= size and blocks.shape[2:] == ((WIDTH,) if lanes else ())
    assert all(block.ctypes.data % ALIGNMENT == 0 for block in blocks)


def interleaved_shapes(n):
    return Inner(matrix=(2, 2), vector=Interleaved(Outer(first=(n,), inner=Inner((n,), (n,)), last=(n,))))


@kernel
def fill_interleaved(block, n):
    """Write the place of each number into it."""
    fields = workspace(block, interleaved_shapes(n)).vector
    for k in range(n):
        fields.first[k], fields.inner.matrix[k] = 4 + 4 * k, 5 + 4 * k
        fields.inner.vector[k], fields.last[k] = 6 + 4 * k, 7 + 4 * k


@pytest.mark.parametrize("lanes", [False, True])
def test_interleaved_arrays_lie_entry_by_entry(lanes):
    block = allocate(interleaved_shapes(3), lanes=lanes)[0]
    fill_interleaved(block, 3)
    places = np.arange(4.0, 16.0)
    assert (block[4:16] == (places[:, None] if lanes else places)).all()
    if not lanes:
        fields = workspace(block, interleaved_shapes(3)).vector
        assert fields.inner.vector.tolist() == [6.0, 10.0, 14.0] and fields.last.tolist() == [7.0, 11.0, 15.0]


class Row(NamedTuple):
    number: float
    whole: int
    vector: Array
    wholes: Array
    flag: tuple


def row_shapes():
    return Row(number=(), whole=Integers(()), vector=(2,), wholes=Integers((3,)), flag=Constant((True,)))


@kernel
def add_up(numbers, integers):
    row = structure(numbers, integers, row_shapes())
    total = row.number + row.whole + row.vector[0] + 10 * row.vector[1]
    for k in range(len(row.wholes)):
        total += 100 * (k + 1) * row.wholes[k]
    return total + (0.5 if len(row.flag) > 0 else 0.0)


def test_rows_hold_numbers_and_whole_numbers():
    numbers, integers = np.array([0.25, 2.0, 3.0]), np.array([7, 1, 0, 2])
    row = structure(numbers, integers, row_shapes())
    assert (row.number, row.whole, row.vector.tolist(), row.wholes.tolist(), row.flag) == (
        0.25, 7, [2.0, 3.0], [1, 0, 2], (True,),
    )  # fmt: skip
    assert add_up(numbers, integers) == add_up.py_func(numbers, integers) == 0.25 + 7 + 2 + 30 + 100 + 600 + 0.5


@pytest.mark.parametrize("make", [SFFRFlexVectorEnv, SFFRFlexDampingVectorEnv])
def test_kernels_read_nothing_that_they_have_not_written(make):
    """What a block held before does not matter: filled with NaN before each step, it gives the same bits."""
    clean, poisoned = make(WIDTH + 3, scenario="noise"), make(WIDTH + 3, scenario="noise")
    rng = np.random.default_rng(0)
    for env in (clean, poisoned):
        env.reset(seed=0)
    for _ in range(5):
        actions = rng.uniform(-0.2, 0.2, clean.action_space.shape)
        for block in poisoned._memory:
            block[:] = np.nan
        for left, right in zip(clean.step(actions)[:2], poisoned.step(actions)[:2], strict=True):
            np.testing.assert_array_equal(left, right)


@pytest.mark.parametrize("policy", ["lqr", "sac"])
def test_the_closed_loop_reads_nothing_that_it_has_not_written(policy, monkeypatch):
    env = SFFRFlexEnv(scenario="excited")
    env.reset(options={"scenario": env.scenario.model_copy(update={"duration": 0.4})})
    clean = rollout(env, make_policy(policy, env), seed=0)
    monkeypatch.setattr("sffr_baselines.rollout.allocate", lambda shapes: np.full_like(allocate(shapes), np.nan))
    poisoned = rollout(env, make_policy(policy, env), seed=0)
    for name in ("p", "v", "signals", "B_hat", "q_flex", "lam"):
        np.testing.assert_array_equal(getattr(clean, name), getattr(poisoned, name))
