"""Verdicts on the paper's claims: known answers, on both sides of every limit."""

from types import SimpleNamespace

import numpy as np
import pytest

from sffr_gym import load_params
from sffr_gym.task.signals import ERROR, JOINT, N_SIGNALS, SAT_JOINT, SAT_THRUST, THRUST
from sffr_workbench.reproduce import cases, claims, cross_checks
from sffr_workbench.reproduce.cases import Case
from sffr_workbench.reproduce.claims import FAILS, HOLDS, PARTLY, UNTESTED
from sffr_workbench.verify import Check


def measures(**changed):
    usual = {"vibration": 1.0, "track_rmse": 1.0, "settling_time": 1.0, "duration": 100.0, "failed": 0.0}
    return usual | changed


def check(error, allowed=1.0):
    return Check("", "", error, allowed, "", error <= allowed, 0.0, "the note")


def compared(tips=None, proof=None, error=0.0):
    return cross_checks.CrossChecks(check(error), check(error), tips or {}, proof, () if tips else ("exudyn",))


def test_grades():
    assert [claims.graded(True), claims.graded(False, True), claims.graded(False)] == [HOLDS, PARTLY, FAILS]


@pytest.mark.parametrize(
    ("printed", "filtered", "verdict"),
    [(0.5, 0.5, HOLDS), (0.5, 0.95, PARTLY), (1.01, 0.5, PARTLY), (0.95, 0.95, FAILS), (1.01, 1.05, FAILS)],
)
def test_damping_is_compared_with_hsc_from_the_same_start(printed, filtered, verdict):
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
        return cases.TaskErrors("base", "m", ("x", "y"), 1e-6 * step(course, left), 1e-6 * step(course, other))

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


@pytest.mark.slow  # `sffr verify` compares the same codes
def test_independent_codes_are_compared_for_real():
    found = cross_checks.run_cross_checks()
    assert found.equations.passed and found.equations.error > 0.0
    assert found.staggered.passed and found.staggered.error > 0.0
    assert bool(found.tips) == ("exudyn" not in found.missing and "mujoco" not in found.missing)


@pytest.mark.parametrize(("elapsed", "verdict"), [(0.1, HOLDS), (1.0, FAILS)])
def test_speed(elapsed, verdict):
    trajectory = SimpleNamespace(signals=np.zeros((1000, 1)), period=5.0e-4)
    assert claims.speed(elapsed, trajectory).verdict == verdict
