"""What a user did wrong, or the machine cannot do, is told in lines on stderr, never in a traceback."""

import errno
import subprocess
import sys
import textwrap
import time

import psutil
import pytest
from command_line import sffr
from gymnasium.error import DependencyNotInstalled
from pydantic import BaseModel, ValidationError

from sffr_gym import ConfigError
from sffr_workbench.cli import report
from sffr_workbench.common import file_name


def validation_error():
    """Return the error of a model that somebody gave a user's data to."""

    class Model(BaseModel):
        jobs: int

    try:
        Model(jobs="many")
    except ValidationError as error:
        return error


ERRORS = {
    "config": (ConfigError("a: is wrong\nb: too"), ["a: is wrong", "b: too"]),
    "terminal": (ConfigError("a\x1b[2Jb\r: is \u202ewrong"), ["a\\x1b[2Jb\\r: is \\u202ewrong"]),
    "disk": (OSError(errno.ENOSPC, "No space left on device", "run/a"), ["run/a: No space left on device"]),
    "nameless": (OSError("no space"), ["no space"]),
    "memory": (MemoryError("Unable to allocate 330. GiB"), ["not enough memory: Unable to allocate 330. GiB"]),
    "silent": (MemoryError(), ["not enough memory"]),
    "encoding": (UnicodeEncodeError("ascii", "\u00e9", 0, 1, "no"), None),
    "model": (validation_error(), None),
    "extra": (DependencyNotInstalled("pip install x"), ["pip install x"]),
}


@pytest.mark.parametrize(("error", "lines"), ERRORS.values(), ids=ERRORS)
def test_errors_are_lines(monkeypatch, tmp_path, error, lines):
    pytest.importorskip("jinja2")

    def fail(*arguments):
        raise error

    monkeypatch.setattr(report, "write_report", fail)
    failed = sffr("report", tmp_path)
    assert failed.exit_code == 2 and failed.stdout == ""
    told = failed.stderr.splitlines()
    assert told == [f"error: {line}" for line in lines] if lines else len(told) == 1 and told[0].startswith("error: ")


def test_mistakes_of_ours_keep_their_traceback(monkeypatch, tmp_path):
    pytest.importorskip("jinja2")

    def fail(*arguments):
        raise KeyError("ours")

    monkeypatch.setattr(report, "write_report", fail)
    with pytest.raises(AssertionError):
        sffr("report", tmp_path)


@pytest.mark.parametrize("words", [["--help"], ["evaluate", "hsc"], ["doctor"]], ids=lambda words: words[0])
def test_a_working_directory_that_is_gone_is_told_in_a_sentence(words, tmp_path):
    gone = tmp_path / "gone"
    gone.mkdir()
    code = "import os, sys; os.rmdir(os.getcwd()); from sffr_workbench.cli.main import main; sys.exit(main())"
    done = subprocess.run([sys.executable, "-c", code, *words], cwd=gone, capture_output=True, text=True)
    assert done.returncode == 2 and done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: the working directory cannot be used")


def test_names_that_no_table_can_show_are_refused(tmp_path):
    for name in ("a\nb", "a\x1b[2Jb", "a\u202eb"):
        failed = sffr("evaluate", "hsc", tmp_path / f"{name}.npz", "--out", tmp_path / "run")
        (line,) = failed.stderr.splitlines()
        assert failed.exit_code == 2 and "its name must be text on one line" in line and line.isprintable()
    assert not (tmp_path / "run").exists()


def test_names_of_files_are_short_and_tell_apart():
    assert file_name("seed0/best") == "seed0%2Fbest"
    names = [letter * count + end for letter in ("x", "\U0001f600", "/") for count in (200, 300) for end in ("", "1")]
    files = [file_name(name) for name in names]
    assert len(set(files)) == len(names) and max(map(len, files)) <= 120
    assert all(set(file).isdisjoint("/\\:\0") for file in files)


def test_a_worker_ends_with_the_process_that_started_it(tmp_path):
    """Also if that was killed."""
    child = textwrap.dedent("""
        import os, sys, time
        from sffr_workbench.common import end_with_parent
        end_with_parent(int(sys.argv[1]))
        print(os.getpid(), flush=True)
        time.sleep(600)
    """)
    parent = textwrap.dedent(f"""
        import os, subprocess, sys
        subprocess.run([sys.executable, "-c", {child!r}, str(os.getpid())])
    """)
    with subprocess.Popen([sys.executable, "-c", parent], stdout=subprocess.PIPE, text=True) as process:
        worker = psutil.Process(int(process.stdout.readline()))
        time.sleep(1.0)
        assert worker.is_running() and worker.status() != psutil.STATUS_ZOMBIE
        process.kill()
        worker.wait(timeout=10.0)
