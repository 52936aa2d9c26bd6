"""The report of ``sffr verify``: one HTML file with the table of checks and the pictures, light and dark."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape
from itertools import groupby
from pathlib import Path
from typing import Any

from verification.check import Check

FILE = "verification.html"

STYLE = """
:root { color-scheme: light dark; --ink: #1f2328; --dim: #59636e; --page: #ffffff; --line: #d1d9e0; --good: #1a7f37;
  --bad: #cf222e; --soft: #f6f8fa; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6edf3; --dim: #9198a1; --page: #0d1117; --line: #3d444d;
  --good: #3fb950; --bad: #f85149; --soft: #151b23; } }
body { margin: 0 auto; max-width: 62rem; padding: 2rem 1.2rem 4rem; color: var(--ink); background: var(--page);
  font: 16px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.6rem; margin: 0 0 .3rem; } h2 { font-size: 1.15rem; margin: 2.4rem 0 .6rem; }
h3 { font-size: 1rem; margin: 1.8rem 0 .2rem; }
p { margin: .3rem 0; } .dim, figcaption { color: var(--dim); }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: .9rem; table-layout: fixed;
  min-width: 44rem; }
th { text-align: left; color: var(--dim); font-weight: 600; }
th, td { padding: .45rem .7rem .45rem 0; border-top: 1px solid var(--line); vertical-align: top; }
th:nth-child(1) { width: 3.2rem; } th:nth-child(3) { width: 25%; } th:nth-child(6) { width: 4rem; }
th:nth-child(4), th:nth-child(5) { width: 5.6rem; }
td.number, th.number { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums; }
td small { display: block; color: var(--dim); font-size: .82rem; line-height: 1.4; margin-top: .15rem; }
.mark { white-space: nowrap; font-weight: 600; } .good { color: var(--good); } .bad { color: var(--bad); }
figure { margin: .6rem 0 1.6rem; padding: .8rem; background: var(--soft); border-radius: .5rem; }
figure svg { display: block; width: 100%; height: auto; color: var(--dim); } figcaption { font-size: .9rem; }
"""


def write_page(checks: Sequence[Check], folder: Path) -> Path:
    """Write the report into a folder, which is made if it is missing, and return the file.

    Raises:
        ModuleNotFoundError: without matplotlib, if a check has pictures.
    """
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / FILE
    file.write_text(page(checks), encoding="utf-8")
    return file


def page(checks: Sequence[Check]) -> str:
    """The report as HTML."""
    failed = sum(not check.passed for check in checks)
    seconds = sum(check.seconds for check in checks)
    verdict = '<span class="good">All passed</span>' if not failed else f'<span class="bad">{failed} failed</span>'
    parts = [
        "<!doctype html>", '<html lang="en">', '<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">', "<title>Verification</title>",
        f"<style>{STYLE}</style>", "<h1>Verification</h1>",
        f"<p>{verdict}: {len(checks)} checks in {seconds:.0f} s. Each compares the simulator with a derivation or with "
        "an engine that its authors did not write.</p>",
    ]  # fmt: skip
    for section, members in groupby(checks, key=lambda check: check.section):
        listed = list(members)
        parts += [f"<h2>{escape(section)}</h2>", *_table(listed)]
        for check in listed:
            for picture in check.pictures:
                parts += [f"<h3>{escape(picture.title)}</h3>", _figure(picture.title, picture.caption, picture.draw())]
    return "\n".join(parts) + "\n"


def number(value: float, unit: str) -> str:
    """An error or an allowance for people: two digits, a small integer as such."""
    if math.isnan(value):
        return "none"
    digits = f"{value:.0f}" if float(value).is_integer() and value < 1000 else f"{value:.2g}"
    return f"{digits} {unit}".rstrip()


def _table(checks: Iterable[Check]) -> list[str]:
    head = '<th></th><th>what</th><th>against</th><th class="number">error</th><th class="number">allowed</th>'
    lines = ['<div class="scroll"><table>', f'<tr>{head}<th class="number">time</th></tr>']
    for check in checks:
        mark = '<td class="mark good">pass</td>' if check.passed else '<td class="mark bad">FAIL</td>'
        lines.append(
            f"<tr>{mark}<td>{escape(check.name)}<small>{escape(check.note)}</small></td><td>{escape(check.against)}</td>"
            f'<td class="number">{escape(number(check.error, check.unit))}</td>'
            f'<td class="number">{escape(number(check.allowed, check.unit))}</td>'
            f'<td class="number">{check.seconds:.1f} s</td></tr>'
        )
    return [*lines, "</table></div>"]


def _figure(title: str, caption: str, figure: Any) -> str:
    from verification.pictures import svg

    image = svg(figure).replace("<svg ", f'<svg role="img" aria-label="{escape(title, quote=True)}" ', 1)
    return f"<figure>{image}<figcaption>{escape(caption)}</figcaption></figure>"
