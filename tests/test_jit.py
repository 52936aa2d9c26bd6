"""The ``kernel`` decorator: what it compiles, where it caches, and the rule that keeps memory safe."""

import os
import subprocess
import sys
import time
from pathlib import Path

import numba
import numpy as np
import pytest

from sffr_gym import _jit

PACKAGES = ("sffr_gym", "baselines", "verification", "agents")

COMPILE_AND_LIST = """
import importlib, pkgutil
import gymnasium, numba, numpy as np
from numba.core import types
import baselines, sffr_gym
from baselines import make_policy
from baselines.rollout import rollout

def holds_array(kind):
    if isinstance(kind, types.BaseTuple):
        return any(holds_array(member) for member in kind.types)
    return isinstance(kind, types.Array)

env = gymnasium.make("SFFRFlex-v0", overrides=["simulation.max_step=0.002"]).unwrapped
env.reset(seed=0)
env.step(np.zeros(env.action_space.shape))
rollout(env, make_policy("ahsc", env), seed=0)
for package in (sffr_gym, baselines):
    for module in pkgutil.iter_modules(package.__path__, package.__name__ + "."):
        for name, value in vars(importlib.import_module(module.name)).items():
            if isinstance(value, numba.core.dispatcher.Dispatcher):
                for signature in value.nopython_signatures:
                    print(name, holds_array(signature.return_type), value.targetoptions["_nrt"])
"""


@pytest.mark.slow
def test_only_kernels_with_reference_counting_return_arrays(tmp_path):
    """Else the caller would free memory that it never took hold of. An empty cache makes numba type every kernel."""
    listed = subprocess.run(
        [sys.executable, "-c", COMPILE_AND_LIST],
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}, capture_output=True, text=True, check=True,
    ).stdout.split("\n")  # fmt: skip
    rows = [line.split() for line in listed if line]
    assert len(rows) > 30
    returning = [(name, counted) for name, has_array, counted in rows if has_array == "True"]
    assert ("_reference", "True") in returning
    assert all(counted == "True" for _, counted in returning), returning


def test_kernels_see_nan_and_divide_as_numpy():
    @_jit.kernel
    def ratio(a, b):
        return a / b

    assert ratio(1.0, 0.0) == np.inf
    assert np.isnan(ratio(0.0, 0.0))


def test_cache_folder_follows_the_sources(tmp_path, monkeypatch):
    monkeypatch.setattr(_jit, "_USER_CHOSE_CACHE", False)
    monkeypatch.setattr(_jit, "_sources", [])
    monkeypatch.setattr(_jit, "_folders", {})
    source = tmp_path / "law.py"
    source.write_text("from sffr_gym._jit import kernel\nGAIN = 1.0\n")
    first = _jit.cache_sources("law", tmp_path)
    assert _jit._folders == {"law": first}
    monkeypatch.setattr(_jit, "_sources", [])
    source.write_text("from sffr_gym._jit import kernel\nGAIN = 2.0\n")
    assert _jit.cache_sources("law", tmp_path) != first


def test_a_user_s_cache_folder_is_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(_jit, "_USER_CHOSE_CACHE", True)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    assert _jit.cache_sources("sffr_gym", Path(_jit.__file__).parent) == tmp_path


def test_caches_that_nobody_used_for_a_month_go(tmp_path, monkeypatch):
    monkeypatch.setattr(_jit, "CACHE_ROOT", tmp_path)
    monkeypatch.setattr(_jit, "_folders", {"sffr_gym": tmp_path / "mine"})
    for name, days in (("mine", 60), ("recent", 5), ("old", 60)):
        (tmp_path / name).mkdir()
        long_ago = time.time() - days * 24 * 3600
        os.utime(tmp_path / name, (long_ago, long_ago))
    _jit.remove_stale_caches()
    assert {folder.name for folder in tmp_path.iterdir()} == {"mine", "recent"}


def test_import_order_does_not_matter():
    """A kernel is cached in the same place whichever package is imported first; others' kernels are left alone."""
    code = "import {}, numba, sffr_gym.batch as b; print(b.step_range._cache.cache_path, numba.config.CACHE_DIR)"
    places = {
        subprocess.run([sys.executable, "-c", code.format(first)], capture_output=True, text=True, check=True).stdout
        for first in ("sffr_gym", "baselines")
    }
    assert len(places) == 1


def own_cache(code, cache):
    """What a fresh interpreter prints whose compiled code lies under ``cache``."""
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    environment["XDG_CACHE_HOME"] = str(cache)
    return subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    ).stdout.split()


def test_command_line_waits_for_no_kernels_but_simulator_and_controllers(tmp_path):
    """It would announce a compilation at every run if it asked for those that only ``sffr bench`` compiles."""
    code = """
import agents.cli
from sffr_gym import _jit
print(_jit.is_compiled())
for package in ("sffr_gym", "baselines"):
    _jit._folders[package].mkdir(parents=True, exist_ok=True)
    (_jit._folders[package] / "kernel.nbi").touch()
    print(_jit.is_compiled())
"""
    assert own_cache(code, tmp_path) == ["False", "False", "True"]


def test_every_file_with_kernels_is_hashed(tmp_path):
    """Else an edit there would go unnoticed, and what is compiled of it would lie outside of the cache."""
    root = Path(_jit.__file__).parents[1]
    files = [path for package in PACKAGES for path in (root / package).rglob("*.py") if "\n@kernel" in path.read_text()]
    modules = {path: ".".join(path.relative_to(root).with_suffix("").parts) for path in files}
    assert {"sffr_gym.integrator", "baselines.mic", "agents.bench.kernels.loops"} < set(modules.values())
    code = f"""
import importlib, pathlib
from sffr_gym import _jit
for path, module in {[(str(path), module) for path, module in modules.items()]}:
    importlib.import_module(module)
    print(pathlib.Path(path).read_bytes() in _jit._sources and module.rpartition(".")[0] in _jit._folders)
"""
    assert own_cache(code, tmp_path) == ["True"] * len(files)


@pytest.mark.parametrize("size", [0, 1, 5])
def test_assign_copies(size):
    source, target = np.arange(float(size)), np.full(size, np.nan)
    _jit.assign(target, source)
    assert (target == source).all()
