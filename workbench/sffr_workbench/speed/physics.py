"""The physics alone, against MuJoCo and SciPy, and the closed loop with AHSC over the circle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sffr_baselines import make_policy
from sffr_baselines.closed_loop import make_record
from sffr_baselines.laws import LawPolicy
from sffr_gym.types import Array
from sffr_workbench.speed.circle import Course, Loop, close_loop, drive, make_course
from sffr_workbench.speed.measure import Row, Section, one_core, rounds, seconds
from sffr_workbench.speed.mujoco_circle import MujocoPlant
from sffr_workbench.speed.scipy_circle import ScipyPlant

STEP = 2.0e-3  # s
RTOL = 1.0e-6  # of SciPy's methods
UNIT = "simulated s/s"
PERIODS, QUICK_PERIODS = 5000, 200  # that are compared
SLOW = 25  # SciPy drives so many times fewer


def physics(repeats: int, quick: bool) -> Section:
    """Measure simulated seconds per second of the plant alone, at steps of 2 ms, the object pinned, on one core."""
    periods = QUICK_PERIODS if quick else PERIODS
    course = make_course(periods * STEP)
    forces = close_loop(course)
    contenders: dict[str, Callable[[], float]] = {"ours": lambda: course_time(course) / drive(course, forces).seconds}
    for name in "RK4", "implicitfast":
        plant = MujocoPlant(course, name, STEP)
        _, recorded = plant.drive()
        contenders[name] = _mujoco(plant, recorded)
    few, scipy = forces[: max(periods // SLOW, 1)], {}
    for method in "DOP853", "Radau":
        scipy[method] = ScipyPlant(course, method, RTOL)
        contenders[method] = _scipy(scipy[method], few, course)
    with one_core():
        samples = rounds(contenders, repeats)
    names = {
        "ours": "sffr-gym, ETDRK4", "RK4": "MuJoCo, RK4", "implicitfast": "MuJoCo, implicitfast",
        "DOP853": f"SciPy, DOP853, rtol {RTOL:g}", "Radau": f"SciPy, Radau, rtol {RTOL:g}",
    }  # fmt: skip
    work = {
        key: f"{plant.evaluations / (len(few) * (repeats + 1)):.0f} evaluations of our equations per 2 ms"
        for key, plant in scipy.items()
    }
    rows = [
        Row(key, what, UNIT, samples[key], versus="" if key == "ours" else "ours", note=work.get(key, ""))
        for key, what in names.items()
    ]
    return Section("physics", "Physics alone: the robot with the pinned object, 2 ms, one core", rows, [
        "Forces are those of AHSC on the first part of the circle, held for 2 ms each. MuJoCo runs all steps in one "
        "call of its rollout, panels of 2 rigid segments, object held by connect constraints. SciPy starts again at "
        "each jump of the forces.",
    ])  # fmt: skip


def closed_loop(repeats: int, quick: bool) -> Section:
    """Measure simulated seconds per second of law and plant around the whole circle, on one core."""
    course = make_course(QUICK_PERIODS * STEP if quick else None)
    law, record = make_policy("ahsc", course.params), make_record(course.plant, course.ticks, 1)
    assert isinstance(law, LawPolicy)
    loop = Loop(course, course.plant, law.law, record)

    def once() -> float:
        return course_time(course) / seconds(loop)

    with one_core():
        samples = rounds({"ahsc": once}, repeats)["ahsc"]
    row = Row(
        "ahsc", "AHSC and plant, 2 ms", UNIT, samples, note=f"{1e6 * STEP / float(np.median(samples)):.2f} us/period"
    )
    length = course_time(course)
    return Section("loop", f"Closed loop with AHSC, {length:.1f} s of the circle in one call, one core", [row])


def course_time(course: Course) -> float:
    """Return the length of a course [s]."""
    return course.ticks * course.plant.period


def _mujoco(plant: MujocoPlant, forces: Array) -> Callable[[], float]:
    return lambda: len(forces) * STEP / plant.replay(forces)


def _scipy(plant: ScipyPlant, forces: Array, course: Course) -> Callable[[], float]:
    def once() -> float:
        plant.y = np.concatenate([course.p, course.v])
        return len(forces) * STEP / seconds(lambda: plant.replay(forces))

    return once
