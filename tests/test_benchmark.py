"""The benchmark: the same rows with any number of workers, nothing finished is lost, pages follow the episodes."""

import io
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from report_runs import leave_run
from rich.console import Console
from typer.testing import CliRunner

from sffr_baselines import POLICIES
from sffr_baselines.settings import load_settings
from sffr_gym import ConfigError, load_params
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.task.scenario import scenario_names
from sffr_gym.task.score import costs
from sffr_workbench.benchmark import episodes
from sffr_workbench.benchmark.compare import common_episodes
from sffr_workbench.benchmark.episodes import Plan, run_episodes
from sffr_workbench.benchmark.figures import FIGURE_FILES
from sffr_workbench.benchmark.page import read_leaderboard
from sffr_workbench.benchmark.rows import ROWS
from sffr_workbench.benchmark.run import default_policies, run_benchmark
from sffr_workbench.benchmark.scores import score_suite
from sffr_workbench.cli.app import app
from sffr_workbench.cli.benchmark import print_scores
from sffr_workbench.evaluation import PLAN_FILE, evaluate, read_episodes

SEED = 1_000_000
BASELINES = (
    "none", "hsc", "ahsc", "ahsc-filtered", "hsc-tuned", "lqr", "ahsc-ff", "lqr-ff", "lqr-kf",
    "mpc", "ppf", "ppf-ff",
)  # fmt: skip
ROOT = Path(__file__).parents[1]
SWINGING = "name: swinging\ndescription: Swings.\nduration: {}\npanel_modes: [{{mode: 1, amplitude: [0.05, 0.25]}}]\n"
QUIET = "name: quiet\ndescription: Nothing is drawn.\nduration: 0.4\n"


@pytest.fixture(scope="module")
def suite(tmp_path_factory):
    """Two short scenarios, one of which draws nothing."""
    folder = tmp_path_factory.mktemp("suite")
    for name, text in (("swinging", SWINGING.format(0.4)), ("quiet", QUIET)):
        (folder / f"{name}.yaml").write_text(text)
    return tuple(str(folder / f"{name}.yaml") for name in ("swinging", "quiet"))


@pytest.fixture(scope="module")
def plan(suite):
    return Plan(("hsc", "ahsc", "random"), suite, 3, SEED, load_params())


@pytest.fixture(scope="module")
def serial(plan, tmp_path_factory):
    """All episodes, run one after the other in this process."""
    return episodes_of(plan, tmp_path_factory.mktemp("serial"), jobs=1)


def episodes_of(plan, folder, jobs, **options):
    """Run what a folder does not hold yet, and return all episodes."""
    with RunFolder.claim(folder, "benchmark", resume=True) as run:
        return run_episodes(plan, run, jobs, **options)


def die_in_the_middle(tasks, params, code, files):
    """Stand in for a worker's job: one episode kills its worker."""
    (task,) = tasks
    if (task.policy, task.seed) == ("ahsc", SEED + 1):
        os.kill(os.getpid(), signal.SIGKILL)
    return episodes.run_and_keep(tasks, params, code, files)


def kept(folder):
    """Finished episodes of a folder with the time of their writing."""
    return {file: file.stat().st_mtime_ns for file in (folder / ROWS).rglob("*.json")}


def test_plan_lists_every_episode_once(plan):
    assert len(plan.tasks) == len(set(plan.tasks)) == 3 * 3 + 3
    assert [task.seed for task in plan.tasks if task.policy == "hsc"] == [SEED, SEED + 1, SEED + 2, SEED]


def test_the_same_rows_with_any_number_of_workers(plan, serial, tmp_path):
    assert episodes_of(plan, tmp_path, jobs=2) == serial
    assert [(r.scenario, r.policy, r.seed) for r in serial] == [
        (Path(task.scenario).stem, task.policy, task.seed) for task in plan.tasks
    ]


def test_rows_are_those_of_an_evaluation(plan, serial, suite):
    evaluation = evaluate(plan.policies, suite[0], 3, SEED)
    assert [r for own in evaluation.results.values() for r in own] == [r for r in serial if r.scenario == "swinging"]


