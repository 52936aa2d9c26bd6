"""Terminals of any encoding: nothing that a command prints ends it."""

import io
import os
import subprocess
import sys

import pytest

from sffr_workbench.cli.encoding import PLAIN, spell_out
from sffr_workbench.cli.terminal import consoles

CODE = """
import sys
from sffr_workbench.cli import app
from sffr_workbench.cli.terminal import consoles
from sffr_workbench.common import terminal_table
notes, results = consoles()
table = terminal_table("\\u5929 r\\udcff")
table.add_column("\\u00b5m\\nV\\u00b2 s")
table.add_row("1 \\u00b1 2")
results.print(table)
notes.print("5 \\u00d7 \\u2192 \\u2026")
"""
ENVIRONMENTS = {
    "ascii": {"PYTHONIOENCODING": "ascii"},
    "cp1252": {"PYTHONIOENCODING": "cp1252"},
    "cp437": {"PYTHONIOENCODING": "cp437"},
    "utf-8": {"PYTHONIOENCODING": "utf-8"},
    "posix": {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"},
}


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_tables_and_notes_are_written_in_every_encoding(name):
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "LC_", "LANG"))}
    done = subprocess.run([sys.executable, "-c", CODE], env=kept | ENVIRONMENTS[name], capture_output=True)
    assert done.returncode == 0, done.stderr
    encoding = "ascii" if name == "posix" else name
    table, note = done.stdout.decode(encoding), done.stderr.decode(encoding)
    for words in ("um", "V2 s", "1 +- 2") if encoding == "ascii" else ("µm", "V² s", "1 ± 2"):
        assert words in table
    assert "r?" in table
    notes = {"cp1252": "5 \u00d7 -> …", "utf-8": "5 \u00d7 → …"}
    assert note.strip() == notes.get(encoding, "5 x -> ...")


COMMANDS = """
import sys
from sffr_workbench.cli.main import main
for arguments in ["--help"], ["evaluate", "--help"], ["nonsense"], ["report", "not\\udcff there"]:
    sys.argv[1:] = arguments
    try:
        main()
    except SystemExit as end:
        print(*map(ascii, arguments), "ends with", end.code or 0, flush=True)
"""


def test_help_and_errors_are_written_in_ascii(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", COMMANDS], env=os.environ | {"PYTHONIOENCODING": "ascii"}, capture_output=True,
        cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0 and b"Traceback" not in done.stderr
    assert (done.stdout + done.stderr).isascii()
    ends = [line for line in done.stdout.decode().splitlines() if " ends with " in line]
    assert [end.rpartition(" ")[2] for end in ends] == ["0", "0", "2", "2"]
    assert b"nonsense" in done.stderr and b"there" in done.stderr


@pytest.mark.parametrize("errors", ["replace", "ignore", "xmlcharrefreplace"])
def test_what_the_user_has_asked_for_stays(errors, monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii", errors=errors)
    monkeypatch.setattr(sys, "stdout", stream)
    spell_out()
    assert stream.errors == errors


def test_streams_that_are_none_of_python_are_left_alone(monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stdout", stream)
    consoles()[1].print("µ")
    assert stream.getvalue() == "µ\n"


def test_plain_letters_are_plain():
    assert all(text.isascii() and not letter.isascii() for letter, text in PLAIN.items())
