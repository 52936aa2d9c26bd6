"""Evaluation: paired episodes, the table, and what of it a run folder keeps."""

import csv
import io
import json

import numpy as np
import pytest
import yaml
from report_runs import leave_run
from rich.console import Console

from sffr_baselines import make_policy
from sffr_baselines.rollout import rollout
from sffr_gym import ConfigError, load_params
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.metrics import MEASURES, measure
from sffr_gym.task.scenario import load_scenario
from sffr_gym.task.score import costs
from sffr_workbench.cli.evaluate import chosen_episodes
from sffr_workbench.evaluation import (
    COLUMNS,
    Evaluation,
    Recording,
    evaluate,
    open_run,
    read_episodes,
    run_folder,
    summary_remarks,
    summary_table,
    with_oracles,
    write_run,
)

SEED = 1_000_003
POLICIES = ["none", "hsc", "ahsc"]


@pytest.fixture(scope="module")
def evaluation(swinging):
    """Three policies on the same three episodes."""
    return evaluate(POLICIES, swinging, episodes=3, seed=SEED)


@pytest.fixture(scope="module")
def failing(swinging):
    """One policy that fails and one that does not."""
    return evaluate(["hsc", "random"], swinging, episodes=2, seed=SEED, overrides=["limits.position=0.05"])


def printed(evaluation, width):
    """The table's lines on a terminal of that width."""
    console = Console(width=width, record=True, file=io.StringIO())
    console.print(summary_table(evaluation, width))
    return console.export_text().splitlines()


def test_every_policy_gets_the_same_episodes(evaluation):
    for i in range(3):
        draws = [evaluation.results[policy][i].drawn for policy in POLICIES]
        assert draws[0] and draws[0] == draws[1] == draws[2]
        assert {evaluation.results[policy][i].seed for policy in POLICIES} == {SEED + i}
    assert len({result.drawn["panel0_mode1_tip_m"] for result in evaluation.results["none"]}) == 3
    starts = [evaluation.first[policy].p[0].tolist() for policy in POLICIES]
    assert starts[0] == starts[1] == starts[2]


def test_each_episode_is_the_rollout_of_its_seed(evaluation, swinging):
    env = SFFRFlexEnv(scenario=swinging)
    for i in range(3):
        trajectory = rollout(env, make_policy("ahsc", env), SEED + i)
        assert evaluation.results["ahsc"][i].measures == measure(trajectory.signals, trajectory.period)


def test_summary_has_the_promised_keys_and_the_means(evaluation):
    summary = evaluation.summary()
    assert list(summary) == ["scenario", "scenario_hash", "episodes", "seed", "policies"]
    assert summary["scenario_hash"] == evaluation.scenario.hash(load_params())
    assert (summary["scenario"], summary["episodes"], summary["seed"]) == ("swinging", 3, SEED)
    assert list(summary["policies"]) == POLICIES
    for policy, means in summary["policies"].items():
        assert list(means) == list(MEASURES)
        for name, mean in means.items():
            episodes = [result.measures[name] for result in evaluation.results[policy]]
            assert mean == pytest.approx(sum(episodes) / 3, rel=1e-12)
            assert type(mean) is float


def test_number_of_episodes_follows_what_the_scenario_draws(user_scenario):
    quiet, drawing = user_scenario(duration=0.1), user_scenario(duration=0.1, offset_position=0.01)
    assert evaluate(["none"], quiet).episodes == 1
    assert evaluate(["none"], quiet, episodes=2).episodes == 2
    assert evaluate(["none"], drawing).episodes == 10


def test_overrides_reach_the_result(evaluation, swinging):
    stiffer = evaluate(["none"], swinging, episodes=1, seed=SEED, overrides=["panel.EI=30", "control.Kp=100"])
    assert stiffer.params.panel.EI == 30.0
    assert (
        stiffer.results["none"][0].measures["track_rmse"] > 2.0 * evaluation.results["none"][0].measures["track_rmse"]
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"policies": ["hcs"]}, "did you mean 'hsc'"),
        ({"policies": ["hsc", "hsc"]}, "given twice"),
        ({"policies": []}, "no policy"),
        ({"policies": ["hsc"], "scenario": "nominl"}, "did you mean 'nominal'"),
        ({"policies": ["hsc"], "episodes": 0}, "at least 1"),
        ({"policies": ["hsc"], "seed": -1}, "at least 0"),
        ({"policies": ["hsc"], "overrides": ["panel.mas=1"]}, "did you mean 'mass'"),
    ],
)
def test_errors_are_config_errors_that_help(arguments, message):
    with pytest.raises(ConfigError, match=message):
        evaluate(**arguments)


def test_progress_reaches_the_total_and_never_falls(swinging):
    seen = []
    evaluate(["none", "hsc"], swinging, episodes=2, seed=SEED, progress=lambda *report: seen.append(report))
    assert seen[0] == ("none", 0, 0)
    assert seen[-1] == ("hsc", 4000, 4000)
    done = [each[1] for each in seen]
    assert done == sorted(done)
    assert ("none", 1000, 4000) in seen and ("hsc", 3000, 4000) in seen