def test_dead_worker_loses_nothing_that_was_finished(plan, serial, tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(episodes, "run_and_keep", die_in_the_middle)
        with pytest.raises(ConfigError, match=r"worker process died .* with \d+ of 12 episodes finished") as error:
            episodes_of(plan, tmp_path, jobs=2)
    before = kept(tmp_path)
    assert 0 < len(before) < 12 and f"with {len(before)} of 12" in str(error.value)
    seen = []
    assert episodes_of(plan, tmp_path, jobs=2, progress=lambda *report: seen.append(report)) == serial
    assert {file: when for file, when in kept(tmp_path).items() if file in before} == before
    assert seen[0][1:] == (len(before), 12) and seen[-1][1:] == (12, 12)


def test_interrupted_run_goes_on(suite, tmp_path):
    """An interrupt in the middle of the command leaves only finished episodes, which the next call keeps."""
    scenario = tmp_path / "long.yaml"
    scenario.write_text(SWINGING.format(20.0))
    arguments = ["benchmark", "hsc", "ahsc", "-s", str(scenario), "-n", "16", "-j", "2", "--no-figures"]
    command = [sys.executable, "-m", "sffr_workbench.cli.app", *arguments, "-o", str(tmp_path / "run")]
    running = subprocess.Popen(
        command, cwd=ROOT, stderr=subprocess.PIPE, text=True, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # which jobs in the background ignore
    )  # fmt: skip
    while len(kept(tmp_path / "run")) < 4:
        assert running.poll() is None
        time.sleep(0.01)
    os.killpg(running.pid, signal.SIGINT)
    _, errors = running.communicate(timeout=60)
    before = kept(tmp_path / "run")
    assert running.returncode == 130 and "the same command goes on" in errors
    assert 4 <= len(before) < 32 and not list((tmp_path / "run").glob("results.md"))
    assert subprocess.run(command, cwd=ROOT, capture_output=True).returncode == 0
    after = kept(tmp_path / "run")
    assert len(after) == 32 and before.items() <= after.items()
    fresh = Plan(("hsc", "ahsc"), (str(scenario),), 16, SEED, load_params())
    assert read_episodes(tmp_path / "run") == episodes_of(fresh, tmp_path / "fresh", jobs=1)


def test_more_of_everything_runs_what_is_missing(plan, serial, suite, tmp_path):
    episodes_of(Plan(("hsc",), suite[:1], 2, SEED, plan.params), tmp_path, jobs=1)
    before = kept(tmp_path)
    assert episodes_of(plan, tmp_path, jobs=1) == serial
    assert before.items() <= kept(tmp_path).items()


def test_episodes_of_another_kind_are_not_mixed(plan, suite, tmp_path):
    episodes_of(plan, tmp_path, jobs=1)
    other = Plan(plan.policies, suite, 3, SEED, plan.params.with_overrides("panel.EI=25"))
    with pytest.raises(ConfigError, match=r"another config_hash.*--overwrite"):
        episodes_of(other, tmp_path, jobs=1)
    held = json.loads((tmp_path / PLAN_FILE).read_text())
    (tmp_path / PLAN_FILE).write_text(json.dumps(held | {"code": "of last week"}))
    with pytest.raises(ConfigError, match="another code"):
        episodes_of(plan, tmp_path, jobs=1)
    before = kept(tmp_path)
    episodes_of(plan, tmp_path, jobs=1, overwrite=True)
    assert not before.items() & kept(tmp_path).items()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"policies": ("hsc", "hcs")}, "did you mean 'hsc'"),
        ({"policies": ("hsc", "hsc")}, "given twice"),
        ({"scenarios": ()}, "no scenario given"),
        ({"scenarios": ("nominl",)}, "did you mean 'nominal'"),
        ({"episodes": 0}, "at least 1"),
        ({"seed": 999_999}, "evaluation seeds, from 1000000 up"),
    ],
)
def test_errors_are_config_errors_that_help(changes, message):
    whole = {"policies": ("ahsc",), "scenarios": ("nominal",), "episodes": 1, "seed": SEED, "params": load_params()}
    with pytest.raises(ConfigError, match=message):
        Plan(**whole | changes)


