"""What all tests share: floating-point faults raise, and windows open nowhere."""

import os

import numpy as np
import pytest

os.environ["SDL_VIDEODRIVER"] = "dummy"  # pygame's windows


@pytest.fixture(autouse=True)
def raise_on_invalid_numbers():
    """Raise where NumPy would warn or pass on inf and NaN; compiled kernels are not concerned."""
    with np.errstate(invalid="raise", divide="raise", over="raise"):
        yield
