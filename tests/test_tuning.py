"""The tuning of laws: what it minimises, what it rejects, and the settings that it writes."""

import numpy as np
import pytest
from pydantic import ValidationError
from typer.testing import CliRunner

from sffr_baselines import make_policy
from sffr_baselines.settings import TUNED, FilterSettings, RegulatorWeights, TunedDamping, load_settings
from sffr_gym import ConfigError, load_params
from sffr_gym.config import strict_yaml as config
from sffr_gym.task.score import costs
from sffr_workbench.benchmark.tuning import Tuning, searched, tune_law, with_searched, write_settings
from sffr_workbench.cli.app import app
from sffr_workbench.common.numbers import format_number
from sffr_workbench.evaluation import evaluate


@pytest.fixture(scope="module")
def found(swinging):
    """A short search for the damping of HSC, and all settings that it tried."""
    tried = []
    tuning = tune_law("hsc-tuned", load_params(), [swinging], 2, 5, 9, lambda *report: tried.append(report))
    return tuning, tried


def test_best_settings_of_all_are_kept(found):
    tuning, tried = found
    assert (tried[0][0].q5, tried[0][0].q6) == pytest.approx((1.5, 5.0)) and tried[0][1] == pytest.approx(
        tuning.start_cost, rel=1e-9
    )
    assert tuning.evaluations == len(tried) - 2  # the rounded best and the start are run again in the end
    assert tuning.cost < tuning.start_cost
    assert tuning.cost == pytest.approx(min(cost for _, cost in tried), rel=1e-4)


def test_cost_is_that_of_an_evaluation(found, swinging):
    """The same episodes under HSC with the damping found as its B0, beside AHSC with the paper's."""
    tuning, _ = found
    changed = f"suppression.B0=[3500, {tuning.settings.q5}, {tuning.settings.q6}]"
    own = evaluate(["hsc"], swinging, 2, 5, overrides=[changed])
    reference = evaluate(["ahsc"], swinging, 2, 5)
    both = {"hsc": own.results["hsc"], "ahsc": reference.results["ahsc"]}
    assert tuning.cost == costs(both)["hsc"]


def test_search_repeats(found, swinging):
    assert tune_law("hsc-tuned", load_params(), [swinging], 2, 5, 9) == found[0]


def with_first_steps(start):
    """Which numbers may be half as large again."""
    within = []
    for k, numbers in enumerate(np.tile(searched(start), (len(searched(start)), 1))):
        numbers[k] *= 10.0**0.2
        try:
            with_searched(start, numbers)
        except ValidationError:
            within.append(False)
        else:
            within.append(True)
    return np.array(within)


@pytest.mark.parametrize("name", sorted(TUNED))
def test_every_law_with_settings_can_be_tuned(name, swinging):
    """The search moves each number, but one whose first step would leave its range."""
    tried = []
    count = len(searched(TUNED[name].start(load_params())))
    tune_law(name, load_params(), [swinging], 1, 0, count + 1, lambda settings, _: tried.append(searched(settings)))
    moved = np.abs(np.array(tried[1:]) / tried[0] - 1.0).max(axis=0) > 0.1
    within = with_first_steps(TUNED[name].start(load_params()))
    assert within.any() and moved[within].all()


def test_scenarios_count_alike(swinging, user_scenario):
    """Of several the mean."""
    other = user_scenario("other", duration=2.0, panel_modes=[{"mode": 1, "amplitude": [0.2, 0.2]}])
    alone = [tune_law("lqr", load_params(), [file], 1, 0, 3).start_cost for file in (swinging, other)]
    assert tune_law("lqr", load_params(), [swinging, other], 1, 0, 3).start_cost == pytest.approx(np.mean(alone))
    assert alone[0] != alone[1]


