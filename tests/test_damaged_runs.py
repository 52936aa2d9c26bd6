"""Run folders that somebody changed: each is refused in lines that name the file and what is wrong, or it works."""

import csv
import io
import json
import shutil
from math import inf, nan
from pathlib import Path

import pytest
from command_line import sffr

from sffr_gym import ConfigError, load_params
from sffr_gym.config.provenance import MANIFEST
from sffr_gym.config.run_folder import CARD, RunFolder
from sffr_gym.task.metrics import MEASURES
from sffr_gym.task.score import Result
from sffr_workbench.benchmark import Plan, common_episodes, read_leaderboard, run_episodes
from sffr_workbench.benchmark.page import LEADERBOARD_FILE
from sffr_workbench.benchmark.run import run_benchmark
from sffr_workbench.evaluation import (
    EPISODES_FILE,
    PLAN_FILE,
    SUMMARY_FILE,
    episodes_csv,
    evaluate,
    read_episodes,
    write_run,
)
from sffr_workbench.report.runs import read_run

ODD = (None, True, -1, 10**30, 1.5, -1e300, "", "x\x1b[2J", "no", [], {}, [[1]], {"a": 1}, nan, inf)
CELLS = ("", "nan", "inf", "-1", "1e999", "1_0", " 1", "x", "0x10", "\u0661", "true", "9" * 30, "[" * 999)


@pytest.fixture(scope="module")
def evaluation(user_scenario, tmp_path_factory):
    """A finished evaluation."""
    folder = tmp_path_factory.mktemp("damaged") / "evaluation"
    file = user_scenario("short", duration=0.4, panel_modes=[{"mode": 1, "amplitude": [0.05, 0.25]}])
    with RunFolder.claim(folder, "evaluation") as run:
        write_run(run, evaluate(["none", "ahsc"], file, 2), ["sffr", "evaluate"])
    return folder


@pytest.fixture
def run(evaluation, tmp_path):
    """A copy of it to change."""
    return Path(shutil.copytree(evaluation, tmp_path / "run"))


def rows_of(folder):
    with (folder / EPISODES_FILE).open(newline="") as file:
        return list(csv.reader(file))


def write_rows(folder, rows):
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    (folder / EPISODES_FILE).write_text(text.getvalue())


def refused(folder, read):
    """Whether a folder is refused as it should be; anything else but success fails the test."""
    try:
        read(folder)
    except ConfigError as error:
        lines = str(error).split("\n")
        assert all(str(folder) in line and len(line) < 600 + len(str(folder)) for line in lines), lines
        return True
    return False


def read_all(folder):
    """What report, compare and seeds read."""
    common_episodes([folder])
    read_run(folder)


def spots(value, key=()):
    """All places in plain values."""
    yield key
    for name, entry in (
        value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    ):
        yield from spots(entry, (*key, name))


def put(value, key, new):
    """A value with another one at a place."""
    if not key:
        return new
    copy = value.copy()
    copy[key[0]] = put(value[key[0]], key[1:], new)
    return copy


@pytest.mark.parametrize("name", [SUMMARY_FILE, MANIFEST, CARD])
def test_every_value_of_the_json_files_may_be_anything(run, name):
    value, bad = json.loads((run / name).read_text()), 0
    top = [key for key in spots(value) if key[:1] not in (("config",), ("scenario",), ("versions",)) or len(key) < 2]
    for key in top:
        for new in ODD:
            (run / name).write_text(json.dumps(put(value, key, new)))
            bad += refused(run, read_all)
    assert bad > 3 * len(top)
    (run / name).write_text(json.dumps(value))
    assert not refused(run, read_all)


