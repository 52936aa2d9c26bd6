"""`sffr doctor`: what is there is told, what is missing or broken comes with what to do."""

import re
import subprocess
import sys

import pytest
from command_line import sffr
from packaging.requirements import Requirement

from sffr_workbench.common import installation
from sffr_workbench.common.installation import Finding, core_findings, extra_findings


def by_name(findings):
    return {each.what: each for each in findings}


def test_the_command_tells_of_a_working_installation():
    """Versions, the library that is loaded, processors and the folder of results."""
    result = sffr("doctor", "--no-extras")
    assert result.exit_code == 0, result.stdout
    for text in ("sffr-gym", "numpy", "gymnasium", "kernels-x86", "SFFRFlex-v0 runs", "used of", "runs, "):
        assert text in result.stdout
    assert "all that every use needs works" in result.stdout


def test_kernels_that_run_as_python_are_told(monkeypatch):
    monkeypatch.setenv("SFFR_INTERPRETED", "1")
    found = installation._kernels()
    assert found.advice == "unset SFFR_INTERPRETED" and "some thousand times slower" in found.state


def test_a_machine_without_compiled_code_is_broken(monkeypatch):
    """The exit code tells scripts."""
    monkeypatch.setattr(installation, "load_library", lambda: None)
    found = installation._kernels()
    assert found.broken and "sffr-gym[compile]" in found.advice
    result = sffr("doctor", "--no-extras")
    assert result.exit_code == 1 and "1 broken" in result.stdout and "BAD" in result.stdout


def test_an_extra_is_told_with_what_it_lacks(monkeypatch):
    """Not installed, too old, or installed and broken: each with the command that helps."""
    missing = installation._extra("tune", [Requirement("no-such-package>=1")])
    assert (missing.state, missing.advice) == ("no-such-package is not installed", "pip install 'sffr-gym[tune]'")
    old = installation._extra("plot", [Requirement("numpy>=99")])
    assert re.fullmatch(r"numpy [\d.]+ is not >=99", old.state) and old.advice == "pip install 'sffr-gym[plot]'"
    monkeypatch.setitem(installation.MODULES, "numpy", "no_such_module")
    broken = installation._extra("plot", [Requirement("numpy>=1")])
    assert "broken: ModuleNotFoundError: No module named 'no_such_module'" in broken.state
    assert broken.advice == "pip install --force-reinstall 'sffr-gym[plot]'" and not broken.broken


@pytest.mark.slow
def test_every_extra_of_the_project_is_looked_at():
    """All but those of developers, by the installed metadata; what is installed here imports."""
    found = by_name(extra_findings())
    assert {"[agents]", "[plot]", "[render]", "[report]", "[tune]", "[verify]", "[video]"} <= found.keys()
    assert not {"[dev]", "[docs]", "[all]"} & found.keys()
    assert not found["[plot]"].advice and "matplotlib" in found["[plot]"].state
    assert not any("broken" in each.state for each in found.values())


def test_limits_on_processors_are_told(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    found = installation._processors()
    assert found.state.startswith("1 used of ") and (found.state == "1 used of 1" or "OMP_NUM_THREADS=1" in found.state)


def test_a_place_that_cannot_be_written_is_told(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(installation.os, "access", lambda *_: False)
    assert "--out" in installation._results().advice


def test_dependencies_out_of_range_are_broken(monkeypatch):
    monkeypatch.setattr(installation, "requires", lambda name: ["numpy>=99", 'rich>=1; extra == "plot"'])
    found = list(installation._dependencies())
    assert found[-1].broken and "is not >=99" in found[-1].state
    assert installation._extras_of(Requirement('rich>=1; extra == "plot"')) == {"plot"}


def test_it_needs_no_extra():
    """It has to run where nothing else does."""
    code = "import sys; from sffr_workbench.common import installation; list(installation.core_findings());"
    code += " print([name for name in ('torch', 'matplotlib', 'ray', 'minari') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    assert all(isinstance(each, Finding) for each in core_findings())
