"""What is shipped: the wheel's files, the metadata, the pinned versions, and how little an import loads."""

import importlib.metadata
import itertools
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
PACKAGES = ("sffr_gym", "baselines", "verification", "agents")
HEAVY = [
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


def pins():
    """Return {canonical name: version} of constraints.txt."""
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pairs = [re.fullmatch(r"([\w.-]+)==([\w.!]+)", line) for line in lines if line and not line.startswith("#")]
    return {canonicalize_name(pair[1]): pair[2] for pair in pairs}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True)
    with zipfile.ZipFile(next(folder.glob("*.whl"))) as archive:
        return set(archive.namelist())


def test_wheel_has_the_packages_and_nothing_else(wheel):
    metadata = f"sffr_gym-{PROJECT['version']}.dist-info"
    assert {name.partition("/")[0] for name in wheel} == {*PACKAGES, metadata}
    for package in PACKAGES:
        modules = {file.relative_to(ROOT).as_posix() for file in (ROOT / package).rglob("*.py")}
        assert modules
        assert modules <= wheel
    files = [file for package in PACKAGES for file in (ROOT / package).rglob("templates/*") if file.is_file()]
    templates = {file.relative_to(ROOT).as_posix() for file in files}
    assert {"verification/templates/report.html", "agents/report/templates/main.js"} <= templates <= wheel


def test_wheel_has_every_config(wheel):
    configs = {file.relative_to(ROOT).as_posix() for file in (ROOT / "configs").rglob("*") if file.is_file()}
    assert "configs/sffr.yaml" in configs
    assert {f"sffr_gym/{name}" for name in configs} == {name for name in wheel if "configs/" in name}


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


@pytest.mark.parametrize("module", [*PACKAGES, "agents.cli"])
def test_import_loads_nothing_heavy(module):
    code = f"import sys, {module}; print(*[name for name in {HEAVY} if name in sys.modules])"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    assert loaded == []
