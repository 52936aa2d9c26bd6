"""What a notebook shows of an object: a name and a table, in HTML that takes the notebook's colours."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape


def card(title: str, rows: Mapping[str, object]) -> str:
    """Return a title above a table of names and values, which may be anything with a text."""
    cells = "".join(
        f"<tr><th style='text-align:left'>{escape(name)}</th><td style='text-align:left'>{escape(str(value))}</td></tr>"
        for name, value in rows.items()
    )
    return f"<div><b>{escape(title)}</b><table>{cells}</table></div>"


def brief(name: str, rows: Mapping[str, object]) -> str:
    """Return the same in a line, as ``repr`` has it."""
    return f"{name}({', '.join(f'{key}={value!r}' for key, value in rows.items())})"


class Shown:
    """Something with a line as its ``repr`` and a table in notebooks, of what ``_told`` returns."""

    def __repr__(self) -> str:
        """Return class and what tells this object from others."""
        return brief(type(self).__name__, self._told())

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        return card(type(self).__name__, self._told())

    def _told(self) -> dict[str, object]:
        """What tells this object from others, by name."""
        raise NotImplementedError
