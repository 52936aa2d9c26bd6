"""The documents tell of what is there: every file, function, test, key and section that they name exists."""

import ast
import fnmatch
import re
import tomllib
from functools import cache
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
ROOMS = ["sffr_gym", "baselines", "agents", "workbench", "configs", "tests", "docs"]
PARTS = [*ROOMS, "docs/clients", "docs/environments", "docs/tutorials"]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(file for part in PARTS for file in (ROOT / part).glob("*.md"))])
PATH = re.compile(rf"(?<![\w/.-])(?:{'|'.join(ROOMS)})/[\w./*-]*\w")
WRITTEN = re.compile(r"docs/(_build|images)/")  # by a command
LINK = re.compile(r"\[([^\]]*)\]\(([^)\s]+)\)")
CONFIG = ROOT / "configs" / "sffr.yaml"
OF_THE_PAPER = re.compile(r"\b(Table|Eq\.|sec\.)")
NAMES = {"name", "arm"}  # keys that say what a thing is called


@cache
def names_in(file):
    """Everything that a module defines: functions, classes with their members, constants; dotted, module name first."""
    found = set()

    def visit(body, prefix):
        for node in body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                found.add(prefix + node.name)
            if isinstance(node, ast.ClassDef):
                visit(node.body, f"{prefix}{node.name}.")
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            for target in targets:
                for name in target.elts if isinstance(target, ast.Tuple) else [target]:
                    if isinstance(name, ast.Name):
                        found.add(prefix + name.id)

    visit(ast.parse(file.read_text(encoding="utf-8")).body, "")
    return found | {f"{file.stem}.{name}" for name in found}


def links(document):
    """(text, target) of every link and picture; code blocks are no text."""
    text = re.sub(r"```.*?```", "", document.read_text(encoding="utf-8"), flags=re.DOTALL)
    return [(words.strip("`"), target) for words, target in LINK.findall(text) if "://" not in target]


def broken_links(document):
    """Links that lead nowhere, as text."""
    found = []
    for words, target in links(document):
        file = (document.parent / target.partition("#")[0]).resolve()
        is_code = file.suffix == ".py" and words not in (file.name, file.relative_to(ROOT).as_posix())
        if not file.exists():
            found.append(f"{target}: no such file")
        elif is_code and words not in names_in(file):
            found.append(f"{target} has no {words}")
    return found


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda file: file.relative_to(ROOT).as_posix())
def test_every_path_in_the_text_exists(document):
    paths = {path for path in PATH.findall(document.read_text(encoding="utf-8")) if not WRITTEN.match(path)}
    assert [path for path in sorted(paths) if not any(ROOT.glob(path))] == []


