"""What all tests share: floating-point faults raise, and worker processes find the kernels compiled."""

import subprocess
import sys

import numba
import numpy as np
import pytest

from sffr_gym._jit import is_compiled

WARM_UP = """
import gymnasium
import numpy as np
from baselines import make_policy
from baselines.rollout import rollout
env = gymnasium.make("sffr_gym:SFFRFlex-v0").unwrapped
policy = make_policy("ahsc", env)
obs, _ = env.reset(seed=0)
env.step(policy(obs))
rollout(env, policy, seed=0)
"""


def pytest_configure(config):
    """Compile the kernels before there are several workers, each of which would compile the same ones."""
    several = getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput")
    if several and not numba.config.DISABLE_JIT and not is_compiled():
        print("Compiling the kernels, once for these sources: about a minute ...", flush=True)
        subprocess.run([sys.executable, "-c", WARM_UP], check=False)  # a fault in them is for the tests to report


@pytest.fixture(autouse=True)
def raise_on_invalid_numbers():
    """Raise where NumPy would warn or pass on inf and NaN; compiled kernels are not concerned."""
    with np.errstate(invalid="raise", divide="raise", over="raise"):
        yield
