"""The cache of compiled code in processes of their own: where it lies, and what several of them make of it."""

import json
import os
import subprocess
import sys

import pytest
import small_package


@pytest.fixture
def package(tmp_path):
    return small_package.write(tmp_path)


def run(package, code, **variables):
    """Start a process with the package and an environment of its own."""
    environment = {key: value for key, value in os.environ.items() if key not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    return subprocess.Popen(
        [sys.executable, "-c", code], env=environment | {"PYTHONPATH": str(package)} | variables, cwd=package,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def test_an_edit_is_seen_in_the_users_numba_cache(package):
    code = "from law.loop import loop; print(loop(1.0), loop.stats.cache_path)"
    found = []
    for factor in "25":
        (package / "law" / "gain.py").write_text(small_package.FILES["gain.py"].replace("2 * x", f"{factor} * x"))
        output, errors = run(package, code, NUMBA_CACHE_DIR="numba").communicate(timeout=100)
        assert errors == ""
        found.append(output.split())
    assert [value for value, _ in found] == ["3.0", "6.0"]
    assert all(place.startswith(str(package / "numba" / "sffr-gym")) for _, place in found)


def test_processes_that_start_at_once_share_a_cache(package):
    """Each compiles other signatures first, so that none finds what another one has in mind."""
    code = """
import json, sys
from law.loop import loop
loop({}), loop({})
print(json.dumps([loop(1), loop(1.0), loop(1j).imag, sum(loop.stats.cache_misses.values())]))
"""
    orders = [("1", "1.0"), ("1.0", "1j"), ("1j", "1")]
    running = [run(package, code.format(*order), XDG_CACHE_HOME=str(package)) for order in orders]
    outputs = [process.communicate(timeout=300) for process in running]
    assert [errors for _, errors in outputs] == [""] * 3
    assert all(json.loads(output)[:3] == [3, 3.0, 2.0] for output, _ in outputs)
    output, _ = run(package, code.format("1j", "1"), XDG_CACHE_HOME=str(package)).communicate(timeout=100)
    assert json.loads(output) == [3, 3.0, 2.0, 0], "the next one compiles nothing"


NOBODY = """
import os, pwd
def nobody(uid):
    raise KeyError(f"getpwuid(): uid not found: {uid}")
pwd.getpwuid = nobody
os.environ.pop("HOME", None)
"""
READ_ONLY = """
import os
def refuse(path, *arguments, **named):
    raise OSError(30, "Read-only file system", str(path))
os.utime = os.mkdir = refuse
"""


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="users without a home")
@pytest.mark.parametrize(
    ("before", "variables", "lines"),
    [
        (NOBODY, {}, 0),
        (NOBODY, {"XDG_CACHE_HOME": "{package}/cache"}, 0),
        (READ_ONLY, {}, 1),
        ("", {"XDG_CACHE_HOME": "{package}/law/__init__.py"}, 1),
        ("import warnings; warnings.simplefilter('error')", {"NUMBA_CACHE_DIR": "/proc/nowhere"}, 1),
    ],
    ids=["no home", "no home, a place", "read-only", "a file", "no such place"],
)
def test_importing_never_fails_for_the_cache(package, before, variables, lines):
    """At most one line tells what is not kept where."""
    variables = {name: value.format(package=package) for name, value in variables.items()}
    (package / "tmp").mkdir()
    process = run(
        package, f"{before}\nfrom law.loop import loop\nprint(loop(1.0))",
        **{"HOME": str(package / "home"), "TMPDIR": str(package / "tmp")} | variables,
    )  # fmt: skip
    output, errors = process.communicate(timeout=100)
    assert output == "3.0\n", errors
    assert len(errors.splitlines()) == lines, errors