def test_targets_of_make_are_those_that_documents_name():
    targets = set(re.findall(r"^([a-z]+):.*## ", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    documents = [*DOCUMENTS, ROOT / ".ci" / "run", *(ROOT / ".github").rglob("*.md")]
    named = {name for file in documents for name in re.findall(r"`make ([a-z]+)", file.read_text(encoding="utf-8"))}
    assert len(named) > 5
    assert named <= targets


def sections(document):
    """Numbers of a document's numbered headings."""
    return {int(number) for number in re.findall(r"^## (\d+)\. ", document.read_text(encoding="utf-8"), re.MULTILINE)}


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda file: file.relative_to(ROOT).as_posix())
def test_everything_linked_exists(document):
    assert broken_links(document) == []


@pytest.mark.parametrize("name", ["physics.md", "errata.md"])
def test_documents_are_linked_with_the_code_and_from_the_readme(name):
    assert f"docs/{name}" in {target for _, target in links(ROOT / "README.md")}
    assert sum(target.endswith(".py") for _, target in links(ROOT / "docs" / name)) > 40


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("[`panel.condense`](sffr_gym/physics/panel.py)", None),
        ("[`Simulator.step`](sffr_gym/physics/simulator.py)", None),
        ("[`SIGNALS`](sffr_gym/task/signals.py)", None),
        ("[`signals.ATTITUDE`](sffr_gym/task/signals.py)", None),  # one of several assigned
        ("[`panel.condensed`](sffr_gym/physics/panel.py)", "sffr_gym/physics/panel.py has no panel.condensed"),
        ("[`beam.condense`](sffr_gym/physics/panel.py)", "sffr_gym/physics/panel.py has no beam.condense"),
        ("[`Simulator.fly`](sffr_gym/physics/simulator.py)", "sffr_gym/physics/simulator.py has no Simulator.fly"),
        ("[paper](docs/nowhere.md)", "docs/nowhere.md: no such file"),
    ],
)
def test_a_wrong_link_is_found(text, error, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    for folder in "sffr_gym", "baselines", "workbench", "docs":
        (tmp_path / folder).symlink_to(ROOT / folder)
    assert broken_links(page) == ([error] if error else [])


@pytest.mark.parametrize(("name", "other"), [("physics.md", "errata.md"), ("errata.md", "physics.md")])
def test_cited_sections_exist(name, other):
    """Sections of a page itself, and of the other one behind a link to it; those of the paper are called sec."""
    text = (ROOT / "docs" / name).read_text(encoding="utf-8")
    of_other = re.compile(rf"\({other}\),\s+sections? ([\d, and]+)")
    for page, words in ((other, of_other.findall(text)), (name, re.findall(r"section (\d+)", of_other.sub("", text)))):
        numbers = {int(number) for cited in words for number in re.findall(r"\d+", cited)}
        assert numbers and numbers <= sections(ROOT / "docs" / page)


def keys_with_comments(node, comments, path=(), said=()):
    """(dotted key, comments on its line and on those of the keys above it) of every value of the file."""
    children = []
    if isinstance(node, yaml.MappingNode):
        children = [(key.value, key.start_mark.line, value) for key, value in node.value]
    elif isinstance(node, yaml.SequenceNode) and any(not isinstance(x, yaml.ScalarNode) for x in node.value):
        children = [(str(k), value.start_mark.line, value) for k, value in enumerate(node.value)]
    if not children:
        yield ".".join(path), said
    for key, line, value in children:
        yield from keys_with_comments(value, comments, (*path, key), (*said, comments.get(line, "")))


def test_errata_have_every_choice_that_is_not_the_papers():
    """A key needs a row in the errata unless a comment gives its place in the paper and calls nothing an assumption."""
    text = CONFIG.read_text(encoding="utf-8")
    comments = {k: line.partition("#")[2] for k, line in enumerate(text.splitlines())}
    keys = dict(keys_with_comments(yaml.compose(text), comments))
    rows = re.findall(r"^\| (`[^|]*`) \|", (ROOT / "docs" / "errata.md").read_text(encoding="utf-8"), re.MULTILINE)
    patterns = [pattern for row in rows for pattern in re.findall(r"`([^`]+)`", row)]
    matched = {p: [key for key in keys if fnmatch.fnmatch(key, p) or fnmatch.fnmatch(key, p + ".*")] for p in patterns}
    assert [pattern for pattern, found in matched.items() if not found] == []
    told = {key for found in matched.values() for key in found}
    ours = {
        key
        for key, said in keys.items()
        if key.rpartition(".")[2] not in NAMES
        and not (any(map(OF_THE_PAPER.search, said)) and "assumption" not in " ".join(said))
    }
    assert len(ours) > 20
    assert sorted(ours - told) == []


def test_the_start_names_every_extra_and_what_all_leaves_out():
    """Those of users: not what documents and develops the project."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    table = re.search(r"\| extra \|.*?\n\n", (ROOT / "docs" / "start.md").read_text(encoding="utf-8"), re.S)[0]
    rows = " ".join(re.findall(r"^\| ([^|]*) \|", table, re.M))
    assert set(re.findall(r"`([a-z]+)`", rows)) == set(extras) - {"dev", "docs"}
    left = re.search(r"all of these but (.*?) \|", table)[1]
    brought = set(re.search(r"\[(.*)\]", extras["all"][0])[1].split(","))
    assert set(re.findall(r"`([a-z]+)`", left)) == set(extras) - {"dev", "docs", "all"} - brought
