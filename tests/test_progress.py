"""What the terminal shows while a command runs."""

import io

from rich.console import Console

from sffr_workbench.cli import progress
from sffr_workbench.cli.verify import print_outcome
from sffr_workbench.verify import Check

PASSED = Check("Rigid H", "Pinocchio", 1e-16, 1e-11, "", True, 1.25, "", section="Rigid part")


def terminal(text, **settings):
    """A console that writes into ``text``."""
    settings = {"force_terminal": True, "_environ": {"TERM": "xterm"}} | settings
    return Console(file=text, highlight=False, width=100, **settings)


def test_bar_shows_for_a_long_run_only(monkeypatch):
    for patience, shown in (0.0, True), (1000.0, False):
        monkeypatch.setattr(progress.EvaluationProgress, "PATIENCE", patience)
        text = io.StringIO()
        with progress.EvaluationProgress(terminal(text)) as show:
            for done in 0, 10, 20, 100:
                show("none", done, 100)
        assert ("remaining" in text.getvalue()) is shown
        assert shown or not text.getvalue()


def test_checks_are_listed_where_there_is_no_terminal():
    text = io.StringIO()
    with progress.ProgressBar(console := terminal(text, force_terminal=False)) as show:
        show("Inertia of Eq. [41]", 0, 2)
        print_outcome(console, PASSED)
        print_outcome(console, PASSED._replace(passed=False, against=""))
    lines = text.getvalue().splitlines()[-2:]
    assert lines == ["pass   1.2 s  Rigid H, against Pinocchio", "FAIL   1.2 s  Rigid H"]


def test_terminal_shows_what_runs_and_keeps_failures():
    text = io.StringIO()
    with progress.ProgressBar(console := terminal(text)) as show:
        show("Inertia of Eq. [41]", 1, 7)
        show._bar.refresh()
        print_outcome(console, PASSED)
        print_outcome(console, PASSED._replace(name="Rigid C", passed=False))
    written = text.getvalue()
    assert "Inertia of Eq. [41]" in written and "1/7" in written
    assert "Rigid H" not in written and "FAIL   1.2 s  Rigid C" in written
