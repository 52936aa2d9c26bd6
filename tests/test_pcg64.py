"""Random numbers of the kernels are NumPy's: the same words, numbers and whole numbers from the same state."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sffr_gym.task.pcg64 import STATE, below, state_of, uniform

BOUNDS = [1, 2, 3, 24, 55_440, 2**31 + 5, 3 * 2**30, 2**32 - 1]


@given(
    st.integers(0, 2**63),
    st.lists(st.tuples(st.sampled_from(["uniform", "below"]), st.integers(0, len(BOUNDS) - 1)), max_size=40),
)
def test_numbers_are_those_of_numpy(seed, asked):
    """In any order: whole numbers take half a word, and leave the other half for the next one."""
    rng = np.random.default_rng(seed)
    state = state_of(rng)
    for kind, which in asked:
        if kind == "uniform":
            assert uniform(state, -1.5, 2.25) == rng.uniform(-1.5, 2.25)
        else:
            assert below(state, BOUNDS[which]) == rng.integers(BOUNDS[which])
    np.testing.assert_array_equal(state, state_of(rng))


@pytest.mark.filterwarnings("error")  # NumPy tells of an overflow
@pytest.mark.parametrize("bound", [3 * 2**30, 2**31 + 5])
def test_bounds_that_refuse_many_numbers(bound):
    """A third of the words is drawn again, so that no number comes more often than others."""
    rng = np.random.default_rng(5)
    state = state_of(rng)
    found = [below(state, bound) for _ in range(500)]
    assert found == rng.integers(bound, size=500).tolist()
    assert max(found) > 0.99 * bound


def test_a_state_is_words_of_32_bits():
    state = state_of(np.random.default_rng(1))
    assert state.shape == (STATE,) and state.dtype == np.int64
    assert state.min() >= 0 and state.max() < 2**32
