"""`sffr sweep`: every combination is the evaluation of that robot, runs once, and is refused before anything runs."""

import csv
from pathlib import Path

import pytest
from command_line import sffr

from sffr_gym import ConfigError, load_params
from sffr_workbench.benchmark.sweep import Axis, SweepPlan, read_axis
from sffr_workbench.evaluation import evaluate


def table(folder):
    with open(folder / "sweep.csv", newline="") as file:
        return list(csv.DictReader(file))


def test_rows_are_those_of_evaluations(short_swing, tmp_path):
    """Of each combination, with the same seeds; values stand as they were given."""
    axes = ["--over", "panel.EI=15,2e1", "--over", "suppression.B0=[0, 30, 90],[0, 60, 180]"]
    result = sffr("sweep", "hsc", "none", *axes, "-s", short_swing, "-n", "2", "-j", "2", "--out", tmp_path / "run")
    assert result.exit_code == 0, result.stderr
    rows = table(tmp_path / "run")
    assert len(rows) == 2 * 2 * 2 * 2
    assert {(row["panel.EI"], row["suppression.B0"]) for row in rows} == {
        (stiffness, damping) for stiffness in ("15", "2e1") for damping in ("[0, 30, 90]", "[0, 60, 180]")
    }
    for stiffness, damping in (("15", "[0, 30, 90]"), ("2e1", "[0, 60, 180]")):
        changes = [f"panel.EI={stiffness}", f"suppression.B0={damping}"]
        expected = evaluate(["hsc"], short_swing, 2, overrides=changes).results["hsc"]
        found = [
            float(row["vibration"])
            for row in rows
            if (row["panel.EI"], row["suppression.B0"], row["policy"]) == (stiffness, damping, "hsc")
        ]
        assert found == [each.measures["vibration"] for each in expected]
    assert len({row["vibration"] for row in rows if row["policy"] == "hsc"}) == 8
    assert "panel.EI" in result.stdout and "0/2" in result.stdout


def test_a_sweep_goes_on_with_what_is_missing(short_swing, tmp_path):
    """More values run alone; what is there stays, bit for bit and by its time."""
    scenario = tmp_path / "short.yaml"
    scenario.write_text(Path(short_swing).read_text())
    command = ["sweep", "hsc", "-s", scenario, "-n", "1", "-j", "1", "--out", tmp_path / "run"]
    assert sffr(*command, "--over", "panel.EI=15,20").exit_code == 0
    before = {file: file.stat().st_mtime_ns for file in (tmp_path / "run" / "rows").rglob("*.json")}
    assert len(before) == 2
    assert sffr(*command, "--over", "panel.EI=15,20,25").exit_code == 0
    after = {file: file.stat().st_mtime_ns for file in (tmp_path / "run" / "rows").rglob("*.json")}
    assert len(after) == 3 and before.items() <= after.items() and len(table(tmp_path / "run")) == 3
    refused = sffr(*command, "--over", "panel.mass=8,9")
    assert refused.exit_code == 2 and "holds a sweep of another axes" in refused.stderr
    scenario.write_text(scenario.read_text().replace("duration: 0.4", "duration: 0.6"))
    refused = sffr(*command, "--over", "panel.EI=15,20")
    assert refused.exit_code == 2 and "holds a sweep of another points" in refused.stderr
    assert sffr(*command, "--over", "panel.EI=15,20", "--overwrite").exit_code == 0


@pytest.mark.parametrize(
    ("text", "axis"),
    [
        ("panel.EI=15,20", Axis("panel.EI", ("15", "20"))),
        ("suppression.B0=[0, 1, 2],[3, 4, 5]", Axis("suppression.B0", ("[0, 1, 2]", "[3, 4, 5]"))),
        ("simulation.integrator=rk4", Axis("simulation.integrator", ("rk4",))),
    ],
)
def test_an_axis_is_read(text, axis):
    assert read_axis(text) == axis


@pytest.mark.parametrize(
    ("over", "message"),
    [
        ((), "a sweep needs --over"),
        (("panel.EI",), "must be a key and its values"),
        (("panel.EI=15,",), "must be a key and its values"),
        (("panel.EI=15,15",), "a value is given twice"),
        (("panel.EI=15", "panel.EI=20"), "each key once"),
        (("panel.EI=15,-1",), "panel.EI=-1: .*panel.EI"),
        (("panel.EJ=15",), "panel.EJ=15: .*did you mean"),
        (
            ("panel.EI=" + ",".join(map(str, range(1, 200))), "panel.mass=" + ",".join(map(str, range(1, 200)))),
            "at most",
        ),
    ],
)
def test_what_cannot_be_swept_is_told_before_anything_runs(over, message, short_swing):
    with pytest.raises(ConfigError, match=message):
        SweepPlan(tuple(map(read_axis, over)), ("hsc",), short_swing, 1, 1_000_000, load_params())
