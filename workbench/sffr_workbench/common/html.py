"""Pages of HTML that need no network."""

from __future__ import annotations

import base64
from collections.abc import Callable
from typing import Any


def template(package: str, filters: dict[str, Callable[..., Any]] | None = None) -> Any:
    """Return the Jinja template ``templates/report.html`` of a package; it escapes what it is given.

    Raises:
        ModuleNotFoundError: without jinja2.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined  # optional

    environment = Environment(
        loader=PackageLoader(package), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= filters or {}
    return environment.get_template("report.html")


def png_uri(content: bytes) -> str:
    """Return a PNG file as a data URI."""
    return f"data:image/png;base64,{base64.b64encode(content).decode('ascii')}"
