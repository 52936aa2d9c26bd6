"""The paper's claims: each with the test that it was put to, what was measured, and whether it holds.

Each function tests one claim on trajectories or measures alone, by the bounds below.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import NamedTuple

import numpy as np

from sffr_baselines.rollout import Trajectory
from sffr_gym.config.params import Params
from sffr_gym.task.signals import ERROR, JOINT, SAT_JOINT, SAT_THRUST, THRUST
from sffr_gym.types import Array
from sffr_workbench.common import plural
from sffr_workbench.reproduce.adaptation import AdaptationIntegral, adaptation_integral, departure
from sffr_workbench.reproduce.cases import ADAPTIVE, Case, CaseRuns, TaskErrors, adaptation_law, task_errors
from sffr_workbench.reproduce.cross_checks import CrossChecks

HOLDS, PARTLY, FAILS, UNTESTED = "holds", "holds in part", "does not hold", "not tested"

EXACT = 0.01  # rms difference from an independent code that still is "exact"
PERFECT = 1.0e-4  # of the circle's radius: tracking within it is "almost perfect"
GONE = 0.05  # of its largest value: an error below it at the end has "converged"
CLEARLY = 0.9  # of HSC's vibration energy: AHSC below it is "significantly" better
HALF = 0.5  # of the error without suppression: below it, it is "significantly eliminated"
CHANGED = 0.05  # of its start: a virtual damping that moves by more has "changed"
RETURNS = 0.05  # of the deflection's function: a damping that departs by less is one
CALM = 0.1  # of the circle, within which the oscillations have to be settled

Measures = Mapping[str, float]


class Claim(NamedTuple):
    """A claim and what became of it."""

    claim: str  #: in few words
    source: str  #: where the paper makes it
    test: str  #: how it was put to the test, bound included
    measured: str  #: in words
    verdict: str  #: ``HOLDS``, ``PARTLY``, ``FAILS`` or ``UNTESTED``
    numbers: dict[str, float]  #: what was measured, by name


def graded(whole: bool, part: bool = False) -> str:
    """Return the verdict for a claim that is met as a whole, in part, or not."""
    return HOLDS if whole else PARTLY if part else FAILS


def equations(checks: CrossChecks) -> Claim:
    """Test that the partitioned model has the accelerations of the whole robot."""
    check = checks.equations
    return Claim(
        "RFIM gives the exact motion of the whole robot", "abstract, sec. 2",
        "accelerations and inner forces, partitioned against one linear system of all coordinates with pins, at random "
        f"states and commands; at most {check.allowed:.0e}",
        f"largest relative difference {check.error:.1e}", graded(check.passed), {"difference": check.error},
    )  # fmt: skip


def staggering(checks: CrossChecks) -> Claim:
    """Test that the two portions are solved one after the other, step by step, as Fig. 1 draws it."""
    check = checks.staggered
    return Claim(
        "RFIM solves both portions step by step without loss", "sec. 2, Fig. 1",
        f"tips with Q_flex held over a step against all accelerations solved at once; slope of the error over the step "
        f"within {check.allowed:g} of 1 is an approximation of first order: in part",
        check.note.split(". ")[0], graded(False, check.passed), {"slope_from_1": check.error},
    )  # fmt: skip


def fig5(checks: CrossChecks) -> Claim:
    """Test that the tips move as those of an independent multibody code."""
    claim, source = "RFIM agrees exactly with an independent multibody code (Fig. 5)", "sec. 5.2"
    test = f"tips after a pulse on the base against Exudyn's cable elements, 20 s, rms; within {EXACT:.0%}"
    if not checks.tips:
        lacking = f"{', '.join(checks.missing)} not installed: pip install 'sffr-gym[verify]', or run sffr verify"
        return Claim(claim, source, test, lacking, UNTESTED, {})
    one, *more = checks.tips.values()
    words = [f"{value:.2%} with {plural(n, 'element')}" for n, value in checks.tips.items()]
    return Claim(
        claim, source, test, f"{', '.join(words)}; the paper's model has one element. More in sffr verify",
        graded(one < EXACT, min(more, default=inf) < EXACT),
        {f"difference_{n}_elements": value for n, value in checks.tips.items()},
    )  # fmt: skip


def tracking(trajectory: Trajectory, params: Params) -> Claim:
    """Test that the object follows its path."""
    largest, bound = float(trajectory.signals[:, ERROR].max()), PERFECT * params.path.radius
    return Claim(
        "AHSC performs the task with almost perfect tracking", "sec. 5.3, Figs. 8 and 9",
        f"largest position error of the object, all periods; below {1e3 * bound:.3g} mm, {PERFECT:g} of the radius",
        f"{1e6 * largest:.3g} \u00b5m" + (f"; ended: {trajectory.failure}" if trajectory.failure else ""),
        graded(largest < bound and not trajectory.failure), {"object_error_max_m": largest},
    )  # fmt: skip


def convergence(groups: list[TaskErrors], bare: list[TaskErrors]) -> Claim:
    """Test that errors and rates of the task coordinates vanish.

    Args:
        groups: under AHSC.
        bare: of the robot without panels, as a hint at what keeps the errors up.
    """
    errors = {group.name: remaining(group.errors) for group in groups}
    rates = {group.name: remaining(group.rates) for group in groups}
    left = {group.name: float(np.abs(_end(group.errors)).max()) for group in groups}
    rigid = max(float(np.abs(group.errors).max()) for group in bare)
    worst, slowest = max(errors.values()), max(rates.values())
    at = ", ".join(f"{name} {errors[name]:.0%} ({1e6 * left[name]:.2g} \u00b5{_unit(groups, name)})" for name in errors)
    return Claim(
        "The errors and their rates converge to zero", "sec. 5.3, Figs. 8 and 9",
        f"largest value in the last tenth of the run over the largest of all, nine task coordinates in four groups; "
        f"below {GONE:.0%}; in part: errors or rates alone",
        f"rates fall to {slowest:.1%} at most, errors to: {at}; without panels, whose pull the law does not know, "
        f"errors stay below {1e9 * rigid:.2g} nm or nrad",
        graded(max(worst, slowest) < GONE, min(worst, slowest) < GONE),
        {f"error_left_{_key(name)}": value for name, value in errors.items()}
        | {f"rate_left_{_key(name)}": value for name, value in rates.items()}
        | {"error_without_panels": rigid},
    )  # fmt: skip


def remaining(values: Array) -> float:
    """Return the largest magnitude in the last tenth of the rows (rows, k) over the largest of all; 0 if all vanish."""
    largest = float(np.abs(values).max(initial=0.0))
    return float(np.abs(_end(values)).max() / largest) if largest > 0.0 else 0.0


def damping(measures: Mapping[Case, Measures], start: float, gain: float) -> Claim:
    """Test that AHSC vibrates less than HSC from the same virtual damping.

    Args:
        measures: of the cases.
        start: factor of B(0).
        gain: factor of Gamma.
    """
    listed = [Case("hsc", start), *(Case(policy, start, gain) for policy in ADAPTIVE)]
    hsc, *others = (vibration(measures[case]) for case in listed)
    found = dict(zip(ADAPTIVE, others, strict=True))
    better = [value < CLEARLY * hsc for value in found.values()]
    words = ", ".join(f"{policy} {1e3 * value:.3g} mJ ({value / hsc:.2f})" for policy, value in found.items())
    settled = " / ".join(_settled(measures[case]) for case in listed)
    factor = "B(0)" if start == 1.0 else f"B(0)/{1.0 / start:g}"
    return Claim(
        f"AHSC damps significantly better than HSC: {factor}" + ("" if gain == 1.0 else f", {gain:g} Gamma"),
        "sec. 5.3, Fig. 6" if start == gain == 1.0 else "the same, varied",
        f"mean vibration energy under both adaptation laws over that of HSC from the same start; below {CLEARLY:g}",
        f"hsc {1e3 * hsc:.3g} mJ; {words}; settled: {settled}", graded(all(better), any(better)),
        {"hsc_J": hsc} | {f"{policy}_J": value for policy, value in found.items()},
    )  # fmt: skip


def vibration(measures: Measures) -> float:
    """Return the mean vibration energy of an episode [J]; infinite if it failed."""
    return inf if measures["failed"] else measures["vibration"]


def limits(trajectory: Trajectory, params: Params) -> Claim:
    """Test that thrusters and joints stay inside their limits in every control period."""
    signals, actuators = trajectory.signals, params.actuators
    force, torque = float(signals[:, THRUST].max()), float(np.sqrt(signals[:, JOINT].max()))
    busy = bool(signals[:, [SAT_THRUST, SAT_JOINT]].any()) or bool(trajectory.failure)
    return Claim(
        "The forces stay inside 100 N and 7 N m", "sec. 5.3, Figs. 10 and 11",
        f"no thruster at {actuators.thruster_force:g} N and no joint at {actuators.joint_torque:g} N m, all periods",
        f"|Fx| + |Fy| up to {force:.3g} N, root of the squared joint torques' sum up to {torque:.3g} N m",
        graded(not busy), {"thrust_max_N": force, "joint_norm_max_Nm": torque},
    )  # fmt: skip


def disturbance(measures: Mapping[Case, Measures]) -> Claim:
    """Test that suppression improves the tracking of the object."""
    none, ahsc = (measures[Case(policy)] for policy in ("none", "ahsc"))
    ratio = inf if ahsc["failed"] else ahsc["track_rmse"] / none["track_rmse"]
    return Claim(
        "Vibrations disturb the object; AHSC significantly eliminates that", "abstract, sec. 6",
        f"rms position error of the object over that without suppression; below {HALF:g}",
        f"{1e6 * none['track_rmse']:.3g} \u00b5m without, {1e6 * ahsc['track_rmse']:.3g} \u00b5m with AHSC "
        f"({ratio:.2f}), {1e6 * measures[Case('hsc')]['track_rmse']:.3g} \u00b5m with HSC",
        graded(ratio < HALF, ratio < 1.0),
        {"none_m": none["track_rmse"], "ahsc_m": ahsc["track_rmse"], "hsc_m": measures[Case("hsc")]["track_rmse"]},
    )  # fmt: skip


def oscillations(measures: Mapping[Case, Measures]) -> Claim:
    """Test that AHSC calms the panels that the start excites."""
    none, ahsc = (measures[Case(policy)] for policy in ("none", "ahsc"))
    settled, ratio = ahsc["settling_time"], vibration(ahsc) / none["vibration"]
    return Claim(
        "AHSC controls the oscillations of the excited panels", "sec. 5.3, Fig. 12",
        f"vibration energy below 5 % of its largest within {CALM:.0%} of the run, and less than half of that without",
        f"after {_settled(ahsc)}, without suppression {_settled(none)}; mean energy {ratio:.1%} of that without",
        graded(settled < CALM * ahsc["duration"] and ratio < HALF, ratio < HALF),
        {"settled_s": settled, "energy_ratio": ratio},
    )  # fmt: skip


def adaptation_moves(courses: Mapping[str, Array]) -> Claim:
    """Test that the virtual damping is changed by the adaptation.

    Args:
        courses: (rows, n_p, 3) virtual damping by policy.
    """
    words, numbers = [], {}
    for policy, B in courses.items():
        change = B / B[0] - 1.0
        numbers[f"{policy}_largest"] = float(np.abs(change).max())
        numbers[f"{policy}_end"] = float(np.abs(change[-1]).max())
        numbers[f"{policy}_axial"] = float(np.abs(change[..., 0]).max())
        words.append(
            f"{policy} moves B by up to {numbers[f'{policy}_largest']:.1%} and ends {numbers[f'{policy}_end']:.1%} away"
            f" (axial: {numbers[f'{policy}_axial']:.1g})"
        )
    printed = next(iter(courses))
    return Claim(
        "The adaptation changes the panels' virtual damping", "sec. 5.3, Fig. 7",
        f"largest change over its start, printed law; more than {CHANGED:.0%} at the end; in part: only before",
        "; ".join(words), graded(numbers[f"{printed}_end"] > CHANGED, numbers[f"{printed}_largest"] > CHANGED), numbers,
    )  # fmt: skip


def adaptation_lasts(integrals: Mapping[str, AdaptationIntegral]) -> Claim:
    """Test that the printed law keeps what it has learnt when the panel is straight again."""
    found = {policy: departure(integral) for policy, integral in integrals.items()}
    words = ", ".join(f"{policy} departs by {value:.2g} of it" for policy, value in found.items())
    return Claim(
        "Eq. 39 adapts the virtual damping to what is needed", "sec. 4",
        "the change of B over Gamma, summed over the coordinates, against q'M^-1 q/2 of the deflection, over the "
        f"latter's range; a law that adapts departs by more than {RETURNS:g}",
        f"{words}; without departure, B returns with the deflection, however long a panel shook",
        graded(next(iter(found.values())) > RETURNS), found,
    )  # fmt: skip


def proof(checks: CrossChecks) -> Claim:
    """Test that the proof of stability closes."""
    claim, source = "Stability and convergence of AHSC are proven", "sec. 4, sec. 6"
    test = "a positive definite rho of Eq. 29 for the printed output Y = e, solved for with SymPy"
    if checks.proof is None:
        return Claim(claim, source, test, "SymPy not installed: pip install 'sffr-gym[verify]'", UNTESTED, {})
    return Claim(
        claim, source, test,
        "there is none; with Y = e_dot + psi e and without M^-1 the proof closes for small psi (sffr verify)"
        if checks.proof.passed else checks.proof.note,
        graded(not checks.proof.passed), {"contradictions": checks.proof.error},
    )  # fmt: skip


def speed(elapsed: float, trajectory: Trajectory) -> Claim:
    """Test that the model is cheap enough for control."""
    duration = len(trajectory.signals) * trajectory.period
    return Claim(
        "The compact model demands little computation", "abstract, sec. 6",
        f"plant and law at {1e3 * trajectory.period:g} ms on one core, compiled; faster than real time",
        f"{duration:.4g} s in {elapsed:.2g} s: {duration / elapsed:.0f} times real time", graded(elapsed < duration),
        {"simulated_s": duration, "elapsed_s": elapsed},
    )  # fmt: skip


def assess_claims(runs: CaseRuns, checks: CrossChecks) -> list[Claim]:
    """Test all claims, in the order of the paper's argument."""
    ahsc, measures = runs.trajectories[Case("ahsc")], runs.measures
    groups, bare = task_errors(ahsc, runs.model), task_errors(runs.bare, runs.model)
    courses = {policy: runs.trajectories[Case(policy)].B_hat for policy in ADAPTIVE}
    variations = [(1.0, 1.0), (0.1, 1.0), (0.01, 1.0), (1.0, 10.0), (1.0, 100.0)]
    return [
        equations(checks), staggering(checks), fig5(checks), speed(runs.elapsed, ahsc),
        *(damping(measures, start, gain) for start, gain in variations),
        adaptation_moves(courses), adaptation_lasts(adaptation_integrals(runs)), proof(checks),
        tracking(ahsc, runs.params), convergence(groups, bare), limits(ahsc, runs.params),
        oscillations(measures), disturbance(measures),
    ]  # fmt: skip


def adaptation_integrals(runs: CaseRuns) -> dict[str, AdaptationIntegral]:
    """Return the integrals of both laws from the start of Table IV."""
    return {
        policy: adaptation_integral(runs.trajectories[Case(policy)], adaptation_law(runs.params, policy))
        for policy in ADAPTIVE
    }


def _end(values: Array) -> Array:
    return values[-max(len(values) // 10, 1) :]


def _settled(measures: Measures) -> str:
    time = measures["settling_time"]
    return f"{time:.3g} s" if time < measures["duration"] else "never"


def _key(name: str) -> str:
    return name.replace(" ", "_")


def _unit(groups: list[TaskErrors], name: str) -> str:
    return next(group.unit for group in groups if group.name == name)
