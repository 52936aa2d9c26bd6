"""Tables of the report on made-up episodes whose answers are known."""

from dataclasses import replace

import numpy as np
import pytest
from report_runs import made_up, made_up_run

from sffr_gym import ConfigError
from sffr_gym.config.run_folder import RunFolder
from sffr_workbench.evaluation.records import Git
from sffr_workbench.report.runs import embedded_figures, score_table

PICTURE = b"\x89PNG\r\n\x1a\n and what follows"


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


def test_a_table_has_all_measures_but_those_of_an_arrival_that_nobody_had():
    """Vibration first; what is left after an arrival stands where somebody arrived."""
    group = {"ahsc": [made_up("ahsc", 1e-3)], "none": [made_up("none", 3e-3)]}
    titles = [title for title, _ in score_table("s", group).heads]
    assert titles[:2] == ["cost", "vibration"] and {"tracking, largest", "settled after", "thrust impulse"} <= {*titles}
    arrived = replace(group["none"][0], measures=group["none"][0].measures | {"residual_tip": 0.25})
    table = score_table("s", group | {"none": [arrived]})
    assert {title for title, _ in table.heads} == {*titles, "tip after arrival"} and len(table.heads) == len(titles) + 1
    cells = {
        policy: row[[title for title, _ in table.heads].index("tip after arrival")] for policy, row, _ in table.rows
    }
    assert cells["none"].share == 1.0 and cells["ahsc"].share == 0.0


def test_shares_are_of_the_largest_that_is_a_number():
    """None of what has no end, nor where nothing is larger than 0, nor in a column without any number."""
    for energies, shares in (
        ((0.5, 0.25), (1.0, 0.5)), ((np.inf, 0.25), (0.0, 1.0)), ((np.nan, np.nan), (0.0, 0.0)),
        ((0.0, 0.0), (0.0, 0.0)),
    ):  # fmt: skip
        table = score_table("s", {name: [made_up(name, each)] for name, each in zip("ab", energies, strict=True)})
        assert tuple(cells[0].share for _, cells, _ in table.rows) == shares


def test_an_overview_counts_failures_and_leaves_what_a_policy_did_not_run_empty():
    ran = {"one": {"ahsc": 1e-3, "hsc": 2e-3}, "two": {"ahsc": 1e-3}, "three": {"ahsc": 1e-3, "hsc": 3e-3}}
    results = [
        replace(made_up(policy, energy, "lost" if policy == "hsc" else ""), scenario=name)
        for name, own in ran.items()
        for policy, energy in own.items()
    ]
    rows = {policy: (cells, failed) for policy, cells, failed in made_up_run("many", results).overview.rows}
    assert rows["ahsc"][1] == 0 and rows["hsc"][1] == 2
    assert [(cell.text, cell.share) for cell in rows["hsc"][0]] == [("9.55", 1.0), ("", 0.0), ("9.55", 1.0)]
    assert [cell.share for cell in rows["ahsc"][0]] == pytest.approx([1.0 / 9.55, 1.0, 1.0 / 9.55])


@pytest.mark.parametrize(
    ("git", "cpus", "commit", "machine"),
    [(None, None, "unknown", "? processors"),
     (Git(commit="0123456789abcdef", dirty=True), 2, "0123456789ab, with changes", "2 processors")],
)  # fmt: skip
def test_facts_say_what_is_known_of_code_and_machine(git, cpus, commit, machine):
    made = made_up_run("one", [made_up("ahsc", 1e-3)])
    facts = replace(made, manifest=made.manifest.model_copy(update={"git": git, "cpus": cpus})).facts
    assert facts["commit"] == commit and facts["machine"].endswith(f", {machine}") and facts["took"] == "1.00 s"


def figures_of(folder, files):
    """The figures of a run that has these files and one that is not its own."""
    with RunFolder.claim(folder, "evaluation") as run:
        run.replace(files)
        (folder / "forces.png").write_bytes(PICTURE)
        return embedded_figures(run)


def test_figures_are_those_of_the_run_that_are_still_there(tmp_path):
    """Each by the title of its file, those of a benchmark in a folder of their own; not what others put beside them."""
    names = ["tracking.png", "path.png", "images/benchmark-tradeoff.png"]
    titles = ["The robot on its path", "Tracking", "Vibration against effort"]
    assert [each.title for each in figures_of(tmp_path / "all", dict.fromkeys(names, PICTURE))] == titles
    found = figures_of(tmp_path / "one", {"path.png": PICTURE, "summary.json": b"{}"})
    assert [each.title for each in found] == titles[:1] and found[0].source.startswith("data:image/png;base64,iVBORw0K")
    (tmp_path / "all" / "path.png").unlink()
    assert [each.title for each in embedded_figures(RunFolder.open(tmp_path / "all"))] == titles[1:]


def test_a_figure_is_a_png_file_of_at_most_20_megabytes(tmp_path):
    assert len(figures_of(tmp_path / "large", {"path.png": PICTURE.ljust(20_000_000)})) == 1
    with pytest.raises(ConfigError, match=r"path\.png"):
        figures_of(tmp_path / "larger", {"path.png": PICTURE.ljust(20_000_001)})
    with pytest.raises(ConfigError, match=r"path\.png: is no PNG file, or is damaged"):
        figures_of(tmp_path / "other", {"path.png": b"GIF89a"})