def test_scenarios_of_one_name_are_an_error(suite, tmp_path):
    twin = tmp_path / "twin.yaml"
    twin.write_text(QUIET)
    with pytest.raises(ConfigError, match="two scenarios are named 'quiet'"):
        Plan(("ahsc",), (suite[1], str(twin)), 1, SEED, load_params())


def test_score_needs_ahsc(suite, tmp_path):
    with pytest.raises(ConfigError, match="add it to the policies"):
        run_benchmark(Plan(("hsc",), suite, 1, SEED, load_params()), tmp_path, 1, ["sffr"])
    assert not list(tmp_path.iterdir())


def test_run_folder_and_pages(plan, serial, tmp_path):
    command = ["sffr", "benchmark", "--docs", "my docs"]
    table, written = run_benchmark(plan, tmp_path / "run", 1, command, docs=tmp_path / "docs")
    assert all(file.stat().st_size > 0 for file in written)
    assert read_episodes(tmp_path / "run") == serial
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text())
    assert manifest["suite"] == plan.suite and manifest["command"] == "sffr benchmark --docs 'my docs'"
    for folder in "run", "docs":
        page = (tmp_path / folder / "results.md").read_text()
        assert all(
            (tmp_path / folder / "images" / name).is_file() and f"images/{name}" in page for name in FIGURE_FILES
        )
        assert page.count("`sffr benchmark --docs 'my docs'`") == page.count("\n## ") + len(FIGURE_FILES)
        assert plan.suite in page
    board = read_leaderboard(tmp_path / "docs" / "leaderboard.json")
    assert {entry["policy"] for entry in board} == set(plan.policies)
    assert [entry["cost"] for entry in board] == sorted(entry["cost"] for entry in board)
    for entry in board:
        assert entry["suite"] == plan.suite and entry["version"]
        assert entry["cost"] == pytest.approx(table.overall[entry["policy"]].cost.value, rel=1e-5)


def test_compare_takes_what_runs_have_in_common(plan, serial, suite, tmp_path):
    run_benchmark(plan, tmp_path / "all", 1, ["sffr"], draw=False)
    leave_run(tmp_path / "one", evaluate(["none", "hsc"], suite[0], 2, SEED), ["sffr"])
    results = common_episodes([tmp_path / "all", tmp_path / "one"])
    assert {(r.scenario, r.seed) for r in results} == {("swinging", SEED), ("swinging", SEED + 1)}
    assert list(dict.fromkeys(r.policy for r in results)) == ["hsc", "ahsc", "random", "none"]
    table = score_suite(results)
    direct = evaluate(["none", "hsc", "ahsc"], suite[0], 2, SEED)
    for policy, cost in costs(direct.results).items():
        assert table.overall[policy].cost.value == pytest.approx(cost, rel=1e-12)


def test_compare_tells_apart_what_differs(suite, tmp_path):
    for name, gain in (("soft", 250), ("hard", 300)):
        evaluation = evaluate(["hsc", "ahsc"], suite[0], 2, SEED, overrides=[f"control.Kd={gain}"])
        leave_run(tmp_path / name, evaluation, ["sffr"])
    with pytest.raises(ConfigError, match=r"hard: scenario 'swinging' or its parameters are not those of .*soft"):
        common_episodes([tmp_path / "soft", tmp_path / "hard"])
    summary = json.loads((tmp_path / "soft" / "summary.json").read_text())
    hard = json.loads((tmp_path / "hard" / "summary.json").read_text())
    (tmp_path / "hard" / "summary.json").write_text(json.dumps(hard | {"scenario_hash": summary["scenario_hash"]}))
    names = {r.policy for r in common_episodes([tmp_path / "soft", tmp_path / "hard"])}
    assert names == {"hsc", "ahsc", "hsc@hard", "ahsc@hard"}


