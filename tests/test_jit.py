"""The ``kernel`` decorator: what it compiles, where it caches, and the rule that keeps memory safe."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher
from project import PACKAGES, ROOT

from sffr_baselines import make_policy
from sffr_baselines.damping_env import SFFRFlexDampingEnv
from sffr_baselines.rollout import rollout
from sffr_gym.compile import cache, folders, jit
from sffr_gym.compile.linalg import assign
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.simulator import Simulator


def holds_array(kind):
    if isinstance(kind, numba.types.BaseTuple):
        return any(holds_array(member) for member in kind.types)
    return isinstance(kind, numba.types.Array)


def test_kernels_hand_no_arrays_to_python():
    """They count no references: Python would free memory that no kernel took hold of."""
    for make in (SFFRFlexEnv, SFFRFlexDampingEnv):
        env = make()
        env.reset(seed=0)
        env.step(np.zeros(env.action_space.shape))
    env = SFFRFlexEnv()
    env.reset(options={"scenario": env.scenario.model_copy(update={"duration": 0.01})})
    rollout(env, make_policy("ahsc", env), seed=0)
    Simulator().grasp_forces(Simulator().initial_state())
    called = {}
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] in PACKAGES:
            for value in vars(module).values():
                if isinstance(value, Dispatcher):
                    assert value.targetoptions["_nrt"] is False, value
                    called |= {value.__name__: [each.return_type for each in value.nopython_signatures]}
    entered = {name for name, kinds in called.items() if kinds}
    assert {"step_range", "damping_range", "observe_one", "run", "accelerations"} <= entered
    assert [name for name, kinds in called.items() if any(map(holds_array, kinds))] == []


def test_kernels_see_nan_and_divide_as_numpy():
    @jit.kernel
    def ratio(a, b):
        return a / b

    assert ratio(1.0, 0.0) == np.inf
    assert np.isnan(ratio(0.0, 0.0))


def test_cache_folder_follows_every_source_and_the_settings(tmp_path, monkeypatch):
    """Whatever words a file contains, and wherever the user put the cache."""
    monkeypatch.setattr(cache, "_folders", {})
    monkeypatch.setattr(folders, "ROOTS", [tmp_path])
    source = tmp_path / "law.py"

    def folder(text):
        monkeypatch.setattr(cache, "_sources", [])
        source.write_text(text)
        return cache.cache_sources("law", [source])

    first = folder("GAIN = 1.0\n")
    assert cache._folders == {"law": first}
    assert folder("GAIN = 1.0\n") == first
    assert folder("GAIN = 2.0\n") != first
    monkeypatch.setattr(numba.config, "BOUNDSCHECK", 1 - bool(numba.config.BOUNDSCHECK))
    assert folder("GAIN = 1.0\n") != first


def test_layers_are_those_that_import_linter_checks():
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    (layers,) = [contract["layers"] for contract in contracts if contract.get("containers") == ["sffr_gym"]]
    assert list(cache.LAYERS) == layers[::-1]


def test_import_order_does_not_matter():
    """A kernel is cached in the same place whichever package is imported first; others' kernels are left alone."""
    code = "import {}, numba, sffr_gym.envs.batch as b; print(b.step_range._cache.cache_path, numba.config.CACHE_DIR)"
    places = {
        subprocess.run([sys.executable, "-c", code.format(first)], capture_output=True, text=True, check=True).stdout
        for first in ("sffr_gym", "sffr_baselines")
    }
    assert len(places) == 1


def own_cache(code, cache, name="XDG_CACHE_HOME"):
    """What a fresh interpreter prints whose compiled code lies under ``cache``."""
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment | {name: str(cache)}, capture_output=True, text=True, check=True
    )
    return done.stdout.split()


@pytest.mark.parametrize("name", ["XDG_CACHE_HOME", "NUMBA_CACHE_DIR"])
def test_compiled_code_lies_in_a_folder_of_ours(name, tmp_path):
    """Named by the sources, in the user's own numba cache as well."""
    code = "import sffr_gym.envs.batch as b; print(b.step_range._cache.cache_path)"
    (place,) = own_cache(code, tmp_path, name)
    assert Path(place).is_relative_to(tmp_path / "sffr-gym")


def test_command_line_waits_for_no_kernels_but_simulator_and_controllers(tmp_path):
    """It would announce a compilation at every run if it asked for those that only ``sffr bench`` compiles."""
    code = """
import sffr_workbench.cli.app
from sffr_baselines import make_policy
from sffr_baselines.damping_env import SFFRFlexDampingEnv
from sffr_baselines.rollout import rollout
from sffr_gym.compile import cache
from sffr_gym.compile.linalg import assign
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.simulator import Simulator
print(cache.is_compiled())
for package in ("sffr_gym.envs", "sffr_baselines"):
    (cache._folders[package] / "kernel.nbi").touch()
    print(cache.is_compiled())
"""
    assert own_cache(code, tmp_path) == ["False", "False", "True"]


def test_every_file_with_kernels_is_hashed(tmp_path):
    """Else an edit there would go unnoticed, and what is compiled of it would lie outside of the cache."""
    modules = {
        path: ".".join(path.relative_to(ROOT / folder).with_suffix("").parts)
        for package, folder in PACKAGES.items()
        for path in (ROOT / folder / package).rglob("*.py")
        if "\n@kernel" in path.read_text()
    }
    assert {"sffr_gym.physics.dynamics", "sffr_baselines.mic", "sffr_workbench.speed.kernels.loops"} < {
        *modules.values()
    }
    code = f"""
import importlib, pathlib
from sffr_baselines import make_policy
from sffr_baselines.damping_env import SFFRFlexDampingEnv
from sffr_baselines.rollout import rollout
from sffr_gym.compile import cache
from sffr_gym.compile.linalg import assign
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.simulator import Simulator
for path, module in {[(str(path), module) for path, module in modules.items()]}:
    importlib.import_module(module)
    print(pathlib.Path(path).read_bytes() in cache._sources and cache.folder_of(module) is not None)
"""
    assert own_cache(code, tmp_path) == ["True"] * len(modules)


@pytest.mark.parametrize("size", [0, 1, 5])
def test_assign_copies(size):
    source, target = np.arange(float(size)), np.full(size, np.nan)
    assign(target, source)
    assert (target == source).all()
