"""Settings of the documentation, which ``make docs`` builds into ``docs/_build/html``."""

import importlib
import importlib.metadata
import inspect
import re
from pathlib import Path, PurePosixPath
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).parents[1]
ROOMS = ("sffr_gym", "baselines", "agents", "workbench")
PACKAGES = ["sffr_gym", "baselines/sffr_baselines", "agents/sffr_agents", "workbench/sffr_workbench"]

project = "sffr-gym"
author = copyright = "The sffr-gym authors"
release = importlib.metadata.version(project)

extensions = [
    "myst_nb",  # MyST's pages, and those that are notebooks
    "sphinx.ext.apidoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
]
exclude_patterns = [
    "api/*/modules.rst",  # tables of contents with one entry each
    "clients/tried.md",  # a part of another page
    "_build",
]
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 4
myst_fence_as_directive = ["math"]
nb_execution_mode = "force"  # each time: what a notebook shows is what the code does
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 300  # s of a cell
html_theme = "furo"
html_title = f"{project} {release}"
html_math_renderer = "mathml"  # browsers draw it themselves, without network
html_static_path = ["static"]
html_css_files = ["wide.css"]

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


class Summary(SphinxDirective):
    """The first paragraph of an environment's class docstring, which is written in Markdown as Gymnasium's are."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the parsed paragraph."""
        return self.parse_text_to_nodes(_docstring(self.arguments[0]).partition("\n## ")[0])


class Specification(SphinxDirective):
    """The sections of such a docstring."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the parsed sections."""
        text = "## " + _docstring(self.arguments[0]).partition("\n## ")[2]
        return self.parse_text_to_nodes(text, allow_section_headings=True)


def _docstring(path: str) -> str:
    """Return the docstring of a class that is named with its module."""
    module, _, name = path.rpartition(".")
    return inspect.getdoc(getattr(importlib.import_module(module), name)) or ""


def shorten_specification(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Keep the first paragraph of a docstring in Markdown; the page of the environments has all of it."""
    if any(line.startswith("## ") for line in lines):
        lines[:] = [*lines[: lines.index("")], "", "Its specification: :doc:`/environments/index`."]


class Policies(SphinxDirective):
    """A table of all policies by name."""

    def run(self) -> list[nodes.Node]:
        """Return the parsed table."""
        from sffr_baselines import POLICIES

        rows = "".join(f"| `{name}` | {text} |\n" for name, text in POLICIES.items())
        return self.parse_text_to_nodes(f"| name | what it is |\n|---|---|\n{rows}")


class Commands(SphinxDirective):
    """Every command with what its help says."""

    def run(self) -> list[nodes.Node]:
        """Return the parsed sections."""
        from typer.main import get_command

        from sffr_workbench.cli.app import app

        group: Any = get_command(app)
        pages = [_command_page(name, group.commands[name]) for name in sorted(group.commands)]
        return self.parse_text_to_nodes("\n".join(pages), allow_section_headings=True)


def _command_page(name: str, command: Any) -> str:
    """Return a command's help as Markdown."""
    words = _plain(inspect.cleandoc(command.help or ""))
    rows = []
    for each in command.params:
        flags = ", ".join(f"`{flag}`" for flag in (*each.opts, *each.secondary_opts)) if each.opts[0][0] == "-" else ""
        says = " ".join(_plain(getattr(each, "help", None) or "").split())
        rows.append(f"| {flags or f'`{each.metavar or each.name}`'} | {says.replace('|', '/')} |\n")
    return f"## sffr {name}\n\n{words}\n\n| option | |\n|---|---|\n{''.join(rows)}"


def _plain(text: str) -> str:
    """Return a text without rich's marks; what looks like one and is none begins with a backslash.

    What is to be pasted is code, else its quotes would be those of printed text.
    """
    plain = re.sub(r"(?<!\\)\[(/|/?bold)\]", "", text).replace("\\[", "[")
    return re.sub(r'pip install "[^"]+"', r"`\g<0>`", plain)


def leave_out_of_tree(app: Sphinx, docname: str, content: list[str]) -> None:
    """Keep modules out of the navigation, which the theme draws anew for each page, with a line that leads back.

    With three hundred modules in it, it took two thirds of the time, and hid the pages for users.
    """
    if not docname.startswith("api/"):
        return
    name = PurePosixPath(docname).name
    above = name.rpartition(".")[0]
    title, line, rest = content[0].split("\n", 2)
    part_of = f"Part of :py:mod:`{above}`; :doc:`/reference`." if above else ":doc:`/reference`."
    content[0] = "\n".join(["" if above else ":orphan:\n", title, line, "", part_of, rest])


def link_code(app: Sphinx, docname: str, content: list[str]) -> None:
    """Turn links to files of the source into links to the reference of the code, or into plain text.

    On a page of the source tree both work; an index of pages has no other files.
    """
    folder = PurePosixPath(docname).parent

    def link(found: re.Match[str]) -> str:
        words, target = found[1], found[2]
        file = Path("docs", folder, target)
        path = PurePosixPath(*_without_dots(file.as_posix().split("/")))
        if path.suffix == ".py" and path.parts[0] in ROOMS:
            module = ".".join(PurePosixPath(*path.parts[path.parts[0] != "sffr_gym" :]).with_suffix("").parts)
            return f"{{py:mod}}`{words.strip('`')} <{module}>`"
        if path.parts[0] == "docs" and path.suffix in (".md", ".png", ".gif", ".json"):
            return found[0]
        return words

    content[0] = re.sub(r"(?<!!)\[([^\]]+)\]\((?!https?:|#)([^)#\s]+)(#[^)]*)?\)", link, content[0])


def _without_dots(parts: list[str]) -> list[str]:
    """Return the parts of a path with ``..`` followed."""
    kept: list[str] = []
    for part in parts:
        if part == "..":
            kept.pop()
        elif part != ".":
            kept.append(part)
    return kept


def inline_math(writer: Any, node: nodes.math) -> None:
    """Write a formula within a line."""
    writer.body.append(convert(_with_primes(node.astext())))
    raise nodes.SkipNode


def display_math(writer: Any, node: nodes.math_block) -> None:
    """Write a formula, or one below the other, on lines of their own."""
    formulas = [part for part in re.split(r"\n\s*\n", node.astext()) if part.strip()]
    drawn = "".join(convert(_with_primes(part), display="block") for part in formulas)
    writer.body.append(f'<div class="formula">{drawn}</div>')
    raise nodes.SkipNode


def _with_primes(formula: str) -> str:
    """Return a formula in which a prime and an exponent are one superscript, as the converter wants them."""
    primed = r"('+)\^(\{[^{}]*\}|\\?\w)"
    return re.sub(primed, lambda found: "^{" + "\\prime " * len(found[1]) + found[2] + "}", formula)


def setup(app: Sphinx) -> None:
    """Register the directives, the formulas, the shortening and the links."""
    app.add_html_math_renderer("mathml", (inline_math, None), (display_math, None))
    app.add_directive("summary", Summary)
    app.add_directive("specification", Specification)
    app.add_directive("policies", Policies)
    app.add_directive("commands", Commands)
    app.connect("source-read", link_code)
    app.connect("source-read", leave_out_of_tree)
    app.connect("autodoc-process-docstring", shorten_specification, priority=100)  # before napoleon
