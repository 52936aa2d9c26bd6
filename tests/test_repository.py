"""Files that tools and platforms read: citation, hooks, forms, targets of make."""

import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
FORMS = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))
FIELDS = {"markdown", "textarea", "input", "dropdown", "checkboxes"}  # of a form


def load(*parts):
    return yaml.safe_load(ROOT.joinpath(*parts).read_text(encoding="utf-8"))


def test_citation_is_that_of_the_project():
    """The keys that CFF 1.2.0 demands, of the software and of each reference."""
    citation = load("CITATION.cff")
    assert citation.keys() >= {"cff-version", "message", "title", "authors"}
    assert citation["cff-version"] == "1.2.0"
    assert (citation["version"], citation["license"]) == (PROJECT["version"], PROJECT["license"])
    assert citation["title"].startswith(PROJECT["name"])
    assert citation["keywords"] == PROJECT["keywords"]
    for work in [citation, *citation["references"]]:
        assert work.keys() >= {"title", "authors", "type"}
        assert all(author.keys() & {"name", "family-names"} for author in work["authors"])
    paper = citation["references"][0]["title"]
    assert f"*{paper}*" in " ".join((ROOT / "docs" / "errata.md").read_text(encoding="utf-8").split())


def test_hooks_run_the_projects_own_tools():
    (repository,) = load(".pre-commit-config.yaml")["repos"]
    assert repository["repo"] == "local"
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for hook in repository["hooks"]:
        assert hook["language"] == "system"
        assert f"$(BIN)/{hook['entry'].split()[0]}" in makefile
    assert {hook["entry"].split()[0] for hook in repository["hooks"]} == {"ruff", "mypy", "lint-imports"}


@pytest.mark.parametrize("form", FORMS, ids=lambda file: file.stem)
def test_form_is_valid(form):
    content = load(form)
    assert content.keys() >= {"name", "description", "body"}
    assert {field["type"] for field in content["body"]} <= FIELDS
    identities = [field["id"] for field in content["body"]]
    assert len(set(identities)) == len(identities)
    assert all(field["attributes"]["label"] for field in content["body"])
    assert any(field.get("validations", {}).get("required") for field in content["body"])


def test_there_is_a_form_for_bugs_and_one_for_features():
    assert [form.stem for form in FORMS] == ["bug", "feature"]


@pytest.mark.skipif(not shutil.which("make"), reason="needs make")
def test_help_lists_every_target():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.search(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)[1].split())
    shown = subprocess.run(
        ["make", "--no-print-directory", "help"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout
    assert {line.split()[1] for line in shown.splitlines()} == targets


@pytest.mark.parametrize("file", sorted(Path(__file__).parent.rglob("test_*.py")), ids=lambda file: file.stem)
def test_what_tests_share_lies_beside_them(file):
    """A test that imported another's file would need all that this one needs, with the oldest versions too."""
    imported = re.findall(r"^(?:from|import) (test_\w+)", file.read_text(encoding="utf-8"), re.MULTILINE)
    assert not imported
