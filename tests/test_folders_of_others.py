"""Commands in folders that hold anything of others: refused before anything runs, and nothing in them changes."""

import json
import shutil

import pytest
from command_line import sffr
from listing import listing
from project import ROOT

from sffr_gym.config.run_folder import CARD, KINDS, RunFolder
from sffr_workbench.benchmark.page import page_names
from sffr_workbench.cli import evaluate as evaluate_module
from sffr_workbench.speed.page import IMAGES

COMMANDS = {
    "evaluation": ["evaluate", "hsc"],
    "benchmark": ["benchmark", "ahsc", "-s", "nominal"],
    "verification": ["verify", "--section", "coupling"],
    "reproduction": ["reproduce"],
    "speed": ["bench", "--quick", "--only", "loop"],
}
FILES = (
    "path.png", "summary.json", "episodes.csv", "manifest.json", "recordings/hsc.npz", "rows/nominal/ahsc/1000000.json",
    "results.md", "verification.html", "claims.json", "bench.json", "images/benchmark-profiles.png",
)  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    """Somebody's folder with the names that our runs have."""
    for name in FILES:
        (tmp_path / "mine" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "mine" / name).write_text("mine")
    return tmp_path / "mine"


@pytest.mark.parametrize("overwrite", [(), ("--overwrite",)], ids=["plain", "overwrite"])
@pytest.mark.parametrize("kind", COMMANDS)
def test_a_folder_of_others_stays_as_it_is(folder, kind, overwrite):
    before = listing(folder)
    refused = sffr(*COMMANDS[kind], "--out", folder, *overwrite)
    assert refused.exit_code == 2
    assert refused.stderr.splitlines()[-1] == (
        f"error: {folder}: is not empty and holds no run of {KINDS[kind]} ({CARD} is missing); choose another folder "
        "with --out"
    )
    assert listing(folder) == before and not (folder / CARD).exists()


@pytest.mark.parametrize("kind", COMMANDS)
def test_a_run_of_another_command_stays_as_it_is(tmp_path, kind):
    other = next(each for each in COMMANDS if each != kind)
    with RunFolder.claim(tmp_path / "run", other) as run:
        run.replace({"summary.json": b"old"})
    before = listing(tmp_path / "run")
    refused = sffr(*COMMANDS[kind], "--out", tmp_path / "run", "--overwrite")
    assert refused.exit_code == 2 and f"holds a run of {KINDS[other]}, not of {KINDS[kind]}" in refused.stderr
    assert listing(tmp_path / "run") == before


@pytest.mark.parametrize("kind", [kind for kind in COMMANDS if kind != "benchmark"])
def test_a_finished_run_is_replaced_only_if_asked(tmp_path, kind):
    with RunFolder.claim(tmp_path / "run", kind) as run:
        run.replace({"summary.json": b"old"})
    refused = sffr(*COMMANDS[kind], "--out", tmp_path / "run")
    assert refused.exit_code == 2 and "holds a finished run; choose another folder with --out or" in refused.stderr


def test_names_that_will_be_written_are_checked_before_the_simulation(tmp_path, monkeypatch):
    """Those of figures too; without them the same folder will do."""
    with RunFolder.claim(tmp_path / "run", "evaluation") as run:
        run.replace({"summary.json": b"old"})
    (tmp_path / "run" / "forces.png").write_text("mine")

    def simulate(plan, progress):
        raise MemoryError("simulated")

    monkeypatch.setattr(evaluate_module, "run_evaluation", simulate)
    pytest.importorskip("matplotlib")
    refused = sffr("evaluate", "hsc", "--out", tmp_path / "run", "--overwrite")
    assert refused.exit_code == 2 and "forces.png: is there, and was not written by this run" in refused.stderr
    assert "simulated" in sffr("evaluate", "hsc", "--out", tmp_path / "run", "--overwrite", "--no-figures").stderr
    assert (tmp_path / "run" / "summary.json").read_text() == "old"


def test_pages_are_put_beside_files_of_others_but_not_over_them(tmp_path):
    (tmp_path / "docs").mkdir()
    for name in "index.md", "leaderboard.json":
        (tmp_path / "docs" / name).write_text("mine")
    refused = sffr("benchmark", "ahsc", "--out", tmp_path / "run", "--docs", tmp_path / "docs", "--no-figures")
    assert refused.exit_code == 2 and "leaderboard.json: is there, and was not written by this run" in refused.stderr
    assert not (tmp_path / "run").exists()
    assert {name: text for name, text in listing(tmp_path / "docs").items() if name != CARD} == {
        "index.md": b"mine", "leaderboard.json": b"mine",
    }  # fmt: skip


def test_pages_of_this_project_may_be_written_again(tmp_path):
    """By ``make results`` and ``sffr bench --doc docs/speed.md``: they are on the list of the folder."""
    shutil.copytree(ROOT / "docs", tmp_path / "docs", ignore=shutil.ignore_patterns("_build", "api"))
    listed = json.loads((tmp_path / "docs" / CARD).read_text())["files"]
    assert set(listed) == {*page_names(), f"{IMAGES}/work_precision.png"}
    assert all((tmp_path / "docs" / name).is_file() for name in listed)
    with RunFolder.claim(tmp_path / "docs", "pages", resume=True, shared=True) as run:
        run.check_names(listed)


@pytest.mark.parametrize("kind", COMMANDS)
def test_a_refused_command_leaves_no_folder(tmp_path, kind, monkeypatch):
    """Whatever it is refused for."""
    wrong = {
        "evaluation": ["--set", "panel.EI=-1"], "benchmark": ["--episodes", "0"], "verification": ["--section", "no"],
        "reproduction": ["--duration", "0"], "speed": ["--only", "no"],
    }[kind]  # fmt: skip
    assert sffr(*COMMANDS[kind], "--out", tmp_path / "run", *wrong).exit_code == 2
    assert not list(tmp_path.iterdir())