def test_commands_from_end_to_end(suite, tmp_path):
    out, options = str(tmp_path / "run"), ["-n", "2", "-j", "1", "--no-figures"]
    for policies in ["ahsc"], ["ahsc", "hsc"]:
        done = CliRunner().invoke(app, ["benchmark", *policies, *options, "-s", suite[0], "--out", out])
        assert done.exit_code == 0, done.output
        assert all(policy in done.output for policy in policies)
    compared = CliRunner().invoke(app, ["compare", out])
    assert compared.exit_code == 0 and "2 common episodes of swinging" in compared.output
    assert done.stdout.splitlines()[:4] == compared.stdout.splitlines()[:4]  # notes go to stderr
    rejected = CliRunner().invoke(app, ["compare", str(tmp_path)])
    assert rejected.exit_code == 2 and "holds no run of sffr evaluate or sffr benchmark" in rejected.stderr


def test_what_is_no_run_cannot_be_compared(tmp_path):
    with pytest.raises(ConfigError, match="holds no run of sffr evaluate or sffr benchmark"):
        common_episodes([tmp_path])


@pytest.mark.parametrize("width", [80, 100, 140])
def test_scores_fit_the_terminal_uncut(serial, width):
    console = Console(width=width, record=True, file=io.StringIO())
    renamed = [replace(r, policy="ahsc-filtered") if r.policy == "hsc" else r for r in serial]
    print_scores(console, score_suite(renamed))
    lines = console.export_text().splitlines()
    assert max(map(len, lines)) <= width and not any("…" in line for line in lines)
    assert sum(line.startswith(("ahsc-filtered ", "ahsc ", "random ")) for line in lines) == 3


def test_baselines_and_suite_are_those_of_the_task():
    assert default_policies() == (*BASELINES, "mpc-scheduled", "ppo", "sac") and set(default_policies()) < set(POLICIES)
    suite = "nominal excited offset fast payload mismatch noise degraded impulse weak patches thrust truth sprint slew"
    assert set(suite.split()) == set(scenario_names())


def leaderboard():
    return {entry["policy"]: entry for entry in read_leaderboard(ROOT / "docs" / "leaderboard.json")}


def test_published_leaderboard_is_of_this_suite():
    board = leaderboard()
    entry = board["ahsc"]
    plan = Plan(BASELINES, tuple(scenario_names()), entry["episodes"], entry["seed"], load_params())
    assert set(BASELINES) <= set(board)
    assert {entry["suite"] for entry in board.values()} == {plan.suite}
    assert entry["cost"] == 1.0 == entry["typical_cost"]
    assert set(entry["scenarios"]) == set(scenario_names())
    page = (ROOT / "docs" / "results.md").read_text()
    assert plan.suite in page and all(f"`{policy}`" in page for policy in board)


def test_published_numbers_are_those_of_a_run_nominal(tmp_path):
    check_published(("nominal",), BASELINES, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["excited", "mismatch", "noise"])
def test_published_numbers_are_those_of_a_run(scenario, tmp_path):
    check_published((scenario,), ("hsc", "ahsc", "lqr"), tmp_path)


def check_published(scenarios, policies, folder):
    """Run a part of the published suite again; another machine may differ in the last digits."""
    board = leaderboard()
    plan = Plan(policies, scenarios, board["ahsc"]["episodes"], board["ahsc"]["seed"], load_params())
    table = score_suite(episodes_of(plan, folder, jobs=1))
    for policy in policies:
        for scenario in scenarios:
            cost = table.single[scenario][policy].cost.value
            assert cost == pytest.approx(board[policy]["scenarios"][scenario], rel=1e-4)


def test_tuned_damping_beats_that_of_the_paper_where_it_was_tuned():
    found = load_settings("hsc-tuned").found
    assert found.cost < found.start_cost
    assert leaderboard()["hsc-tuned"]["scenarios"]["excited"] < leaderboard()["hsc"]["scenarios"]["excited"]
