"""The claims of the paper: known answers, verdicts that follow the data, and the command from end to end."""

import dataclasses
import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from agents import cli
from agents.reproduce import adaptation, claims, more_figures, page, peers, piezo_figure, study
from agents.reproduce.claims import FAILS, HOLDS, PARTLY, UNTESTED
from agents.reproduce.study import ADAPTIVE, GAINS, STARTS, Case
from sffr_gym import load_params
from sffr_gym.model import pack
from sffr_gym.task import ERROR, JOINT, N_SIGNALS, SAT_JOINT, SAT_THRUST, THRUST
from verification import Check

SHORT = 2.0  # s


@pytest.fixture(scope="module")
def short():
    """A short study."""
    return study.run_study(SHORT)


def measures(**changed):
    usual = {"vibration": 1.0, "track_rmse": 1.0, "settling_time": 1.0, "duration": 100.0, "failed": 0.0}
    return usual | changed


def check(error, allowed=1.0):
    return Check("", "", error, allowed, "", error <= allowed, 0.0, "the note")


def compared(tips=None, proof=None, error=0.0):
    return peers.Peers(check(error), check(error), tips or {}, proof, () if tips else ("exudyn",))


# Studies


def test_cases_are_all_starts_and_gains_once():
    listed = study.cases()
    assert len(set(listed)) == len(listed) == 1 + len(STARTS) * (1 + len(ADAPTIVE) * len(GAINS))


def test_law_of_a_case_is_scaled_from_table_iv():
    law = study.with_law(load_params(), Case("ahsc", 0.1, 10.0)).suppression
    assert law.B0 == pytest.approx((350.0, 0.15, 0.5))
    assert law.Gamma == pytest.approx((7000.0, 100.0, 150.0))


@pytest.mark.parametrize(
    ("case", "words"),
    [(Case("hsc"), "hsc"), (Case("ahsc", 0.01), "ahsc from B(0)/100"), (Case("ahsc", 1.0, 10.0), "ahsc with 10 Gamma")],
)
def test_cases_are_described(case, words):
    assert study.describe(case) == words


def test_study_runs_the_full_law_at_half_a_millisecond(short):
    assert short.params.control.period == 5.0e-4
    hsc = short.trajectories[Case("hsc")]
    assert len(hsc.signals) == round(SHORT / 5.0e-4)
    np.testing.assert_array_equal(hsc.B_hat[-1], [[3500.0, 1.5, 5.0]] * 2)  # axial too
    np.testing.assert_allclose(short.trajectories[Case("hsc", 0.1)].B_hat[-1, 0], [350.0, 0.15, 0.5], rtol=1e-12)
    assert set(short.measures) == set(study.cases())
    assert short.bare.B_hat.shape[1] == 0


def test_workspace_holds_the_nine_task_coordinates(short):
    groups = study.workspace(short.trajectories[Case("ahsc")], short.model)
    assert sum(group.errors.shape[1] for group in groups) == 9
    for group in groups:
        assert group.errors.shape == group.rates.shape == (len(group.errors), len(group.labels))


def test_workspace_rates_are_derivatives_of_the_errors(short):
    trajectory = short.trajectories[Case("none")]
    late = trajectory.t > 0.5
    for group in study.workspace(trajectory, short.model):
        slopes = np.gradient(group.errors, trajectory.t, axis=0)[late][1:-1]
        np.testing.assert_allclose(group.rates[late][1:-1], slopes, atol=0.02 * np.abs(group.rates).max())


# The integral of the printed law


def test_printed_law_follows_the_deflection_and_the_filtered_one_does_not(short):
    taken = claims.accounts_of(short)
    assert adaptation.departure(taken["ahsc"]) < 1.0e-3
    assert adaptation.departure(taken["ahsc-filtered"]) > 0.1