@pytest.mark.parametrize(
    ("seed", "episodes", "message"),
    [
        (999_999, 2, "training takes those from 0 to 999999"), (1_000_000, 1, "training takes those from 0 to 999999"),
        (-1, 3, "seed = -1: must be at least 0"), (0, 0, "episodes = 0: must be at least 1"),
    ],
)  # fmt: skip
def test_evaluation_seeds_are_rejected(seed, episodes, message, swinging):
    with pytest.raises(ConfigError, match=message):
        tune_law("lqr", load_params(), [swinging], episodes, seed)


def test_a_law_without_settings_is_rejected(swinging):
    with pytest.raises(ConfigError, match=r"law 'ahsc' has no settings to tune; hsc-tuned, lqr, mpc, ppf have"):
        tune_law("ahsc", load_params(), [swinging])


def test_zero_damping_is_no_start(swinging):
    with pytest.raises(ConfigError, match="must be positive to start from"):
        tune_law("hsc-tuned", load_params().with_overrides("suppression.B0=[1, 0, 1]"), [swinging])


def test_numbers_keep_their_places_and_ranges():
    """Tuples one after another; a share of the stiffness that would be unstable is no setting."""
    start = FilterSettings.start(load_params())
    assert searched(start).tolist() == [0.65, 0.5, 0.6, 0.65, 1.2, 1.15, 0.05]
    moved = with_searched(start, [0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
    assert (moved.gain, moved.damping, moved.frequency) == ((0.2, 0.3), (0.4, 0.5), (0.6, 0.7))
    assert moved.swing == 0.8
    with pytest.raises(ValidationError):
        with_searched(start, [1.0, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8])


@pytest.mark.parametrize(
    "settings",
    [
        TunedDamping(q5=1.25, q6=4.5), RegulatorWeights(effort=0.5, swing=0.1),
        FilterSettings(gain=(0.2, 0.3), damping=(0.4, 0.5), frequency=(1.1, 1.2), swing=0.1),
    ],
)  # fmt: skip
def test_written_settings_are_read_back(settings, tmp_path):
    tuning = Tuning("lqr", settings, 0.91234, 1.0, 40)
    file = write_settings(tmp_path / "tuned.yaml", tuning, "sffr tune-law --out 'a: #b'")
    read = config.build(type(settings), *config.read_mapping(file))
    assert read.model_copy(update={"found": None}) == settings
    assert (read.found.cost, read.found.start_cost) == (0.91234, 1.0)
    assert read.found.command == "sffr tune-law --out 'a: #b'" and "tried 40 settings" in file.read_text()


def test_policy_has_the_tuned_damping():
    """On q5 and q6, panel by panel; q4 keeps that of the parameters."""
    found = load_settings("hsc-tuned")
    params = load_params().with_overrides("suppression.coordinates=all", "control.period=5.0e-4")
    policy = make_policy("hsc-tuned", params)
    assert policy.initial_damping().tolist() == [[3500.0, found.q5, found.q6]] * 2
    assert not policy.law.suppression.Gamma.any()


def test_command_writes_its_settings(swinging, tmp_path):
    file = tmp_path / "new" / "tuned.yaml"
    arguments = ["tune-law", "hsc-tuned", "-s", swinging, "-n", "1", "--evaluations", "4", "--out", str(file)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    found = config.build(TunedDamping, *config.read_mapping(file))
    assert f"q5 {format_number(found.q5)}, q6 {format_number(found.q6)}: cost" in done.output.replace("\n", " ")


def test_command_says_what_is_wrong(tmp_path):
    taken = tmp_path / "mine.yaml"
    taken.write_text("a: 1")
    for arguments, message in (
        (["--seed", "1000000"], "training takes those from 0"),
        (["--out", str(tmp_path)], "is a folder"),
        (["--out", str(taken)], "is there already; choose another name with --out or add --overwrite"),
        (["--out", str(taken / "file.yaml")], "is not a folder"),
    ):
        done = CliRunner().invoke(app, ["tune-law", "lqr", *arguments])
        assert done.exit_code == 2 and message in done.stderr
