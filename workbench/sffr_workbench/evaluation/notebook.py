"""An evaluation in a notebook: its table as HTML, its rows as a data frame."""

from __future__ import annotations

from html import escape
from typing import Any

from sffr_gym.task.metrics import MEASURES
from sffr_gym.task.score import REFERENCE, Results, costs
from sffr_workbench.common import format_number, prefixed_unit

SHOWN = ("track_rmse", "track_max", "vibration", "tip_max", "settling_time", "piezo_effort")


def rows_of(results: Results) -> list[dict[str, Any]]:
    """Return a mapping for each episode: scenario, policy, seed, every measure, failure, what was drawn."""
    return [
        {"scenario": each.scenario, "policy": each.policy, "seed": each.seed}
        | each.measures
        | {"failure": each.failure, "policy_file": each.file}
        | each.drawn
        for own in results.values()
        for each in own
    ]


def frame_of(results: Results) -> Any:
    """Return the rows as a ``pandas.DataFrame``; as a list of mappings where pandas is not installed."""
    rows = rows_of(results)
    try:
        import pandas  # optional
    except ModuleNotFoundError:
        return rows
    return pandas.DataFrame(rows)


def html_of(results: Results, title: str, remarks: list[str]) -> str:
    """Return the table of means, a row for each policy, and below it what to know besides."""
    means = {
        policy: {name: sum(r.measures[name] for r in own) / len(own) for name in SHOWN}
        for policy, own in results.items()
    }
    scaled = {name: prefixed_unit(MEASURES[name], max(abs(own[name]) for own in means.values())) for name in SHOWN}
    price = costs(results) if REFERENCE in results else {}
    heads = [
        "policy",
        *(f"{name.replace('_', ' ')} [{scaled[name][0]}]" for name in SHOWN),
        *(["cost"] if price else []),
    ]
    lines = [f"<caption>{escape(title)}</caption>", f"<tr>{''.join(f'<th>{escape(head)}</th>' for head in heads)}</tr>"]
    for policy, own in means.items():
        cells = [format_number(own[name] / scaled[name][1]) for name in SHOWN]
        cells += [format_number(price[policy])] if price else []
        failed = sum(bool(each.failure) for each in results[policy])
        name = f"{policy} ({failed} failed)" if failed else policy
        lines.append(f"<tr><th>{escape(name)}</th>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>")
    below = "".join(f"<div><small>{escape(remark)}</small></div>" for remark in remarks)
    return f"<table>{''.join(lines)}</table>{below}"