def test_account_of_a_known_motion():
    """One coordinate after the other, so that the integrals can be done by hand."""
    leg = np.linspace(0.0, 1.0, 20_001)
    q = np.zeros((2 * len(leg), 1, 3))
    q[: len(leg), 0, 1], q[len(leg) :, 0, 1] = leg, 1.0
    q[len(leg) :, 0, 2] = 2.0 * leg
    law = SimpleNamespace(
        Gamma=np.array([1.0, 10.0, 15.0]), M_inv=np.array([[1.0, 0, 0], [0, 2.0, 0.5], [0, 0.5, 3.0]])
    )
    middle, step = (q[1:] + q[:-1]) / 2, np.diff(q, axis=0)
    change = np.concatenate([np.zeros((1, 1, 3)), np.cumsum(law.Gamma * step * (middle @ law.M_inv), axis=0)])
    trajectory = SimpleNamespace(
        t=np.arange(len(q)), obs=q[:, 0], fields={"elastic": SimpleNamespace(slice=slice(0, 3))}, B_hat=5.0 + change
    )
    taken = adaptation.account(trajectory, law)
    assert taken.change[-1, 0, 1] == pytest.approx(10.0 * 2.0 / 2)  # q6 was still zero while q5 moved
    assert taken.change[-1, 0, 2] == pytest.approx(15.0 * (0.5 * 2.0 + 3.0 * 4.0 / 2))
    assert taken.own[-1, 0] == pytest.approx([0.0, 10.0, 90.0])
    assert taken.potential[-1, 0] == pytest.approx((2.0 + 2 * 0.5 * 2.0 + 3.0 * 4.0) / 2)
    assert adaptation.departure(taken) < 1e-6
    trajectory.B_hat[-1] += 1.0
    assert adaptation.departure(adaptation.account(trajectory, law)) > 0.01


@pytest.mark.parametrize(("kept", "verdict"), [(0.0, FAILS), (0.5, HOLDS)])
def test_a_law_that_keeps_something_adapts(kept, verdict):
    potential = np.array([[0.0], [1.0], [0.0]])
    taken = adaptation.Account(potential + np.array([[0.0], [0.0], [kept]]), potential, np.zeros(0), np.zeros(0))
    assert claims.adaptation_lasts({"ahsc": taken}).verdict == verdict


# Verdicts


def test_grades():
    assert [claims.graded(True), claims.graded(False, True), claims.graded(False)] == [HOLDS, PARTLY, FAILS]


@pytest.mark.parametrize(
    ("printed", "filtered", "verdict"),
    [(0.5, 0.5, HOLDS), (0.5, 0.95, PARTLY), (1.01, 0.5, PARTLY), (0.95, 0.95, FAILS), (1.01, 1.05, FAILS)],
)
def test_damping_is_judged_against_hsc_from_the_same_start(printed, filtered, verdict):
    found = {
        Case("hsc", 0.1): measures(vibration=2.0), Case("hsc"): measures(vibration=1.0e-3),
        Case("ahsc", 0.1): measures(vibration=2.0 * printed),
        Case("ahsc-filtered", 0.1): measures(vibration=2.0 * filtered),
    }  # fmt: skip
    claim = claims.damping(found, 0.1, 1.0)
    assert claim.verdict == verdict
    assert claim.numbers == {"hsc_J": 2.0, "ahsc_J": 2.0 * printed, "ahsc-filtered_J": 2.0 * filtered}


def test_a_failed_run_damps_nothing():
    found = {Case("hsc"): measures(), Case("ahsc"): measures(vibration=0.1, failed=1.0)}
    found[Case("ahsc-filtered")] = measures(vibration=0.1, failed=1.0)
    assert claims.damping(found, 1.0, 1.0).verdict == FAILS


@pytest.mark.parametrize(("ratio", "verdict"), [(0.3, HOLDS), (0.8, PARTLY), (1.2, FAILS)])
def test_disturbance(ratio, verdict):
    found = {Case("none"): measures(track_rmse=10.0), Case("hsc"): measures()}
    assert claims.disturbance(found | {Case("ahsc"): measures(track_rmse=10.0 * ratio)}).verdict == verdict
    failed = claims.disturbance(found | {Case("ahsc"): measures(track_rmse=10.0 * ratio, failed=1.0)})
    assert failed.verdict == FAILS


@pytest.mark.parametrize(
    ("settled", "energy", "verdict"), [(5.0, 0.1, HOLDS), (50.0, 0.1, PARTLY), (5.0, 0.9, FAILS), (50.0, 0.9, FAILS)]
)
def test_oscillations(settled, energy, verdict):
    found = {Case("none"): measures(), Case("ahsc"): measures(settling_time=settled, vibration=energy)}
    assert claims.oscillations(found).verdict == verdict


@pytest.mark.parametrize(
    ("error", "rate", "verdict"), [(0.01, 0.01, HOLDS), (1.0, 0.01, PARTLY), (0.01, 1.0, PARTLY), (1.0, 1.0, FAILS)]
)
def test_convergence(error, rate, verdict):
    def group(left, other):
        course = np.ones((100, 2))
        return study.Workspace("base", "m", ("x", "y"), 1e-6 * step(course, left), 1e-6 * step(course, other))

    def step(course, left):
        course = course.copy()
        course[-10:] = -left
        return course

    claim = claims.convergence([group(error, rate)], [group(0.0, 0.0)])
    assert claim.verdict == verdict
    assert claim.numbers["error_left_base"] == pytest.approx(error)


