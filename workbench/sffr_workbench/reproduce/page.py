"""The outcome for people and programs: the claims as table, Markdown and JSON, and one page with all figures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from rich.table import Table
from rich.text import Text

from sffr_workbench.common import markdown_table, png_uri, terminal_table
from sffr_workbench.reproduce.claims import FAILS, HOLDS, PARTLY, UNTESTED, Claim
from sffr_workbench.reproduce.paper_figures import CaptionedFigure

WIDE = 120  # columns of a terminal that has room for everything
VERDICT_COLOURS = {HOLDS: "green", PARTLY: "yellow", FAILS: "red", UNTESTED: "dim"}
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
    """Return how many claims hold, in one line."""
    counted = Counter(claim.verdict for claim in claims)
    parts = [f"{verdict}: {counted[verdict]}" for verdict in VERDICT_COLOURS if counted[verdict]]
    return f"{len(claims)} claims; {', '.join(parts)}"


def claims_table(claims: Sequence[Claim], width: int = 160) -> Table:
    """Return the claims for a terminal of ``width`` columns; a narrow one leaves out how they were tested."""
    out = terminal_table(leading=1)
    wide = width >= WIDE
    out.add_column("verdict", no_wrap=True)
    for heading, ratio in ("claim", 3), *([("how tested", 4)] if wide else []), ("measured", 4):
        out.add_column(heading, ratio=ratio)
    for claim in claims:
        texts = (f"{claim.claim} ({claim.source})", *([claim.test] if wide else []), claim.measured)
        out.add_row(Text(claim.verdict, style=VERDICT_COLOURS[claim.verdict]), *map(Text, texts))
    return out


def claims_markdown(claims: Sequence[Claim]) -> str:
    """Return the claims as Markdown."""
    head = ["claim", "where", "how tested", "measured", "verdict"]
    rows = [[each.claim, each.source, each.test, each.measured, f"**{each.verdict}**"] for each in claims]
    listed = markdown_table(head, rows, texts=range(len(head)))
    return "\n".join(["# What became of the paper's claims", "", INTRODUCTION, "", listed, ""])


def claims_data(claims: Sequence[Claim]) -> dict[str, Any]:
    """Return the claims for programs."""
    return {"claims": [claim._asdict() for claim in claims]}


def claims_page(
    claims: Sequence[Claim], figures: Sequence[CaptionedFigure], pngs: Mapping[str, bytes], note: str
) -> str:
    """Return one page of HTML that holds everything; written without Jinja, which the extra ``plot`` does not bring.

    Args:
        claims: of the paper.
        figures: in order.
        pngs: their files by name.
        note: how and on what it was run.
    """
    rows = [
        f'<tr><td class="{VERDICT_COLOURS[claim.verdict]}">{escape(claim.verdict)}</td>'
        f"<td>{escape(claim.claim)}<small>{escape(claim.source)}</small></td>"
        f"<td>{escape(claim.test)}</td><td>{escape(claim.measured)}</td></tr>"
        for claim in claims
    ]
    shown = [
        f'<h2>{escape(each.title)}</h2><img alt="{escape(each.title, quote=True)}" '
        f'src="{png_uri(pngs[each.file])}"><p>{escape(each.caption)}</p>'
        for each in figures
    ]
    return "\n".join([
        '<!doctype html><html lang="en"><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1"><title>Reproduction</title>',
        f"<style>{STYLE}</style><h1>Section 5.3 of the paper, reproduced</h1>",
        f'<p>{escape(INTRODUCTION)}</p><p class="dim">{escape(note)}</p>',
        f'<h2>{escape(verdicts(claims))}</h2><div class="scroll"><table>',
        "<tr><th>verdict</th><th>claim</th><th>how tested</th><th>measured</th></tr>", *rows, "</table></div>",
        *shown, "",
    ])  # fmt: skip
