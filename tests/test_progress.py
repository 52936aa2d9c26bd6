"""What the terminal shows while a command runs."""

import io
import time

from rich.console import Console

from sffr_workbench.cli import progress
from sffr_workbench.cli.verify import print_outcome
from sffr_workbench.verify import Check

PASSED = Check("Rigid H", "Pinocchio", 1e-16, 1e-11, "", True, 1.25, "", section="Rigid part")


def terminal(text, **settings):
    """A console that writes into ``text``."""
    settings = {"force_terminal": True, "_environ": {"TERM": "xterm"}} | settings
    return Console(file=text, highlight=False, width=100, **settings)


def evaluation_progress(compiled, monkeypatch, **settings):
    """A display on a terminal that a test can read, and what it wrote."""
    monkeypatch.setattr(progress, "is_compiled", lambda: compiled)
    for name, value in settings.items():
        monkeypatch.setattr(progress.EvaluationProgress, name, value)
    text = io.StringIO()
    return progress.EvaluationProgress(terminal(text)), text


def test_first_run_says_at_once_that_it_compiles(monkeypatch):
    show, text = evaluation_progress(False, monkeypatch)
    with show:
        show("none", 0, 0)
        assert progress.COMPILING in text.getvalue()
        show("none", 0, 100)
        assert "compiled in" not in text.getvalue()
        show("none", 10, 100)
        assert "compiled in 0 s" in text.getvalue()
        show("hsc", 50, 100)
        show("hsc", 60, 100)
    assert text.getvalue().count(progress.COMPILING) == 1


def test_silent_policy_is_taken_for_one_that_compiles(monkeypatch):
    show, text = evaluation_progress(True, monkeypatch, SILENCE=0.05)
    with show:
        show("none", 0, 0)
        show("none", 10, 100)
        assert text.getvalue() == ""
        show("random", 50, 100)
        deadline = time.monotonic() + 10.0
        while progress.COMPILING not in text.getvalue() and time.monotonic() < deadline:
            time.sleep(0.01)
        show("random", 60, 100)
    assert text.getvalue().index(progress.COMPILING) < text.getvalue().index("compiled in")


def test_bar_shows_for_a_long_run_only(monkeypatch):
    for patience, shown in (0.0, True), (1000.0, False):
        show, text = evaluation_progress(True, monkeypatch, PATIENCE=patience)
        with show:
            for done in 0, 10, 20, 100:
                show("none", done, 100)
        assert ("remaining" in text.getvalue()) is shown


def test_checks_are_listed_where_there_is_no_terminal():
    text = io.StringIO()
    with progress.ProgressBar(console := terminal(text, force_terminal=False)) as show:
        show("Inertia of Eq. [41]", 0, 2)
        print_outcome(console, PASSED)
        print_outcome(console, PASSED._replace(passed=False, against=""))
    lines = text.getvalue().splitlines()[-2:]
    assert lines == ["pass   1.2 s  Rigid H, against Pinocchio", "FAIL   1.2 s  Rigid H"]


def test_terminal_shows_what_runs_and_keeps_failures(monkeypatch):
    monkeypatch.setattr(progress, "is_compiled", lambda: False)
    text = io.StringIO()
    with progress.ProgressBar(console := terminal(text)) as show:
        show("Inertia of Eq. [41]", 1, 7)
        show._bar.refresh()
        print_outcome(console, PASSED)
        print_outcome(console, PASSED._replace(name="Rigid C", passed=False))
    written = text.getvalue()
    assert progress.COMPILING in written
    assert "Inertia of Eq. [41]" in written and "1/7" in written
    assert "Rigid H" not in written and "FAIL   1.2 s  Rigid C" in written