def test_remaining_is_of_the_last_tenth_alone():
    course = np.zeros((100, 1))
    course[10], course[89], course[90] = -4.0, 3.0, 1.0
    assert claims.remaining(course) == 0.25
    assert claims.remaining(np.zeros((100, 1))) == 0.0


@pytest.mark.parametrize(
    ("signal", "verdict"), [(None, HOLDS), (SAT_THRUST, FAILS), (SAT_JOINT, FAILS)]
)  # one period at a limit is enough
def test_limits(signal, verdict):
    signals = np.zeros((1000, N_SIGNALS))
    signals[500, THRUST], signals[501, JOINT] = 42.0, 9.0
    if signal is not None:
        signals[700, signal] = 0.1
    claim = claims.limits(SimpleNamespace(signals=signals, failure=""), load_params())
    assert claim.verdict == verdict
    assert claim.numbers == {"thrust_max_N": 42.0, "joint_norm_max_Nm": 3.0}


@pytest.mark.parametrize(("error", "failure", "verdict"), [(1e-5, "", HOLDS), (0.1, "", FAILS), (1e-5, "torn", FAILS)])
def test_tracking(error, failure, verdict):
    signals = np.zeros((10, N_SIGNALS))
    signals[3, ERROR] = error
    trajectory = SimpleNamespace(signals=signals, failure=failure)
    assert claims.tracking(trajectory, load_params()).verdict == verdict


@pytest.mark.parametrize(("middle", "end", "verdict"), [(1.2, 1.2, HOLDS), (1.2, 1.0, PARTLY), (1.01, 1.0, FAILS)])
def test_adaptation_moves(middle, end, verdict):
    B = np.ones((3, 2, 3))
    B[1, 0, 1], B[2, 0, 1] = middle, end
    assert claims.adaptation_moves({"ahsc": B}).verdict == verdict


@pytest.mark.parametrize(
    ("tips", "verdict"),
    [({1: 0.005, 4: 0.002}, HOLDS), ({1: 0.1, 4: 0.002}, PARTLY), ({1: 0.1, 4: 0.1}, FAILS), ({}, UNTESTED)],
)
def test_fig5(tips, verdict):
    claim = claims.fig5(compared(tips))
    assert claim.verdict == verdict
    assert ("sffr verify" in claim.measured) and ("exudyn" in claim.measured) == (not tips)


@pytest.mark.parametrize(("proof", "verdict"), [(check(0.0), FAILS), (check(2.0), HOLDS), (None, UNTESTED)])
def test_proof(proof, verdict):
    assert claims.proof(compared(proof=proof)).verdict == verdict


@pytest.mark.parametrize(("error", "verdict"), [(0.5, HOLDS), (2.0, FAILS)])
def test_equations(error, verdict):
    assert claims.equations(compared(error=error)).verdict == verdict


@pytest.mark.parametrize(("error", "verdict"), [(0.5, PARTLY), (2.0, FAILS)])
def test_staggering_is_an_approximation_at_best(error, verdict):
    assert claims.staggering(compared(error=error)).verdict == verdict


def test_independent_codes_are_compared_for_real():
    found = peers.compare()
    assert found.equations.passed and found.equations.error > 0.0
    assert found.staggered.passed and found.staggered.error > 0.0
    assert bool(found.tips) == ("exudyn" not in found.missing and "mujoco" not in found.missing)


@pytest.mark.parametrize(("elapsed", "verdict"), [(0.1, HOLDS), (1.0, FAILS)])
def test_speed(elapsed, verdict):
    trajectory = SimpleNamespace(signals=np.zeros((1000, 1)), period=5.0e-4)
    assert claims.speed(elapsed, trajectory).verdict == verdict


def test_verdicts_change_with_the_data(short):
    """Exchanging HSC and AHSC from a hundredth of B(0) exchanges the verdict."""
    found = dict(short.measures)
    before = claims.damping(found, 0.01, 1.0)
    hsc, ahsc = found[Case("hsc", 0.01)], dict(found[Case("hsc", 0.01)])
    ahsc["vibration"] = 0.5 * hsc["vibration"]
    found |= {Case(policy, 0.01): ahsc for policy in ADAPTIVE}
    assert claims.damping(found, 0.01, 1.0).verdict == HOLDS
    found |= {Case(policy, 0.01): hsc for policy in ADAPTIVE}
    assert claims.damping(found, 0.01, 1.0).verdict == FAILS
    assert before.numbers["hsc_J"] == hsc["vibration"]


# Output


