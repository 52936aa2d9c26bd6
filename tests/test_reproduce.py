"""The reproduction of the paper: its runs, verdicts that follow them, pictures, and the command from end to end."""

import dataclasses
import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from sffr_gym import load_params
from sffr_gym.physics.model import pack
from sffr_workbench.cli import app as cli
from sffr_workbench.common import extras
from sffr_workbench.reproduce import (
    adaptation,
    cases,
    claims,
    cross_checks,
    page,
    piezo_figure,
    stability_figure,
)
from sffr_workbench.reproduce.cases import ADAPTIVE, GAINS, STARTS, Case
from sffr_workbench.reproduce.claims import FAILS, HOLDS, PARTLY
from sffr_workbench.verify import Check

SHORT = 2.0  # s


@pytest.fixture(scope="module")
def short():
    """Short runs of all cases."""
    return cases.run_cases(SHORT)


# Cases


def test_cases_are_all_starts_and_gains_once():
    listed = cases.cases()
    assert len(set(listed)) == len(listed) == 1 + len(STARTS) * (1 + len(ADAPTIVE) * len(GAINS))


def test_law_of_a_case_is_scaled_from_table_iv():
    law = cases.with_law(load_params(), Case("ahsc", 0.1, 10.0)).suppression
    assert law.B0 == pytest.approx((350.0, 0.15, 0.5))
    assert law.Gamma == pytest.approx((7000.0, 100.0, 150.0))


@pytest.mark.parametrize(
    ("case", "words"),
    [(Case("hsc"), "hsc"), (Case("ahsc", 0.01), "ahsc from B(0)/100"), (Case("ahsc", 1.0, 10.0), "ahsc with 10 Gamma")],
)
def test_cases_are_described(case, words):
    assert cases.describe(case) == words


def test_cases_run_the_full_law_at_half_a_millisecond(short):
    assert short.params.control.period == 5.0e-4
    hsc = short.trajectories[Case("hsc")]
    assert len(hsc.signals) == round(SHORT / 5.0e-4)
    np.testing.assert_array_equal(hsc.B_hat[-1], [[3500.0, 1.5, 5.0]] * 2)  # axial too
    np.testing.assert_allclose(short.trajectories[Case("hsc", 0.1)].B_hat[-1, 0], [350.0, 0.15, 0.5], rtol=1e-12)
    assert set(short.measures) == set(cases.cases())
    assert short.bare.B_hat.shape[1] == 0


def test_errors_are_those_of_the_nine_task_coordinates(short):
    groups = cases.task_errors(short.trajectories[Case("ahsc")], short.model)
    assert sum(group.errors.shape[1] for group in groups) == 9
    for group in groups:
        assert group.errors.shape == group.rates.shape == (len(group.errors), len(group.labels))


def test_rates_are_derivatives_of_the_errors(short):
    trajectory = short.trajectories[Case("none")]
    late = trajectory.t > 0.5
    for group in cases.task_errors(trajectory, short.model):
        slopes = np.gradient(group.errors, trajectory.t, axis=0)[late][1:-1]
        np.testing.assert_allclose(group.rates[late][1:-1], slopes, atol=0.02 * np.abs(group.rates).max())


# The integral of the printed law


def test_printed_law_follows_the_deflection_and_the_filtered_one_does_not(short):
    taken = claims.adaptation_integrals(short)
    assert adaptation.departure(taken["ahsc"]) < 1.0e-3
    assert adaptation.departure(taken["ahsc-filtered"]) > 0.1


