"""Tables of the report on made-up episodes whose answers are known."""

import numpy as np
from report_runs import made_up

from sffr_workbench.report.runs import score_table


def test_verdicts_and_units_of_scores():
    """The unit is that of the largest value of a policy that finished; where nothing swings nothing is compared."""
    wild = score_table("s", {"ahsc": [made_up("ahsc", 2e-3)], "hsc": [made_up("hsc", 5e3, "lost grasp")]})
    assert [unit for title, unit in wild.heads if title == "vibration"] == ["mJ"]
    lost = score_table("s", {"hsc": [made_up("hsc", 5e3, "lost grasp")]})
    assert [unit for title, unit in lost.heads if title == "vibration"] == ["J"]
    still = {"none": [made_up("none", 0.0)], "ahsc": [made_up("ahsc", 0.0)]}
    assert score_table("s", still).verdict == ""
    moving = still | {"none": [made_up("none", 0.5)]}
    assert score_table("s", moving).verdict == "ahsc leaves the panels without any vibration."
    odd = score_table("s", {"ahsc": [made_up("ahsc", np.nan)], "none": [made_up("none", 2.0)]})
    shares = {policy: [cell.share for cell in cells] for policy, cells, _ in odd.rows}
    at = [title for title, _ in odd.heads].index("vibration")
    assert (shares["ahsc"][at], shares["none"][at]) == (0.0, 1.0)


def test_the_cost_stands_first_where_ahsc_took_part():
    """In units of AHSC's; without it there is no such column."""
    group = {"ahsc": [made_up("ahsc", 1e-3)], "none": [made_up("none", 3e-3)]}
    table = score_table("s", group)
    assert table.heads[0] == ("cost", "ahsc = 1") and [title for title, _ in table.heads].count("cost") == 1
    assert [cells[0].text for _, cells, _ in table.rows] == ["1.00", "2.20"]
    assert "cost" not in [title for title, _ in score_table("s", {"none": group["none"]}).heads]