def test_claims_are_told_alike_everywhere():
    listed = [
        claims.Claim("first | claim", "sec. 1", "a < b", "3 \u00b5m", HOLDS, {"x": 3.0}),
        claims.Claim("second", "sec. 2", "test", "nothing", FAILS, {}),
    ]
    assert page.verdicts(listed) == "2 claims; holds: 1, does not hold: 1"
    text = page.markdown(listed)
    assert "first \\| claim" in text and text.count("\n| ") == 3
    assert page.data(listed)["claims"][0]["numbers"] == {"x": 3.0}
    html = page.html(listed, [], {}, "note")
    assert "a &lt; b" in html and "does not hold" in html and 'src="http' not in html
    assert len(page.table(listed, 200).columns) == len(page.table(listed, 80).columns) + 1


def test_growth_map_knows_the_paper_at_both_periods():
    """0.5 ms is stable with and without strain-rate damping, 2 ms with it alone."""
    B0 = load_params().suppression.B0[:1]
    periods = np.array([5.0e-4, 2.0e-3])
    damped = more_figures.growth_map(pack(load_params()), periods, B0)
    undamped = more_figures.growth_map(pack(load_params().with_overrides(more_figures.UNDAMPED)), periods, B0)
    assert damped.shape == (1, 2)
    assert (damped < 1.0).all()
    assert undamped[0, 0] < 1.0 < undamped[0, 1]


def test_patches_at_the_tip_hardly_reach_the_first_mode():
    params = load_params().with_overrides("panel.elements=8")
    held = {array: piezo_figure.held_displacement(params, array) for array in piezo_figure.ARRAYS}
    assert (held["generalized"] > held["patches"]).all() and (held["patches"] > held["tip"]).all()
    assert held["patches"][0] / held["tip"][0] > 100.0


def test_modes_share_the_beams_deflection():
    """A force at the tip of a clamped beam: w = F L^3 / 3 EI, the sum over its modes."""
    params = load_params().with_overrides("panel.elements=8", "actuators.piezo.moment=1.0e-9")
    whole = params.actuators.piezo.force * params.panel.length**3 / (3 * params.panel.EI)
    assert piezo_figure.held_displacement(params, "generalized").sum() == pytest.approx(whole, rel=1e-3)


def test_curvature_of_a_cubic_is_exact():
    places = np.linspace(0.0, 2.0, 5)
    nodes = np.column_stack([0 * places, places**3, 3 * places**2])
    x, curvature = piezo_figure.curvature_along(nodes, 2.0)
    np.testing.assert_allclose(curvature, 6 * x, atol=1e-12)


def run_command(*arguments):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "200")
        patch.setenv("TERM", "dumb")
        patch.setattr(sys, "argv", ["sffr", *map(str, arguments)])
        return CliRunner().invoke(cli.app, list(map(str, arguments)), prog_name="sffr")


@pytest.mark.slow
def test_command_leaves_pictures_claims_and_a_page(tmp_path):
    pytest.importorskip("matplotlib")
    folder = tmp_path / "out"
    result = run_command("reproduce", "--out", folder, "--duration", SHORT)
    assert result.exit_code == 0, result.output
    pictures = {file.name for file in folder.glob("*.png")}
    assert {f"fig{number:02d}.png" for number in range(6, 14)} < pictures
    assert {"stability.png", "adaptation_integral.png", "gains.png", "piezo_authority.png"} < pictures
    told = json.loads((folder / "claims.json").read_text())
    html = (folder / "index.html").read_text()
    assert html.count("data:image/png;base64,") == len(pictures)
    assert told["duration_s"] == SHORT and f"Cut to {SHORT:g} s" in html
    for claim in told["claims"]:
        assert claim["measured"].split("|")[0] in (folder / "claims.md").read_text()
    assert page.verdicts([claims.Claim(**claim) for claim in told["claims"]]) in result.stdout
    before = (folder / "claims.json").read_bytes()
    refused = run_command("reproduce", "--out", folder)
    assert refused.exit_code == 2 and "--overwrite" in refused.stderr
    assert (folder / "claims.json").read_bytes() == before


def test_command_refuses_without_matplotlib(tmp_path, monkeypatch):
    monkeypatch.setattr(cli, "find_spec", lambda name: None)
    result = run_command("reproduce", "--out", tmp_path / "out")
    assert result.exit_code == 2 and "sffr-gym[plot]" in result.stderr
    assert not (tmp_path / "out").exists()


def test_command_refuses_too_short_a_run():
    assert run_command("reproduce", "--duration", "0").exit_code == 2


def test_whole_study_can_be_judged(short):
    listed = claims.judge(short, compared({1: 0.1, 4: 0.001}, check(0.0)))
    assert {claim.verdict for claim in listed} <= {HOLDS, PARTLY, FAILS}
    assert all(np.isfinite(list(claim.numbers.values())).all() for claim in listed)
    assert dataclasses.is_dataclass(short) and len(listed) == 17
