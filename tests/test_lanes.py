"""Numbers in lanes: each lane computes what a plain number computes, bit for bit."""

import numpy as np
import pytest
from small_kernels import N_RESULTS, call, compute_rows, find, operands, swap

from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv
from sffr_gym.compile import lanes
from sffr_gym.compile.lanes import WIDTH
from sffr_gym.compile.library import own_levels
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv

SPECIAL = (0.0, -0.0, 1.0, -1.5, 1e300, -1e-300, 5e-324, np.inf, -np.inf, np.nan)


@pytest.fixture(scope="module", params=own_levels())
def library(request, small_libraries):
    """The library for a level of this machine."""
    return small_libraries[request.param]


@pytest.fixture(scope="module")
def pairs():
    """All pairs of special numbers, and random ones of all sizes; a multiple of the width."""
    rng = np.random.default_rng(0)
    special = [(a, b) for a in SPECIAL for b in SPECIAL]
    numbers = rng.normal(size=(900, 2)) * 10.0 ** rng.uniform(-8, 8, (900, 2))
    both = np.concatenate([special, numbers])
    return both[: len(both) // WIDTH * WIDTH]


def assert_same_bits(left, right):
    assert (np.isnan(left) == np.isnan(right)).all()
    there = ~np.isnan(left)
    np.testing.assert_array_equal(left[there].view(np.int64), right[there].view(np.int64))
    assert np.ptp(left[there]) > 0.0


def test_each_lane_has_the_bits_of_a_plain_number(library, pairs):
    """Arithmetic, comparisons, choice and functions, with zeros of both signs, infinities and what is not a number."""
    rows, others = pairs[:, :1].copy(), pairs[:, 1:].copy()
    plain, wide = np.zeros((len(rows), N_RESULTS)), np.zeros((len(rows), N_RESULTS))
    call(library, compute_rows, rows, others, plain, operands(False))
    call(library, compute_rows, rows, others, wide, operands(True))
    assert_same_bits(plain, wide)


def test_python_gives_the_bits_of_compiled_code(library):
    """For ordinary numbers; Python's own functions raise where compiled ones give an infinity."""
    rows, others = np.abs(np.random.default_rng(1).normal(size=(2, 40, 1)))
    compiled, python = np.zeros((40, N_RESULTS)), np.zeros((40, N_RESULTS))
    call(library, compute_rows, rows, others, compiled, operands(False))
    compute_rows.function(rows, others, python, operands(False))
    assert_same_bits(compiled, python)


def test_any_lane_sees_each_lane(library):
    """A condition that holds in one lane alone is seen, whichever it is, and one that holds in none is not."""
    rows = np.zeros((WIDTH * (WIDTH + 1), 1))
    for lane in range(WIDTH):
        rows[lane * WIDTH + lane] = 2.0
    found = np.full(WIDTH + 1, np.nan)
    call(library, find, rows, 1.0, found, operands(True))
    assert list(found) == [1.0] * WIDTH + [0.0]


@pytest.mark.parametrize("lane", [0, WIDTH - 1])
def test_rows_go_into_lanes_and_come_back(library, lane):
    rows = np.random.default_rng(0).normal(size=(WIDTH, N_RESULTS))
    work, row = operands(True), np.array([np.zeros(N_RESULTS), np.arange(N_RESULTS)])
    call(library, swap, rows, lane, work, row)
    assert (row[0] == rows[lane]).all()
    inside = np.asarray(work.out).T
    assert (inside[lane] == np.arange(N_RESULTS)).all()
    others = np.arange(WIDTH) != lane
    assert (inside[others] == rows[others]).all()


@pytest.mark.parametrize(
    ("condition", "a", "b", "chosen"), [(True, 1.0, 2.0, 1.0), (False, 1.0, 2.0, 2.0), (np.True_, 1.0, np.nan, 1.0)]
)
def test_python_chooses_one_number(condition, a, b, chosen):
    assert lanes.where(condition, a, b) == chosen
    assert lanes.any_lane(condition) is bool(condition)


@pytest.mark.parametrize(
    ("many", "one"), [(SFFRFlexVectorEnv, SFFRFlexEnv), (SFFRFlexDampingVectorEnv, SFFRFlexDampingEnv)]
)
@pytest.mark.parametrize("robot", [[], ["simulation.coupling=staggered", "simulation.max_step=1e-4"]])
def test_environments_in_lanes_are_each_of_them_alone(many, one, robot):
    """Noise, delays and impulses differ between the lanes, and so does the time of a failure."""
    scenario = "excited" if one is SFFRFlexDampingEnv else "noise"
    together = many(WIDTH, scenario=scenario, overrides=robot)
    inputs = np.random.default_rng(0).uniform(-0.3, 0.3, (6, *together.action_space.shape))
    first = together.reset(seed=5)[0]
    found = [together.step(each)[:2] for each in inputs]
    for i in (0, 3, WIDTH - 1):
        alone = one(scenario=scenario, overrides=robot)
        np.testing.assert_array_equal(alone.reset(seed=5 + i)[0], first[i])
        for (obs, reward), each in zip(found, inputs, strict=True):
            expected = alone.step(each[i])
            np.testing.assert_array_equal(obs[i], expected[0])
            assert reward[i] == expected[1]