@pytest.mark.parametrize("width", [80, 100, 140])
def test_table_fits_the_terminal_uncut(evaluation, width):
    lines = printed(evaluation, width)
    assert max(map(len, lines)) <= width
    assert not any("…" in line for line in lines)
    rows = [line.split() for line in lines]
    assert [row[0] for row in rows if row and row[0] in POLICIES] == POLICIES
    shown = sum((column.always or width > 96) and column.measure in MEASURES for column in COLUMNS)
    assert all(len(row) == 1 + shown + 4 for row in rows if row and row[0] in POLICIES)


def test_table_shows_values_in_the_units_of_its_heading(evaluation):
    lines = printed(evaluation, 100)
    row = next(line for line in lines if line.startswith("none")).split()
    units = next(line for line in lines if line.startswith("policy")).split()
    means = evaluation.summary()["policies"]
    assert units[1] == "µm"
    assert float(row[1]) == pytest.approx(means["none"]["track_rmse"] * 1e6, rel=5e-3)
    assert units[3] == "mJ"
    assert float(row[3]) == pytest.approx(means["none"]["vibration"] * 1e3, rel=5e-3)
    assert float(row[-2]) == pytest.approx(costs(evaluation.results)["none"], rel=5e-3)


@pytest.fixture(scope="module")
def heavy(user_scenario):
    """HSC and no suppression with an object that is heavier than they believe."""
    file = user_scenario(duration=2.0, plant={"object": [10.0, 20.0]})
    return evaluate(["none", "hsc"], file, episodes=2, seed=SEED)


def test_a_wrong_model_stands_beside_the_right_one(heavy):
    """Where the plant is not the robot of the parameters, the table and the files show the law with either model."""
    assert list(heavy.results) == ["none", "hsc", "hsc-oracle"]
    means = heavy.summary()["policies"]
    assert means["hsc"]["track_rmse"] > 10.0 * means["hsc-oracle"]["track_rmse"]
    rows = [line.split()[0] for line in printed(heavy, 100) if line.strip()]
    assert {"hsc", "hsc-oracle"} <= set(rows)
    assert any("oracles know each episode's plant" in line for line in summary_remarks(heavy))
    columns = run_folder.episodes_csv([*heavy.results["hsc-oracle"]]).splitlines()[0].split(",")
    assert columns[-1] == "object_factor"


@pytest.mark.parametrize(
    ("given", "run"),
    [
        (["none", "hsc", "ahsc"], ["none", "hsc", "hsc-oracle", "ahsc", "ahsc-oracle"]),
        (["hsc", "hsc-oracle"], ["hsc", "hsc-oracle"]),
        (["random"], ["random"]),
    ],
)
def test_oracles_run_where_the_plant_is_not_the_known_one(given, run):
    """They stand behind their law, once, in scenarios of another plant alone."""
    assert with_oracles(given, load_scenario("mismatch")) == run
    assert with_oracles(given, load_scenario("degraded")) == given


def test_an_oracle_of_the_known_plant_is_its_law(swinging):
    """Where nothing differs, the right model changes nothing, bit for bit."""
    results = evaluate(["ahsc", "ahsc-oracle"], swinging, episodes=2, seed=SEED).results
    for left, right in zip(*results.values(), strict=True):
        assert left.measures == right.measures


def test_progress_counts_the_periods_of_each_episode(user_scenario):
    """Episodes of different lengths add up to the total, and the title does not claim one length for all."""
    file, seen = user_scenario(speed=[0.08, 0.12]), []
    found = evaluate(
        ["none"], file, episodes=2, seed=SEED, overrides=["path.radius=0.05"],
        progress=lambda _, done, total: seen.append((done, total)),
    )  # fmt: skip
    lengths = [round(result.measures["duration"] / 2e-3) for result in found.results["none"]]
    assert lengths[0] != lengths[1]
    assert seen[-1] == (sum(lengths), sum(lengths)) and [done for done, _ in seen] == sorted(done for done, _ in seen)
    assert any("2 episodes once around" in line for line in printed(found, 100))


def test_failures_are_counted_and_explained(failing):
    failures = [result.failure for result in failing.results["random"]]
    assert all(failures) and not any(result.failure for result in failing.results["hsc"])
    assert failing.summary()["policies"]["random"]["failed"] == 1.0
    row = next(line for line in printed(failing, 100) if line.startswith("random")).split()
    assert row[-1] == "2/2"
    assert row[-2] == row[-3] == "10.0"  # ratios, to hsc here
    assert any(line.startswith("random failed in") and failures[0] in line for line in summary_remarks(failing))


