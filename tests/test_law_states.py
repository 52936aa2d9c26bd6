"""The law's part of a damping environment's state: every number that an episode can have is taken back, none beyond."""

import operator

import numpy as np
import pytest

from sffr_baselines.damping_env import SFFRFlexDampingEnv
from sffr_gym.envs.state import FAR, MOST_TICKS

ENDS = {
    "law.B_hat": (0.0, None), "law.factor": (0.0, None), "law.share": (0.0, 1.0), "law.demand": (0.0, None),
    "law.late": (0.0, 1.0), "law.age": (0.0, MOST_TICKS), "law.integral": (-FAR, FAR), "law.errors": (-FAR, FAR),
    "law.filters": (-FAR, FAR), "law.plan": (-FAR, FAR), "law.wait": (-1.0, MOST_TICKS), "end": (0, MOST_TICKS),
    "law.seen": (-5.0, 5.0),
}  # fmt: skip
COLUMN = {"law.seen": 6}  # the acceleration's rate, which may have either sign


@pytest.fixture(scope="module")
def env():
    """One whose law has numbers of all kinds."""
    env = SFFRFlexDampingEnv(law="mpc", duration=1.0)
    env.reset(seed=0)
    return env


def with_number(env, name, number):
    """The environment's state with another number in one place."""
    state = env.get_state()
    operator.attrgetter(name)(state["damping"]).flat[COLUMN.get(name, -1)] = number
    return state


@pytest.mark.parametrize("name", ENDS)
def test_numbers_at_the_ends_of_their_range_are_taken_back(env, name):
    for end in ENDS[name]:
        if end is not None:
            env.set_state(with_number(env, name, end))
            assert operator.attrgetter(name)(env.get_state()["damping"]).flat[COLUMN.get(name, -1)] == end


@pytest.mark.parametrize("name", ENDS)
def test_numbers_beyond_the_ends_of_their_range_are_refused(env, name):
    whole = operator.attrgetter(name)(env.get_state()["damping"]).dtype.kind == "i"
    for end, way in zip(ENDS[name], (-1, 1), strict=True):
        if end is not None:
            beyond = end + way if whole else np.nextafter(end, way * np.inf)
            with pytest.raises(ValueError, match=rf"state\.damping\.{name}: must lie in its range"):
                env.set_state(with_number(env, name, beyond))
