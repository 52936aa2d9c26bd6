"""What is shipped: wheel and sdist, their types, the metadata, the pinned versions, and how little an import loads."""

import importlib
import importlib.metadata
import itertools
import json
import os
import re
import subprocess
import sys
import tomllib
import zipfile

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from project import PACKAGES, ROOT

from hatch_build import index_text

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
HEAVY = [
    "scipy.optimize",
    "sympy",
    "pinocchio",
    "mujoco",
    "exudyn",
    "jinja2",
    "torch",
    "stable_baselines3",
    "sb3_contrib",
    "matplotlib",
    "PIL",
    "pygame",
    "av",
    "optuna",
]

TYPED = """
import gymnasium as gym
import numpy as np

import sffr_gym
from sffr_baselines import Policy, make_policy

params: sffr_gym.Params = sffr_gym.load_params().with_overrides("panel.EI=25")
sim = sffr_gym.Simulator(params)
state: sffr_gym.State = sim.step(sim.initial_state(), base=(2.0, 0.0, 0.5), dt=0.002)
energy: str = sim.energy(state)  # type: ignore[assignment]
env = sffr_gym.SFFRFlexEnv(scenario="excited", params=params)
policy: Policy = make_policy("ahsc", env)
obs, info = env.reset(seed=0)
policy.reset()
action: np.ndarray = policy(obs)
obs, reward, terminated, truncated, info = env.step(action)
cost: str = reward  # type: ignore[assignment]
batch = sffr_gym.SFFRFlexVectorEnv(num_envs=2)
other = sffr_gym.SFFRFlexEnvs()  # type: ignore[attr-defined]
made: gym.Env[np.ndarray, np.ndarray] = gym.make("SFFRFlex-v0", scenario="excited")
"""  # --strict demands each of these errors: what is Any has none, and the comment would be unused

# What gymnasium and joblib can work with besides: half of what mypy would read, and no part of our types.
UNREAD = "[mypy]\n[mypy-torch.*,dask.*,distributed.*]\nfollow_imports = skip\n"


def pins(*names):
    """Return {canonical name: version} of constraints.txt and constraints-dev.txt, or of one of them."""
    files = [ROOT / name for name in names or ("constraints.txt", "constraints-dev.txt")]
    lines = [line for file in files for line in file.read_text(encoding="utf-8").splitlines()]
    pairs = [re.fullmatch(r"([\w.-]+)==([\w.!]+)", line) for line in lines if line and not line.startswith(("#", "-c"))]
    return {canonicalize_name(pair[1]): pair[2] for pair in pairs}


def build(*options, folder):
    """Build a distribution of the repository and return its wheel."""
    command = [sys.executable, "-m", "build", *options, "--no-isolation", "--outdir", str(folder), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True)
    return next(folder.glob("*.whl"))