def test_run_folder_holds_what_was_evaluated(evaluation, tmp_path):
    files = leave_run(tmp_path / "new" / "run", evaluation, ["sffr", "evaluate", "none", "--set", "panel.EI=2 5"])
    recordings, files = files[: len(POLICIES)], files[len(POLICIES) :]
    assert [file.name for file in files] == ["episodes.csv", "manifest.json", "summary.json"]
    assert [file.name for file in recordings] == [f"{policy}.npz" for policy in POLICIES]
    folder = tmp_path / "new" / "run"
    there = {file for file in folder.rglob("*") if file.is_file()}
    assert there == {*recordings, *files, folder / "sffr-run.json", folder / ".sffr-run.lock"}
    assert set(open_run(folder).files) == {file.relative_to(folder).as_posix() for file in (*recordings, *files)}
    assert json.loads(files[2].read_text()) == evaluation.summary()

    with files[0].open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["policy"], int(row["seed"])) for row in rows] == [(p, SEED + i) for p in POLICIES for i in range(3)]
    for row in rows:
        result = evaluation.results[row["policy"]][int(row["seed"]) - SEED]
        assert {name: float(row[name]) for name in MEASURES} == result.measures
        assert {name: float(row[name]) for name in result.drawn} == result.drawn
        assert row["failure"] == "" and row["scenario"] == "swinging"
    assert read_episodes(tmp_path / "new" / "run") == [r for p in POLICIES for r in evaluation.results[p]]

    manifest = json.loads(files[1].read_text())
    assert manifest["command"] == "sffr evaluate none --set 'panel.EI=2 5'"
    assert manifest["config"] == load_params().to_dict()
    assert manifest["config_hash"] == load_params().hash()
    assert manifest["scenario_hash"] == evaluation.scenario.hash(load_params())
    assert manifest["scenario"]["panel_modes"] == [{"mode": 1, "amplitude": [0.05, 0.25]}]
    assert manifest["seeds"] == [SEED, SEED + 1, SEED + 2]
    assert {"python", "numpy", "numba", "gymnasium", "scipy", "sffr-gym"} == set(manifest["versions"])
    assert manifest["duration_s"] > 0.0 and manifest["started"].endswith("+00:00")
    assert {"platform", "git"} <= set(manifest)


def test_failures_are_in_the_episodes_file(failing):
    rows = list(
        csv.DictReader(run_folder.episodes_csv([*failing.results["hsc"], *failing.results["random"]]).splitlines())
    )
    assert [row["failure"] for row in rows] == [
        result.failure for policy in ("hsc", "random") for result in failing.results[policy]
    ]


def test_a_run_is_replaced_whole(evaluation, tmp_path):
    """What it wrote goes, also what the new one lacks; what others put beside it stays."""
    with RunFolder.claim(tmp_path, "evaluation") as run:
        write_run(run, evaluation, [], {"path.png": b"of the run before"})
    (tmp_path / "mine.png").write_bytes(b"somebody else's")
    leave_run(tmp_path, evaluation, [])
    assert not (tmp_path / "path.png").exists()
    assert (tmp_path / "mine.png").exists()


def test_evaluation_refers_to_the_first_policy_without_ahsc(evaluation, failing):
    assert isinstance(evaluation, Evaluation)
    assert (evaluation.reference, failing.reference) == ("ahsc", "hsc")


def test_chosen_episodes_are_recorded(tmp_path):
    """Any of them, in double precision, the first under the plain name; one that does not exist is refused."""
    short = load_scenario("excited").with_changes(duration=0.2)
    file = tmp_path / "short.yaml"
    file.write_text(yaml.safe_dump(short.model_dump(mode="json")))
    done = evaluate(["hsc", "ahsc"], file, episodes=4, seed=SEED, record=[1, 3])
    names = [f"recordings/{policy}{seed}.npz" for policy in ("hsc", "ahsc") for seed in ("", f"@{SEED + 3}")]
    assert list(done.recordings) == names
    assert {policy: trajectory.seed for policy, trajectory in done.first.items()} == {"hsc": SEED + 1, "ahsc": SEED + 1}
    for name, content in done.recordings.items():
        (tmp_path / "one.npz").write_bytes(content)
        recording = Recording.read(tmp_path / "one.npz")
        assert recording.seed == (SEED + 3 if "@" in name else SEED + 1) and recording.tips.dtype == np.float64
    np.testing.assert_array_equal(
        recording.tips, rollout(SFFRFlexEnv(file), make_policy("ahsc", done.params), SEED + 3).tips
    )
    assert len(evaluate(["hsc"], file, episodes=2, seed=SEED, record=None).recordings) == 2
    with pytest.raises(ConfigError, match="record 4: episodes count from 0 to 3"):
        evaluate(["hsc"], file, episodes=4, seed=SEED, record=[4])


@pytest.mark.parametrize(("text", "episodes"), [("0", [0]), ("7, 0,3", [0, 3, 7]), ("all", None)])
def test_episodes_to_record_are_a_list_or_all(text, episodes):
    """As --record takes them; anything else is refused."""
    assert chosen_episodes(text) == episodes
    for wrong in "", "x", "-1", "1,,2", "1.5":
        with pytest.raises(ConfigError, match="must be episodes counted from 0"):
            chosen_episodes(wrong)
