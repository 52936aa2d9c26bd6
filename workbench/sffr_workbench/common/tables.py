"""Tables for the terminal and in Markdown."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text


def terminal_table(title: str = "", padding: int = 1, **options: Any) -> Table:
    """Return a table without columns: a line below its head, ``padding`` spaces behind each cell.

    Args:
        title: above it; empty for none.
        padding: number of spaces.
        options: further ones of ``rich.table.Table``.
    """
    return Table(
        title=Text(title) if title else None, title_style="bold", title_justify="left", box=box.SIMPLE_HEAD,
        show_edge=False, padding=(0, padding, 0, 0), **options,
    )  # fmt: skip


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]], texts: Collection[int] = (0,)) -> str:
    """Return a table in Markdown, its numbers aligned at the right.

    Args:
        head: headings of the columns.
        rows: cells; a bar in them is escaped.
        texts: columns that hold text.
    """
    rule = ["---" if k in texts else "---:" for k in range(len(head))]
    lines = [head, rule, *([cell.replace("|", "\\|") for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