def test_integral_of_a_known_motion():
    """One coordinate after the other, so that the integrals can be done by hand."""
    leg = np.linspace(0.0, 1.0, 20_001)
    q = np.zeros((2 * len(leg), 1, 3))
    q[: len(leg), 0, 1], q[len(leg) :, 0, 1] = leg, 1.0
    q[len(leg) :, 0, 2] = 2.0 * leg
    law = SimpleNamespace(
        Gamma=np.array([1.0, 10.0, 15.0]), M_inv=np.array([[[1.0, 0, 0], [0, 2.0, 0.5], [0, 0.5, 3.0]]])
    )
    middle, step = (q[1:] + q[:-1]) / 2, np.diff(q, axis=0)
    change = np.concatenate([np.zeros((1, 1, 3)), np.cumsum(law.Gamma * step * (middle @ law.M_inv[0]), axis=0)])
    trajectory = SimpleNamespace(
        t=np.arange(len(q)), obs=q[:, 0], fields={"elastic": SimpleNamespace(slice=slice(0, 3))}, B_hat=5.0 + change
    )
    taken = adaptation.adaptation_integral(trajectory, law)
    assert taken.change[-1, 0, 1] == pytest.approx(10.0 * 2.0 / 2)  # q6 was still zero while q5 moved
    assert taken.change[-1, 0, 2] == pytest.approx(15.0 * (0.5 * 2.0 + 3.0 * 4.0 / 2))
    assert taken.own[-1, 0] == pytest.approx([0.0, 10.0, 90.0])
    assert taken.potential[-1, 0] == pytest.approx((2.0 + 2 * 0.5 * 2.0 + 3.0 * 4.0) / 2)
    assert adaptation.departure(taken) < 1e-6
    trajectory.B_hat[-1] += 1.0
    assert adaptation.departure(adaptation.adaptation_integral(trajectory, law)) > 0.01


@pytest.mark.parametrize(("kept", "verdict"), [(0.0, FAILS), (0.5, HOLDS)])
def test_a_law_that_keeps_something_adapts(kept, verdict):
    potential = np.array([[0.0], [1.0], [0.0]])
    taken = adaptation.AdaptationIntegral(
        potential + np.array([[0.0], [0.0], [kept]]), potential, np.zeros(0), np.zeros(0)
    )
    assert claims.adaptation_lasts({"ahsc": taken}).verdict == verdict


# Verdicts


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
    text = page.claims_markdown(listed)
    assert "first \\| claim" in text and text.count("\n| ") == 4
    assert page.claims_data(listed)["claims"][0]["numbers"] == {"x": 3.0}
    html = page.claims_page(listed, [], {}, "note")
    assert "a &lt; b" in html and "does not hold" in html and 'src="http' not in html
    assert len(page.claims_table(listed, 200).columns) == len(page.claims_table(listed, 80).columns) + 1


def test_growth_map_knows_the_paper_at_both_periods():
    """0.5 ms is stable with and without strain-rate damping, 2 ms with it alone."""
    B0 = load_params().suppression.B0[:1]
    periods = np.array([5.0e-4, 2.0e-3])
    damped = stability_figure.growth_map(pack(load_params()), periods, B0)
    undamped = stability_figure.growth_map(pack(load_params().with_overrides(stability_figure.UNDAMPED)), periods, B0)
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
    rejected = run_command("reproduce", "--out", folder)
    assert rejected.exit_code == 2 and "--overwrite" in rejected.stderr
    assert (folder / "claims.json").read_bytes() == before


def test_command_needs_matplotlib(tmp_path, monkeypatch):
    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    result = run_command("reproduce", "--out", tmp_path / "out")
    assert result.exit_code == 2 and "sffr-gym[plot]" in result.stderr
    assert not (tmp_path / "out").exists()


def test_too_short_a_run_is_an_error():
    assert run_command("reproduce", "--duration", "0").exit_code == 2


def test_all_claims_can_be_assessed(short):
    passed = Check("", "", 0.0, 1.0, "", True, 0.0, "the note")
    listed = claims.assess_claims(short, cross_checks.CrossChecks(passed, passed, {1: 0.1, 4: 0.001}, passed, ()))
    assert {claim.verdict for claim in listed} <= {HOLDS, PARTLY, FAILS}
    assert all(np.isfinite(list(claim.numbers.values())).all() for claim in listed)
    assert dataclasses.is_dataclass(short) and len(listed) == 17
