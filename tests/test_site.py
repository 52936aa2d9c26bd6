"""The built documentation, where ``SFFR_SITE`` says: each link within it leads to a page, a file and a place."""

import os
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

SITE = Path(os.environ.get("SFFR_SITE") or "no site")
PARTS = ("index", "start", "environments/sffrflex", "scenarios", "policies", "clients/sb3", "reference", "physics")
PARTS += ("errata", "benchmark", "speed", "reliability", "faq", "commands", "cluster")

pytestmark = pytest.mark.skipif(not SITE.is_dir(), reason="SFFR_SITE names no site; see make docs")


class Links(HTMLParser):
    """Targets of links and pictures, and the places that a page has."""

    def __init__(self, page):
        super().__init__()
        self.targets, self.places = [], {""}
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.places |= {values[name] for name in ("id", "name") if values.get(name)}
        self.targets += [values[name] for name in ("href", "src") if values.get(name)]


@pytest.fixture(scope="module")
def pages():
    return {page: Links(page) for page in SITE.rglob("*.html")}


def test_every_link_within_the_site_leads_somewhere(pages):
    broken, known = [], {page.resolve(): links for page, links in pages.items()}
    for page, links in pages.items():
        for target in links.targets:
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                continue
            file = (page.parent / unquote(parts.path)).resolve() if parts.path else page.resolve()
            if not file.exists():
                broken.append(f"{page.relative_to(SITE)}: {target}")
            elif file.suffix == ".html" and file in known and unquote(parts.fragment) not in known[file].places:
                broken.append(f"{page.relative_to(SITE)}: {target} has no such place")
    assert broken == []


@pytest.mark.parametrize("part", PARTS)
def test_the_site_has_each_part(part):
    assert (SITE / f"{part}.html").is_file()


def test_pages_of_environments_are_their_docstrings():
    text = (SITE / "environments" / "sffrflex.html").read_text(encoding="utf-8")
    for words in ("A free-flying robot with two arms", "Action space", "Episode end", "thruster torque"):
        assert words in text


@pytest.mark.parametrize("name", ["first_steps", "own_law"])
def test_notebooks_show_what_they_ran(name, pages):
    """The table of an evaluation, a picture, and the notebook itself to download, with no cell that failed."""
    page = SITE / "tutorials" / f"{name}.html"
    text, targets = page.read_text(encoding="utf-8"), pages[page].targets
    assert text.count("cell_output") >= 3 and "<caption>" in text and "<th>ahsc</th>" in text
    assert any(target.endswith(".png") for target in targets) and any(name in t and ".ipynb" in t for t in targets)
    assert "Traceback" not in text


def test_every_command_is_listed():
    from typer.main import get_command

    from sffr_workbench.cli.app import app

    text = (SITE / "commands.html").read_text(encoding="utf-8")
    assert [name for name in get_command(app).commands if f"sffr {name}" not in text] == []
    assert "pip install &quot;sffr-gym[video]&quot;" in text.replace('</span> <span class="pre">', " ")
