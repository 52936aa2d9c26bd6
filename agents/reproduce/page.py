"""The outcome for people and programs: the claims as table, Markdown and JSON, and one page with all pictures."""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

from agents.reproduce.claims import FAILS, HOLDS, PARTLY, UNTESTED, Claim
from agents.reproduce.figures import Plate

WIDE = 120  # columns of a terminal that has room for everything
COLOURS = {HOLDS: "green", PARTLY: "yellow", FAILS: "red", UNTESTED: "dim"}
INTRODUCTION = (
    "The case study of section 5.3 with the paper's full law: virtual damping on all three coordinates of each panel, "
    "at a control period of 0.5 ms. ahsc is the adaptation as printed (Y = e), ahsc-filtered the one with the filtered "
    "output (Y = e_dot + psi e); hsc keeps the virtual damping, none leaves the piezos off."
)
STYLE = """
:root { color-scheme: light; } body { margin: 0 auto; max-width: 66rem; padding: 2rem 1.2rem 4rem; color: #1f2328;
  font: 16px/1.5 system-ui, sans-serif; background: #fff; }
h1 { font-size: 1.6rem; margin: 0 0 .3rem; } h2 { font-size: 1.15rem; margin: 2.4rem 0 .4rem; }
p { margin: .4rem 0; } .dim { color: #59636e; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; width: 100%; min-width: 44rem; font-size: .9rem; }
th { text-align: left; color: #59636e; } th, td { padding: .45rem .8rem .45rem 0; border-top: 1px solid #d1d9e0;
  vertical-align: top; } td:first-child { white-space: nowrap; font-weight: 600; }
td small { display: block; color: #59636e; } .green { color: #1a7f37; } .yellow { color: #9a6700; }
.red { color: #cf222e; } img { width: 100%; height: auto; }
"""


def verdicts(claims: Sequence[Claim]) -> str:
    """How many claims hold, in one line."""
    counted = Counter(claim.verdict for claim in claims)
    parts = [f"{verdict}: {counted[verdict]}" for verdict in COLOURS if counted[verdict]]
    return f"{len(claims)} claims; {', '.join(parts)}"


def table(claims: Sequence[Claim], width: int = 160) -> Table:
    """The claims for a terminal of ``width`` columns; a narrow one leaves out how they were tested."""
    out = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0), leading=1)
    wide = width >= WIDE
    out.add_column("verdict", no_wrap=True)
    for heading, ratio in ("claim", 3), *([("how tested", 4)] if wide else []), ("measured", 4):
        out.add_column(heading, ratio=ratio)
    for claim in claims:
        texts = (f"{claim.claim} ({claim.source})", *([claim.test] if wide else []), claim.measured)
        out.add_row(Text(claim.verdict, style=COLOURS[claim.verdict]), *map(Text, texts))
    return out


def markdown(claims: Sequence[Claim]) -> str:
    """The claims as a Markdown table."""
    lines = ["| claim | where | how tested | measured | verdict |", "|---|---|---|---|---|"]
    for claim in claims:
        cells = (claim.claim, claim.source, claim.test, claim.measured, f"**{claim.verdict}**")
        lines.append(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |")
    return "\n".join(["# What became of the paper's claims", "", INTRODUCTION, "", *lines, ""])


def data(claims: Sequence[Claim]) -> dict[str, Any]:
    """The claims for programs."""
    return {"claims": [claim._asdict() for claim in claims]}


def html(claims: Sequence[Claim], plates: Sequence[Plate], pictures: Mapping[str, bytes], note: str) -> str:
    """One page that holds everything.

    Args:
        claims: of the paper.
        plates: in order.
        pictures: their PNG files by name.
        note: how and on what it was run.
    """
    rows = [
        f'<tr><td class="{COLOURS[claim.verdict]}">{escape(claim.verdict)}</td>'
        f"<td>{escape(claim.claim)}<small>{escape(claim.source)}</small></td>"
        f"<td>{escape(claim.test)}</td><td>{escape(claim.measured)}</td></tr>"
        for claim in claims
    ]
    figures = [
        f'<h2>{escape(plate.title)}</h2><img alt="{escape(plate.title, quote=True)}" '
        f'src="data:image/png;base64,{base64.b64encode(pictures[plate.file]).decode()}"><p>{escape(plate.caption)}</p>'
        for plate in plates
    ]
    return "\n".join([
        '<!doctype html><html lang="en"><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1"><title>Reproduction</title>',
        f"<style>{STYLE}</style><h1>Section 5.3 of the paper, reproduced</h1>",
        f'<p>{escape(INTRODUCTION)}</p><p class="dim">{escape(note)}</p>',
        f'<h2>{escape(verdicts(claims))}</h2><div class="scroll"><table>',
        "<tr><th>verdict</th><th>claim</th><th>how tested</th><th>measured</th></tr>", *rows, "</table></div>",
        *figures, "",
    ])  # fmt: skip
