"""The ``kernel`` decorator: what it compiles, where it caches, and the rule that keeps memory safe."""

import importlib
import pkgutil
from pathlib import Path

import gymnasium
import numba
import numpy as np
import pytest
from numba.core import types

import baselines
import sffr_gym
from baselines import make_policy
from baselines.rollout import rollout
from sffr_gym import _jit


def kernels():
    """Every compiled function of the two packages, by name."""
    found = {}
    for package in (sffr_gym, baselines):
        for module in pkgutil.iter_modules(package.__path__, package.__name__ + "."):
            for name, value in vars(importlib.import_module(module.name)).items():
                if isinstance(value, numba.core.dispatcher.Dispatcher):
                    found[f"{value.py_func.__module__}.{name}"] = value
    return found


def holds_array(kind):
    """Say whether a numba type is an array or contains one."""
    if isinstance(kind, types.BaseTuple):
        return any(holds_array(member) for member in kind.types)
    return isinstance(kind, types.Array)


def test_only_kernels_with_reference_counting_return_arrays():
    env = gymnasium.make("SFFRFlex-v0").unwrapped
    env.reset(seed=0)
    env.step(np.zeros(env.action_space.shape))
    rollout(env, make_policy("ahsc", env), seed=0)
    checked = 0
    for name, dispatcher in kernels().items():
        for signature in dispatcher.nopython_signatures:
            checked += 1
            if holds_array(signature.return_type):
                assert dispatcher.targetoptions["_nrt"], f"{name} returns an array: mark it @kernel(allocates=True)"
    assert checked > 10


def test_kernels_see_nan_and_divide_as_numpy():
    @_jit.kernel
    def ratio(a, b):
        return a / b

    assert ratio(1.0, 0.0) == np.inf
    assert np.isnan(ratio(0.0, 0.0))


def test_cache_folder_follows_the_sources(tmp_path, monkeypatch):
    monkeypatch.setattr(_jit, "_USER_CHOSE_CACHE", False)
    monkeypatch.setattr(_jit, "_sources", [])
    monkeypatch.setattr(numba.config, "CACHE_DIR", numba.config.CACHE_DIR)
    source = tmp_path / "law.py"
    source.write_text("from sffr_gym._jit import kernel\nGAIN = 1.0\n")
    first = _jit.cache_sources(tmp_path)
    monkeypatch.setattr(_jit, "_sources", [])
    source.write_text("from sffr_gym._jit import kernel\nGAIN = 2.0\n")
    assert _jit.cache_sources(tmp_path) != first


def test_a_user_s_cache_folder_is_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(_jit, "_USER_CHOSE_CACHE", True)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    assert _jit.cache_sources(Path(_jit.__file__).parent) == tmp_path


@pytest.mark.parametrize("size", [0, 1, 5])
def test_assign_copies(size):
    source, target = np.arange(float(size)), np.full(size, np.nan)
    _jit.assign(target, source)
    assert (target == source).all()
