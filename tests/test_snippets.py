"""What README and documentation show to be pasted runs as pasted: programs here, those of clients by `make clients`."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest
from typer.main import get_command

from sffr_workbench.cli.app import app

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES = [page for page in PAGES if "_build" not in page.parts and "api" not in page.parts]
CLIENTS = {"rllib", "torchrl", "skrl", "tianshou", "zoo"}  # whose packages the project does not install
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def blocks(page):
    """(language, text) of each fenced block."""
    return BLOCK.findall(page.read_text(encoding="utf-8"))


def name(page):
    return page.relative_to(ROOT).as_posix()


OPTIONS = get_command(app)  # which takes as long as parsing a hundred commands
PROGRAMS = [
    pytest.param(page, k, id=f"{name(page)}-{k}")
    for page in PAGES
    if page.stem not in CLIENTS and any(language == "python" for language, _ in blocks(page))
    for k in range(sum(language == "python" for language, _ in blocks(page)))
    if (page.name, k) != ("control.md", 2)  # needs a run, on which test_export.py runs it
]
COMMANDS = sorted(
    {
        (name(page), line.partition("#")[0].strip())
        for page in [*PAGES, ROOT / "CONTRIBUTING.md"]
        if page.name != "results.md"  # which tells what was typed when its settings were found
        for text in [
            *(text for _, text in blocks(page)),
            *(" ".join(shown.split()) for shown in re.findall(r"`(sffr [^`]+)`", page.read_text(encoding="utf-8"))),
        ]
        for line in text.replace("\\\n", " ").splitlines()
        if line.startswith("sffr ")
    }
)


def test_pages_have_programs_and_commands():
    assert len(PROGRAMS) > 10 and len(COMMANDS) > 30


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 150


@pytest.mark.parametrize(("page", "k"), PROGRAMS)
def test_a_program_runs_as_pasted(page, k, tmp_path):
    """A page is read from its top: what an earlier block defines is there, in the folder of the earlier files."""
    programs = [text for language, text in blocks(page) if language == "python"]
    before = programs[:k] if page.stem == "cleanrl" and k == 1 else []
    file = tmp_path / "program.py"
    file.write_text("\n".join([*before, programs[k]]), encoding="utf-8")
    warnings = ["-W", "error"] if page.parent.name != "clients" else []
    run = [sys.executable, *warnings, str(file)]
    done = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, env=os.environ | {"OMP_NUM_THREADS": "1"})
    assert done.returncode == 0, done.stderr
    assert "nan" not in done.stdout


@pytest.mark.parametrize(("page", "line"), COMMANDS, ids=lambda value: value[:60])
def test_a_command_has_the_options_that_are_shown(page, line):
    """Parsed as the command line parses it; nothing runs, and files that are named need not exist."""
    words = shlex.split(line)[1:]
    if words[0].isupper() or "..." in words or len(words) == 1:
        assert words[0] in OPTIONS.commands or words[0].isupper() or words[0].startswith("-")
        return
    command = OPTIONS.commands[words[0]]
    placeholders = [word for word in words[1:] if word not in ("...", "[POLICY]")]
    try:
        command.make_context(words[0], placeholders)
    except click.exceptions.Exit:  # --help and --version
        pass
    except click.UsageError as error:
        pytest.fail(f"{page}: {line}: {error.format_message()}")