def test_every_cell_of_the_episodes_may_be_anything(run):
    rows, bad = rows_of(run), 0
    for column in range(len(rows[0])):
        for line in 0, 2:
            for new in CELLS:
                write_rows(run, [*rows[:line], put(rows[line], [column], new), *rows[line + 1 :]])
                bad += refused(run, lambda folder: common_episodes([folder]))
    assert bad > len(rows[0]) * len(CELLS)


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("seed", "-1", "seed = -1: must be at least 0"),
        ("seed", "1.5", "seed = 1.5: must be a whole number"),
        ("vibration", "-1e-3", "vibration = -0.001: must be at least 0"),
        ("vibration", "nan", "vibration = 'nan': must be a number"),
        ("vibration", "", "vibration = null: must be a number where the episode did not fail"),
        ("track_rmse", "1e999", "track_rmse = inf: must be finite"),
        ("piezo_saturation", "1.01", "piezo_saturation = 1.01: must be at most 1"),
        ("failed", "1", "failed = 1.0: must be 0 with the failure ''"),
        ("failure", "tired", "failure = 'tired': must be one of '', "),
        ("scenario", "nominal", "scenario = 'nominal': must be one of short"),
        ("policy", "a\x1bb", "policy = 'a\\x1bb': must be text on one line"),
        ("panel0_mode1_tip_m", "much", "drawn.panel0_mode1_tip_m = 'much': must be a number"),
    ],
)
def test_episodes_that_cannot_be_are_refused(run, column, value, message):
    rows = rows_of(run)
    rows[2][rows[0].index(column)] = value
    write_rows(run, rows)
    with pytest.raises(ConfigError) as error:
        read_episodes(run)
    assert str(error.value).startswith(f"{run / EPISODES_FILE}:3: ") and message in str(error.value)


def test_episodes_are_there_once_and_for_every_policy(run):
    rows = rows_of(run)
    write_rows(run, [*rows, rows[1]])
    with pytest.raises(ConfigError, match=r"episodes\.csv:6: seed = 1000000: this policy's episode stands in line 2"):
        read_episodes(run)
    write_rows(run, rows[:-1])
    with pytest.raises(ConfigError, match=r"episodes\.csv: short: has no episode of ahsc with seed 1000001"):
        read_episodes(run)
    write_rows(run, rows[:1])
    with pytest.raises(ConfigError, match="holds no episode"):
        read_episodes(run)


def test_a_failed_episode_may_have_measures_that_are_not_finite(run):
    """They come back as NaN, whatever they were."""
    good = read_episodes(run)[0]
    bad = Result(
        good.scenario, good.policy, good.seed, good.measures | {"failed": 1.0, "track_max": inf}, "lost grasp", {}
    )
    (run / EPISODES_FILE).write_text(episodes_csv([bad]))
    (found,) = read_episodes(run)
    assert found.measures["track_max"] != found.measures["track_max"]
    assert {name: found.measures[name] for name in MEASURES if name != "track_max"} == {
        name: bad.measures[name] for name in MEASURES if name != "track_max"
    }


