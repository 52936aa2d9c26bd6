"""The tuning of HSC: what it minimises, what it rejects, and the settings that it writes."""

import pytest
from typer.testing import CliRunner

from sffr_baselines import make_policy
from sffr_baselines.settings import TunedDamping, load_tuned_damping
from sffr_gym import ConfigError, load_params
from sffr_gym.config import strict_yaml as config
from sffr_gym.task.score import costs
from sffr_workbench.benchmark.tuning import Tuning, tune_hsc, write_damping
from sffr_workbench.cli.app import app
from sffr_workbench.evaluation import evaluate


@pytest.fixture(scope="module")
def found(swinging):
    """A short search, and every pair that it tried."""
    tried = []
    tuning = tune_hsc(load_params(), swinging, 2, 5, 9, lambda *report: tried.append(report))
    return tuning, tried


def test_best_pair_of_all_is_kept(found):
    tuning, tried = found
    assert tried[0][:2] == pytest.approx((1.5, 5.0)) and tried[0][2] == tuning.hsc_cost
    assert tuning.evaluations == len(tried) - 2  # the rounded best and B0 are run again in the end
    assert tuning.cost < tuning.hsc_cost
    assert tuning.cost == pytest.approx(min(cost for _, _, cost in tried), rel=1e-4)


def test_cost_is_that_of_an_evaluation(found, swinging):
    """The same episodes under HSC with the damping found as its B0, beside AHSC with the paper's."""
    tuning, _ = found
    own = evaluate(["hsc"], swinging, 2, 5, overrides=[f"suppression.B0=[3500, {tuning.q5}, {tuning.q6}]"])
    reference = evaluate(["ahsc"], swinging, 2, 5)
    both = {"hsc": own.results["hsc"], "ahsc": reference.results["ahsc"]}
    assert tuning.cost == costs(both)["hsc"]


def test_search_repeats(found, swinging):
    assert tune_hsc(load_params(), swinging, 2, 5, 9) == found[0]


@pytest.mark.parametrize(
    ("seed", "episodes", "message"),
    [
        (999_999, 2, "seeds 999999 to 1000000: training takes those from 0 to 999999"),
        (1_000_000, 1, "training takes those from 0 to 999999"),
        (-1, 3, "seed = -1: must be at least 0"),
        (0, 0, "episodes = 0: must be at least 1"),
    ],
)
def test_evaluation_seeds_are_rejected(seed, episodes, message, swinging):
    with pytest.raises(ConfigError, match=message):
        tune_hsc(load_params(), swinging, episodes, seed)


def test_zero_damping_is_no_start(swinging):
    with pytest.raises(ConfigError, match="must be positive to start from"):
        tune_hsc(load_params().with_overrides("suppression.B0=[1, 0, 1]"), swinging)


def test_written_settings_are_read_back(tmp_path):
    tuning = Tuning(1.25, 4.5, 0.91234, 1.0, 40)
    file = write_damping(tmp_path / "tuned.yaml", tuning, "sffr tune-hsc --out 'a: #b'")
    data, where = config.read_mapping(file)
    damping = config.build(TunedDamping, data, where)
    assert (damping.q5, damping.q6, damping.cost, damping.hsc_cost) == (1.25, 4.5, 0.91234, 1.0)
    assert damping.command == "sffr tune-hsc --out 'a: #b'" and "tried 40 pairs" in file.read_text()


def test_policy_has_the_tuned_damping():
    """On q5 and q6, panel by panel; q4 keeps that of the parameters."""
    found = load_tuned_damping()
    params = load_params().with_overrides("suppression.coordinates=all", "control.period=5.0e-4")
    policy = make_policy("hsc-tuned", params)
    assert policy.initial_damping().tolist() == [[3500.0, found.q5, found.q6]] * 2
    assert not policy.law.suppression.Gamma.any()


def test_command_writes_its_settings(swinging, tmp_path):
    file = tmp_path / "new" / "tuned.yaml"
    arguments = ["tune-hsc", "-s", swinging, "-n", "1", "--evaluations", "4", "--out", str(file)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    data, where = config.read_mapping(file)
    found = config.build(TunedDamping, data, where)
    assert f"q5 {found.q5} N s/m, q6 {found.q6} N m s/rad" in done.output


def test_command_says_what_is_wrong(tmp_path):
    taken = tmp_path / "mine.yaml"
    taken.write_text("a: 1")
    for arguments, message in (
        (["--seed", "1000000"], "training takes those from 0 to 999999"),
        (["--out", str(tmp_path)], "is a folder"),
        (["--out", str(taken)], "is there already; choose another name with --out or add --overwrite"),
        (["--out", str(taken / "file.yaml")], "is not a folder"),
    ):
        done = CliRunner().invoke(app, ["tune-hsc", *arguments])
        assert done.exit_code == 2 and message in done.stderr
