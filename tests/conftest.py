"""What all tests share: floating-point faults raise, windows open nowhere, and users' scenarios are written here."""

import os

import numpy as np
import pytest
import yaml
from small_kernels import make_libraries

from sffr_gym.config.params import load_params
from sffr_gym.render import window

os.environ["SDL_VIDEODRIVER"] = "dummy"  # pygame's windows


class Clock:
    """A clock on which nothing takes time but sleeping and what a test adds."""

    def __init__(self):
        self.now = 100.0

    def perf_counter(self):
        return self.now

    def sleep(self, seconds):
        assert 0.0 < seconds <= window.SLICE
        self.now += seconds


@pytest.fixture
def clock(monkeypatch):
    """That of windows, which wait for simulated time without taking any."""
    clock = Clock()
    monkeypatch.setattr(window, "time", clock)
    return clock


@pytest.fixture(autouse=True)
def raise_on_invalid_numbers():
    """Raise where NumPy would warn or pass on inf and NaN; compiled kernels are not concerned."""
    with np.errstate(invalid="raise", divide="raise", over="raise"):
        yield


@pytest.fixture(scope="session")
def params():
    """The shipped case study."""
    return load_params()


@pytest.fixture(scope="session")
def small_libraries(tmp_path_factory):
    """The tests' own kernels, compiled for each level of this machine."""
    return make_libraries(tmp_path_factory.mktemp("small"))


@pytest.fixture(scope="session")
def user_scenario(tmp_path_factory):
    """A function that writes a user's scenario, each in a folder of its own, and returns its path."""

    def write(name="mine", /, **keys):
        file = tmp_path_factory.mktemp("scenario") / f"{name}.yaml"
        file.write_text(yaml.safe_dump({"name": name, "description": "a test's"} | keys), encoding="utf-8")
        return str(file)

    return write


@pytest.fixture(scope="session")
def short_swing(user_scenario):
    """One of 0.4 s that does."""
    return user_scenario("short", duration=0.4, panel_modes=[{"mode": 1, "amplitude": [0.05, 0.25]}])


@pytest.fixture(scope="session")
def swinging(user_scenario):
    """A scenario of 2 s that draws the panels' vibration."""
    return user_scenario("swinging", duration=2.0, panel_modes=[{"mode": 1, "amplitude": [0.05, 0.25]}])


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    """A folder for what is compiled, of this run alone; its workers share it, and compile everything once."""
    place = tmp_path_factory.getbasetemp()
    place = place.parent if "PYTEST_XDIST_WORKER" in os.environ else place
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SFFR_CACHE", str(place / "programs"))
        yield
