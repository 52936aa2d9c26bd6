"""Settings of the API reference, which ``make api`` builds from the docstrings into ``docs/_build/html``."""

import importlib
import importlib.metadata
import inspect
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).parents[1]
PACKAGES = ["sffr_gym", "baselines/sffr_baselines", "agents/sffr_agents", "workbench/sffr_workbench"]

project = "sffr-gym"
author = copyright = "The sffr-gym authors"
release = importlib.metadata.version(project)

extensions = [
    "myst_parser",
    "sphinx.ext.apidoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
]
include_patterns = ["index.md", "environments.md", "api/**"]
exclude_patterns = ["api/*/modules.rst"]  # tables of contents with one entry each
html_theme = "furo"
html_title = f"{project} {release}"

apidoc_modules = [
    {
        "path": ROOT / package,
        "destination": f"api/{Path(package).name}",
        "separate_modules": True,
        "module_first": True,
        "automodule_options": {"members", "show-inheritance"},
    }
    for package in PACKAGES
]
suppress_warnings = ["ref.python"]  # fields of several classes have the same name, and napoleon links each
autosummary_generate = False  # tables of links alone
autodoc_default_options = {"ignore-module-all": True}  # each thing once, where it lies
autodoc_member_order = "bysource"
napoleon_use_ivar = True  # else fields would stand twice
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"


class Specification(SphinxDirective):
    """An environment's class docstring, which is written in Markdown as Gymnasium's are."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the parsed docstring."""
        module, _, name = self.arguments[0].rpartition(".")
        text = inspect.getdoc(getattr(importlib.import_module(module), name)) or ""
        return self.parse_text_to_nodes(text, allow_section_headings=True)


def shorten_specification(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Keep the first paragraph of a docstring in Markdown; the page of the environments has all of it."""
    if any(line.startswith("## ") for line in lines):
        lines[:] = [*lines[: lines.index("")], "", "Its specification: :doc:`/environments`."]


def setup(app: Sphinx) -> None:
    """Register the directive and the shortening."""
    app.add_directive("specification", Specification)
    app.connect("autodoc-process-docstring", shorten_specification, priority=100)  # before napoleon