def contents(wheel):
    """Return {name: bytes} of a wheel's files."""
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@pytest.fixture(scope="module")
def wheel_file(tmp_path_factory):
    return build("--wheel", folder=tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def wheel(wheel_file):
    return set(contents(wheel_file))


@pytest.mark.slow
def test_wheel_has_the_packages_and_nothing_else(wheel):
    metadata = f"sffr_gym-{PROJECT['version']}.dist-info"
    assert {name.partition("/")[0] for name in wheel} == {*PACKAGES, metadata}
    for package in PACKAGES:
        folder = ROOT / PACKAGES[package]
        modules = {file.relative_to(folder).as_posix() for file in (folder / package).rglob("*.py")}
        assert modules
        assert modules | {f"{package}/py.typed"} <= wheel
    workbench = ROOT / "workbench"
    templates = {file.relative_to(workbench).as_posix() for file in workbench.rglob("templates/*") if file.is_file()}
    assert (
        {"sffr_workbench/verify/templates/report.html", "sffr_workbench/report/templates/main.js"} <= templates <= wheel
    )


@pytest.mark.slow
def test_wheel_has_every_config(wheel):
    configs = {file.relative_to(ROOT).as_posix() for file in (ROOT / "configs").rglob("*") if file.is_file()}
    assert "configs/sffr.yaml" in configs
    assert {f"sffr_gym/{name}" for name in configs} == {name for name in wheel if "configs/" in name}


@pytest.mark.slow
def test_wheel_has_the_library_and_says_for_which_machines(wheel_file, wheel):
    manifest = json.loads(contents(wheel_file)["sffr_gym/compile/binaries/manifest.json"])
    assert manifest["files"] and {f"sffr_gym/compile/binaries/{name}" for name in manifest["files"].values()} == {
        name for name in wheel if name.endswith(".so")
    }
    assert re.fullmatch(rf"sffr_gym-{PROJECT['version']}-py3-none-(?!any)\w+\.whl", wheel_file.name)


@pytest.mark.slow
def test_sdist_builds_the_same_wheel(wheel_file, tmp_path):
    by_way_of_the_sdist = build(folder=tmp_path)
    assert list(tmp_path.glob("*.tar.gz"))
    assert contents(by_way_of_the_sdist) == contents(wheel_file)


@pytest.fixture(scope="module")
def mypy_cache(tmp_path_factory):
    return tmp_path_factory.mktemp("mypy")


@pytest.mark.parametrize("source", ["as installed", pytest.param("wheel", marks=pytest.mark.slow)])
def test_a_users_program_passes_strict_mypy(source, request, mypy_cache, tmp_path):
    environment = dict(os.environ)
    if source == "wheel":
        zipfile.ZipFile(request.getfixturevalue("wheel_file")).extractall(tmp_path / "site")
        environment["PYTHONPATH"] = str(tmp_path / "site")  # before what is installed
    (tmp_path / "program.py").write_text(TYPED, encoding="utf-8")
    (tmp_path / "mypy.ini").write_text(UNREAD, encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(mypy_cache), "program.py"]
    checked = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_environments_are_public_from_the_top():
    import sffr_gym

    assert {name for name in dir(sffr_gym) if not name.startswith("_")} >= {*sffr_gym.__all__}
    for name, module in ("SFFRFlexEnv", "single"), ("SFFRFlexVectorEnv", "vector"):
        assert getattr(sffr_gym, name) is getattr(importlib.import_module(f"sffr_gym.envs.{module}"), name)
    with pytest.raises(AttributeError, match="'sffr_gym' has no attribute 'SFFRFlexEnvs'"):
        _ = sffr_gym.SFFRFlexEnvs


def test_installed_metadata_is_that_of_the_project():
    assert importlib.metadata.version("sffr-gym") == PROJECT["version"]
    (command,) = importlib.metadata.entry_points(group="console_scripts", name="sffr")
    assert callable(command.load())


def test_changelog_begins_with_this_version():
    headings = re.findall(r"^## \[?(\d+\.\d+\.\d+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert headings[0] == PROJECT["version"]


def test_torch_is_pinned():
    assert pins()["torch"] == "2.13.0"


@pytest.mark.parametrize("text", sorted({*PROJECT["dependencies"], *itertools.chain(*EXTRAS.values())}))
def test_pins_are_allowed_by_the_project(text):
    requirement = Requirement(text)
    if requirement.name == PROJECT["name"]:
        assert requirement.extras <= EXTRAS.keys()
    else:
        assert requirement.specifier.contains(pins()[canonicalize_name(requirement.name)])


def test_constraints_of_users_leave_to_other_clients_what_these_hold():
    """RLlib one release of gymnasium, the RL Zoo older releases of two others; developers have them pinned."""
    users, developers = pins("constraints.txt"), pins("constraints-dev.txt")
    assert not users.keys() & {"gymnasium", "pillow", "python-dateutil", "pytest", "ruff", "sphinx"}
    assert {"gymnasium", "pillow", "python-dateutil", "pytest"} <= developers.keys()
    assert not users.keys() & developers.keys()
    assert "-c constraints.txt" in (ROOT / "constraints-dev.txt").read_text(encoding="utf-8").splitlines()
    extras = [name for name in EXTRAS if name not in ("docs", "dev", "record", "all")]
    needed = {Requirement(each).name for name in extras for each in EXTRAS[name]} - {"sffr-gym", "pillow", "gymnasium"}
    assert {canonicalize_name(name) for name in needed} <= users.keys()


def test_an_index_shows_no_dead_picture_or_link():
    """All that is left of links leads to the web or within the page; nothing else of the text is lost."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    text = index_text(readme)
    assert re.search(r"\]\(docs/", readme) and "https://gymnasium.farama.org" in text
    assert not re.search(r"\]\((?!https?:|#)", text)
    headings = re.findall(r"^#.*$|^```.*$|^\|.*\|$", readme, re.MULTILINE)
    kept = {re.sub(r"\[([^\]]*)\]\((?!https?:|#)[^)]*\)", r"\1", line) for line in headings}
    assert kept == set(re.findall(r"^#.*$|^```.*$|^\|.*\|$", text, re.MULTILINE))
    assert (
        index_text("a\n\n![b](c.png)\n\n*d, of `e`*\n\n*f* g\n\n![h](https://i/j.png)\n")
        == "a\n\n*f* g\n\n![h](https://i/j.png)\n"
    )


@pytest.mark.parametrize("module", [*PACKAGES, "sffr_workbench.cli.app"])
def test_import_loads_nothing_heavy(module):
    code = f"import sys, {module}; print(*[name for name in {HEAVY} if name in sys.modules])"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    assert loaded == []


def test_simulator_loads_without_the_environments():
    code = "import sys, sffr_gym; sffr_gym.load_params(); print('sffr_gym.envs' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=True, capture_output=True).stdout == b"False\n"
