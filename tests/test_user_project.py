"""A user's own project: packages of common names beside a script neither break the library nor are hidden by it."""

import subprocess
import sys

import pytest
from packaging.requirements import Requirement

from sffr_gym.compile import library
from sffr_workbench.common import installation

FOLDERS = ["agents", "baselines", "configs", "docs", "tests", "verification", "workbench"]
PACKAGES = {  # kinds of a user's packages: their files
    "raises": {"__init__.py": "raise RuntimeError(f'{__name__} is not what was asked for')"},
    "holds other names": {"__init__.py": "", "stepping.py": "OWNER = 'user'"},
    "has no __init__": {"stepping.py": "OWNER = 'user'"},
}
ENVIRONMENTS = """
import gymnasium as gym

for name in ("sffr_gym:SFFRFlex-v0", "sffr_gym:SFFRFlexDamping-v0"):
    print(gym.make(name).reset(seed=0)[0].shape)
"""
COMMAND_LINE = """
import importlib.metadata, sys

(command,) = importlib.metadata.entry_points(group="console_scripts", name="sffr")
for arguments in ["--version"], ["evaluate", "--help"]:
    sys.argv[1:] = arguments
    try:
        command.load()()
    except SystemExit as end:
        print(*arguments, "ends with", end.code or 0)
"""
OWN_MODULES = f"""
import importlib

print({{importlib.import_module(f"{{folder}}.stepping").OWNER for folder in {FOLDERS}}})
"""


def run(*arguments, cwd):
    return subprocess.run([sys.executable, *arguments], cwd=cwd, capture_output=True, text=True)


@pytest.fixture(params=PACKAGES)
def project(tmp_path, request):
    """A folder with packages of common names, and a script that runs the environments."""
    for folder in FOLDERS:
        (tmp_path / folder).mkdir()
        for name, text in PACKAGES[request.param].items():
            (tmp_path / folder / name).write_text(text, encoding="utf-8")
    (tmp_path / "script.py").write_text(ENVIRONMENTS, encoding="utf-8")
    return tmp_path


def test_packages_of_common_names_do_no_harm(project):
    made = run("script.py", cwd=project)
    assert (made.stdout.split("\n")[:2], made.stderr) == (["(52,)", "(36,)"], "")
    shown = run("-c", COMMAND_LINE, cwd=project)
    assert shown.returncode == 0, shown.stderr
    for words in ("sffr-gym ", "--version ends with 0", "POLICY", "evaluate --help ends with 0"):
        assert words in shown.stdout


@pytest.mark.parametrize("project", ["holds other names", "has no __init__"], indirect=True)
def test_a_users_modules_come_first(project):
    """The repository's folders are namespace packages behind those of the user where its root is on the path."""
    found = run("-c", f"import sffr_gym, sffr_workbench\n{OWN_MODULES}", cwd=project)
    assert (found.stdout, found.stderr) == ("{'user'}\n", "")


def test_files_of_the_working_directory_are_no_modules_of_our_own_processes(tmp_path, monkeypatch):
    """Those that compile, and those in which ``sffr doctor`` looks at an extra."""
    for name in ("json", "numpy"):
        (tmp_path / f"{name}.py").write_text("raise RuntimeError('of the user')\n")
    monkeypatch.chdir(tmp_path)
    asked = []
    monkeypatch.setattr(library.subprocess, "run", lambda command, **options: asked.append((command, options)))
    library.build_library("compiling")
    monkeypatch.undo()
    ((command, options),) = asked
    flags = command[: command.index("-m")]
    module = command[command.index("-m") + 1]
    subprocess.run([*flags, "-c", f"import {module}"], cwd=tmp_path, check=True, env=options["env"])
    monkeypatch.chdir(tmp_path)
    assert "broken" not in installation._extra("plot", [Requirement("numpy>=1")]).state