@pytest.mark.parametrize("name", [SUMMARY_FILE, MANIFEST, EPISODES_FILE, CARD, "recordings/ahsc.npz"])
@pytest.mark.parametrize("damage", ["cut", "empty", "zeros", "latin", "folder", "gone"])
def test_damaged_files_are_named(run, name, damage):
    file, content = run / name, (run / name).read_bytes()
    file.unlink()
    if damage == "folder":
        file.mkdir()
    elif damage != "gone":
        new = {"cut": content[: len(content) // 2], "empty": b"", "zeros": bytes(200), "latin": b"\xe9" + content}
        file.write_bytes(new[damage])
    harmless = name == "recordings/ahsc.npz" and damage in ("gone", "latin")  # an archive may begin with anything
    assert refused(run, read_all) == (not harmless)


def test_a_damaged_run_is_lines_on_stderr(run):
    """Whichever command reads it."""
    rows = rows_of(run)
    rows[1][rows[0].index("seed")] = "-3"
    write_rows(run, rows)
    for arguments in (["report", run], ["compare", run], ["seeds", run]):
        failed = sffr(*arguments)
        assert failed.exit_code == 2 and failed.stdout == ""
        assert failed.stderr.splitlines() == [
            f"error: {run / EPISODES_FILE}:2: seed = -3: must be at least 0 (of the episode)"
        ]


@pytest.fixture(scope="module")
def small_plan(user_scenario):
    """A benchmark of two episodes."""
    return Plan(("ahsc",), (user_scenario("short", duration=0.4, offset_position=0.01),), 2, 1_000_000, load_params())


@pytest.fixture
def scored(small_plan, tmp_path):
    """Its folder, finished."""
    run_benchmark(small_plan, tmp_path / "benchmark", 1, ["sffr", "benchmark"], draw=False)
    return tmp_path / "benchmark"


def go_on(plan):
    """What goes on with a benchmark."""

    def run(folder):
        with RunFolder.claim(folder, "benchmark", resume=True) as claimed:
            run_episodes(plan, claimed, jobs=1)

    return run


def test_rows_of_a_benchmark_that_are_damaged_are_named_before_anything_runs(scored, small_plan):
    first, second = sorted(scored.rglob("[0-9]*.json"))
    value = json.loads(first.read_text())
    for key in spots(value):
        for new in ODD:
            first.write_text(json.dumps(put(value, key, new)))
            before = second.stat().st_mtime_ns
            refused(scored, go_on(small_plan))
            assert second.stat().st_mtime_ns == before
    first.write_bytes(second.read_bytes())
    with pytest.raises(ConfigError, match=r"holds another episode .* remove the file, and the same command runs this"):
        go_on(small_plan)(scored)
    first.unlink()
    go_on(small_plan)(scored)
    assert json.loads(first.read_text()) == value


def test_plan_of_a_benchmark_may_hold_anything(scored, small_plan):
    value, bad = json.loads((scored / PLAN_FILE).read_text()), 0
    for key in spots(value):
        for new in ODD:
            (scored / PLAN_FILE).write_text(json.dumps(put(value, key, new)))
            bad += refused(scored, go_on(small_plan))
    assert bad > len(list(spots(value)))


def test_only_rows_that_are_ours_are_removed(scored, small_plan):
    """Starting again leaves files of others below ``rows``, and what lies behind links."""
    first, second = sorted(scored.rglob("[0-9]*.json"))
    (first.parent / "notes.txt").write_text("mine")
    (first.parent / "7.json").write_text('{"mine": 1}')
    (scored / "rows" / "mine").mkdir()
    (scored / "rows" / "mine" / "1.json").write_text("mine")
    elsewhere = scored.parent / "elsewhere"
    shutil.copytree(first.parent, elsewhere / "ahsc")
    (scored / "rows" / "link").symlink_to(elsewhere)
    before = first.stat().st_mtime_ns
    with RunFolder.claim(scored, "benchmark", overwrite=True) as run:
        run_episodes(small_plan, run, jobs=1, overwrite=True)
    assert first.stat().st_mtime_ns > before and second.is_file()
    assert {file.name for file in first.parent.iterdir()} == {"notes.txt", "7.json", first.name, second.name}
    assert (scored / "rows" / "mine" / "1.json").read_text() == "mine"
    assert len(list((elsewhere / "ahsc").iterdir())) == 4


def test_rows_of_others_are_not_taken(small_plan, tmp_path):
    """A folder of somebody else's with the names that ours have, and a link in the place of one."""
    for name in "rows", PLAN_FILE:
        folder = tmp_path / name
        (folder / name).mkdir(parents=True)
        with pytest.raises(ConfigError, match="is not empty and holds no run of sffr benchmark"):
            go_on(small_plan)(folder / ".")
    folder, elsewhere = tmp_path / "linked", tmp_path / "elsewhere"
    go_on(small_plan)(folder)
    elsewhere.mkdir()
    (own,) = (folder / "rows").iterdir()
    shutil.rmtree(own)
    own.symlink_to(elsewhere)
    with pytest.raises(ConfigError, match="leads out of the run folder"):
        go_on(small_plan)(folder)
    assert not list(elsewhere.iterdir())


def test_manifest_and_plan_of_a_benchmark_are_read_by_the_report(scored):
    for name in MANIFEST, PLAN_FILE:
        value, bad = json.loads((scored / name).read_text()), 0
        for key in value:
            for new in ODD:
                (scored / name).write_text(json.dumps(value | {key: new}))
                bad += refused(scored, read_all)
        assert bad > 3 * len(value)
        (scored / name).write_text(json.dumps(value))
    assert not refused(scored, read_all)


def test_leaderboards_are_read_with_care(scored):
    file = scored / LEADERBOARD_FILE
    assert [entry["policy"] for entry in read_leaderboard(file)] == ["ahsc"]
    value, bad = json.loads(file.read_text()), 0
    for key in spots(value):
        for new in ODD:
            file.write_text(json.dumps(put(value, key, new)))
            bad += refused(scored, lambda folder: read_leaderboard(folder / LEADERBOARD_FILE))
    assert bad > 5 * len(list(spots(value)))
