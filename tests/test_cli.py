"""The command line: what it writes and prints, and what is an error."""

import json
import sys

import pytest
from command_line import sffr

from sffr_gym import load_params
from sffr_workbench.cli import verify
from sffr_workbench.verify import Check

FILES = [".sffr-run.lock", "episodes.csv", "manifest.json", "recordings", "sffr-run.json", "summary.json"]


@pytest.fixture(scope="module")
def scenario(user_scenario):
    """A scenario of 1 s."""
    return user_scenario("short", duration=1.0)


@pytest.fixture(autouse=True)
def wide(monkeypatch):
    """A terminal that wraps nothing."""
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("TERM", "dumb")


@pytest.fixture(scope="module")
def run(scenario, tmp_path_factory):
    """A run with its folder and output."""
    folder = tmp_path_factory.mktemp("runs") / "first"
    result = sffr("evaluate", "none", "ahsc", "-s", scenario, "-n", 2, "--out", folder, "--no-figures")
    assert result.exit_code == 0, result.output
    return folder, result


def test_run_folder_has_the_promised_files(run):
    folder, result = run
    assert sorted(file.name for file in folder.iterdir()) == FILES
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["scenario"], summary["episodes"], summary["seed"]) == ("short", 2, 1_000_000)
    assert list(summary["policies"]) == ["none", "ahsc"]
    assert len((folder / "episodes.csv").read_text().splitlines()) == 1 + 4
    assert "summary.json" in result.stdout


def test_manifest_has_the_command_as_typed(run, scenario):
    folder, _ = run
    command = json.loads((folder / "manifest.json").read_text())["command"]
    assert command == f"sffr evaluate none ahsc -s {scenario} -n 2 --out {folder} --no-figures"


def test_table_is_on_stdout_and_nothing_but_notes_on_stderr(run):
    _, result = run
    assert "vibr." in result.stdout and "cost" in result.stdout
    assert "vibr." not in result.stderr


def test_finished_run_is_not_overwritten(run, scenario):
    folder, _ = run
    before = (folder / "summary.json").read_bytes()
    rejected = sffr("evaluate", "hsc", "-s", scenario, "--out", folder, "--no-figures")
    assert rejected.exit_code == 2
    assert "--overwrite" in rejected.stderr
    assert (folder / "summary.json").read_bytes() == before


def test_overwrite_replaces(scenario, tmp_path):
    for policy in "none", "hsc":
        done = sffr("evaluate", policy, "-s", scenario, "-o", tmp_path, "--no-figures", "--overwrite")
        assert done.exit_code == 0
    assert list(json.loads((tmp_path / "summary.json").read_text())["policies"]) == ["hsc"]


def test_default_folder_is_named_by_scenario_and_time(scenario, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert sffr("evaluate", "none", "-s", scenario, "--no-figures").exit_code == 0
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.startswith("short-") and (folder / "summary.json").exists()


def test_parameters_and_overrides_reach_the_result(run, scenario, tmp_path):
    (tmp_path / "soft.yaml").write_text("panel: {EI: 15.0}\n")
    out = tmp_path / "out"
    options = ["--params", tmp_path / "soft.yaml", "--set", "control.Kp=100", "--set", "object.mass=5"]
    assert sffr("evaluate", "none", "-s", scenario, "-o", out, "--no-figures", *options).exit_code == 0
    manifest, summary = (json.loads((out / f"{name}.json").read_text()) for name in ("manifest", "summary"))
    assert manifest["config"]["panel"]["EI"] == 15.0
    assert manifest["config"]["control"]["Kp"] == 100.0
    assert manifest["config"]["object"]["mass"] == 5.0
    assert manifest["config_hash"] != load_params().hash()
    default = json.loads((run[0] / "summary.json").read_text())["policies"]["none"]
    assert summary["policies"]["none"]["tip_max"] != default["tip_max"]


def test_quiet_prints_nothing(scenario, tmp_path):
    done = sffr("evaluate", "none", "-s", scenario, "-o", tmp_path, "--no-figures", "--quiet", "--seed", 1)
    assert (done.exit_code, done.output) == (0, "")
    assert (tmp_path / "summary.json").exists()


def test_training_seed_is_allowed_with_a_note(scenario, tmp_path):
    done = sffr("evaluate", "none", "-s", scenario, "-o", tmp_path, "--no-figures", "--seed", 7)
    assert done.exit_code == 0
    assert "1000000" in done.stderr
    assert json.loads((tmp_path / "summary.json").read_text())["seed"] == 7


def test_no_figures_without_matplotlib_but_a_result(scenario, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    done = sffr("evaluate", "none", "-s", scenario, "-o", tmp_path)
    assert done.exit_code == 0
    assert "pip install 'sffr-gym[plot]'" in done.stderr
    assert sorted(file.name for file in tmp_path.iterdir()) == FILES


@pytest.mark.parametrize(
    ("arguments", "nearest"),
    [
        (["evaluat", "hsc"], "evaluate"),
        (["evaluate", "hsc", "--episods", "3"], "--episodes"),
        (["evaluate", "hcs"], "'hsc'"),
        (["evaluate", "hsc", "--scenario", "exited"], "'excited'"),
        (["evaluate", "hsc", "--set", "panel.masss=3"], "'mass'"),
        (["evaluate", "hsc", "--params", "sfr.yaml"], "'sffr'"),
    ],
)
def test_unknown_name_fails_with_the_nearest(arguments, nearest, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    failed = sffr(*arguments)
    assert failed.exit_code == 2
    assert nearest in failed.stderr
    assert failed.stdout == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--set", "panel.EI=-3"], ["panel.EI", "-3", "at least 1e-09"]),
        (["--set", "panel.EI=soft"], ["panel.EI", "soft", "number"]),
        (["--set", "initial.q.3=1.9"], ["initial.q", "grasp"]),
        (["--episodes", "0"], ["episodes", "at least 1"]),
        (["--seed", "-1"], ["seed", "at least 0"]),
    ],
)
def test_bad_value_fails_with_one_clear_line(arguments, words, tmp_path):
    failed = sffr("evaluate", "hsc", "--out", tmp_path / "run", *arguments)
    assert failed.exit_code == 2
    errors = [line for line in failed.stderr.splitlines() if line.startswith("error:")]
    assert len(errors) == 1
    assert all(word in errors[0] for word in words)
    assert not (tmp_path / "run").exists()


def test_bad_file_is_named_with_its_line(tmp_path):
    (tmp_path / "bad.yaml").write_text("panel:\n  EI: -1.0\n")
    failed = sffr("evaluate", "hsc", "--params", tmp_path / "bad.yaml", "--out", tmp_path / "run")
    assert failed.exit_code == 2
    assert f"{tmp_path / 'bad.yaml'}:2" in failed.stderr


def test_help_shows_defaults_policies_and_commands():
    overview, details = sffr("--help"), sffr("evaluate", "--help")
    assert overview.exit_code == details.exit_code == 0
    assert "evaluate" in overview.stdout
    for word in "nominal", "1000000", "ahsc-filtered", "--set", "--figures", "runs/<scenario>":
        assert word in details.stdout
    for shown in sffr(), sffr("evaluate"):
        assert "Usage" in shown.output


def test_version():
    assert sffr("--version").stdout.startswith("sffr-gym ")


def failed_check(**changes):
    check = Check("Rigid H", "Pinocchio", 2e-3, 1e-11, "", False, 0.5, "too far", section="Rigid part")
    return check._replace(**changes)


@pytest.fixture
def no_checks(monkeypatch):
    """Checks that need nothing and take no time; the list can be changed by a test."""
    pytest.importorskip("jinja2")
    pytest.importorskip("matplotlib")
    found = [failed_check(passed=True, error=1e-16), failed_check(name="Rigid C", passed=True, error=1e-16)]
    monkeypatch.setattr(verify, "missing_libraries", lambda sections: {})
    monkeypatch.setattr(verify, "run_checks", lambda quick, sections, progress: iter(found))
    return found


def test_verify_prints_a_table_and_writes_the_page(no_checks, tmp_path):
    done = sffr("verify", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    for word in "Rigid part", "Rigid H", "Rigid C", "Pinocchio", "1e-16", "1e-11", "all 2 checks passed, 1 s":
        assert word in done.stdout
    assert "Rigid H" in (tmp_path / "verification.html").read_text(encoding="utf-8")
    again = sffr("verify", "--out", tmp_path)
    assert again.exit_code == 2 and "--overwrite" in again.stderr
    assert sffr("verify", "--out", tmp_path, "--overwrite", "--quiet").output == ""


def test_verify_fails_with_a_failed_check_and_says_why(no_checks, tmp_path):
    no_checks.append(failed_check(name="Rigid x"))
    failed = sffr("verify", "--out", tmp_path)
    assert failed.exit_code == 1
    assert "FAIL Rigid x: too far" in failed.stdout and "1 of 3 checks failed" in failed.stdout
    assert (tmp_path / "verification.html").exists()


def test_verify_runs_a_section_alone(tmp_path):
    pytest.importorskip("jinja2")
    pytest.importorskip("matplotlib")
    done = sffr("verify", "--quick", "--section", "coupling", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    assert "Coupled solution" in done.stdout and "Rigid part" not in done.stdout


def test_verify_names_the_nearest_section(tmp_path):
    failed = sffr("verify", "--section", "rigd", "--out", tmp_path / "new")
    assert failed.exit_code == 2 and "'rigid'" in failed.stderr
    assert not (tmp_path / "new").exists()


def test_verify_without_its_libraries_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr(verify, "missing_libraries", lambda sections: dict.fromkeys(sections, "exudyn"))
    monkeypatch.setattr(verify, "PAGE_LIBRARIES", ("unheard_of",))
    failed = sffr("verify", "--out", tmp_path / "new")
    assert failed.exit_code == 2
    assert failed.stderr.splitlines() == ["error: not installed: unheard_of, exudyn; pip install 'sffr-gym[verify]'"]
    assert not (tmp_path / "new").exists()
