"""Work and precision: the error at the end of the circle over time, for our integrators, SciPy's and MuJoCo's."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

from sffr_gym.physics.integrator import ETDRK4, RK4
from sffr_workbench.figures.style import drawing, png
from sffr_workbench.speed.circle import Course, Drive, close_loop, drive, make_course, relative_errors
from sffr_workbench.speed.measure import Row, Section, one_core
from sffr_workbench.speed.mujoco_circle import MujocoPlant
from sffr_workbench.speed.scipy_circle import ScipyPlant

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURE = "work_precision.png"
QUICK_SECONDS = 0.2  # of the circle
SCIPY_SECONDS = 2.0  # of the circle, all of which would take SciPy's methods hours
FINE, MUJOCO_FINE = 32, 16  # steps per control period of what counts as exact
OUR_STEPS: dict[int, tuple[int, ...]] = {ETDRK4: (1, 2, 4), RK4: (3, 4, 8)}  # below 3 the classical method is unstable
OUR_NAMES = {ETDRK4: "sffr-gym ETDRK4", RK4: "sffr-gym RK4"}
MUJOCO_STEPS: dict[str, tuple[int, ...]] = {"RK4": (1, 2, 4), "implicitfast": (1, 2, 4, 8, 16)}
SCIPY_RTOL: dict[str, tuple[float, ...]] = {"DOP853": (1.0e-3, 1.0e-6, 1.0e-9), "Radau": (1.0e-3, 1.0e-6)}
TARGET = 1.0e-6  # relative error
TIMED = 5000  # control periods of a drive of MuJoCo's that are timed
STYLES = {
    "sffr-gym ETDRK4": ("#0b6e99", "o"), "sffr-gym RK4": ("#5aa9c9", "s"), "MuJoCo RK4": ("#b3541e", "^"),
    "MuJoCo implicitfast": ("#e0a16d", "v"), "SciPy DOP853": ("#5b6770", "D"), "SciPy Radau": ("#9aa5ad", "P"),
}  # fmt: skip


class Result(NamedTuple):
    """What a method with one setting did: its drive, and how long it took every time that it was timed [s]."""

    method: str
    setting: str
    exact: Drive
    drive: Drive
    seconds: tuple[float, ...]


def precision(repeats: int, quick: bool) -> Section:
    """Measure the time and error of every method and setting around the circle under AHSC, on one core."""
    course = make_course(QUICK_SECONDS if quick else None)
    rows = []
    with one_core():
        for result in _results(course, repeats, quick):
            errors = relative_errors(result.drive, result.exact)
            end, largest = float(errors[-1]), float(errors.max())
            rows.append(
                Row(
                    f"{result.method} {result.setting}", f"{result.method}, {result.setting}", "s", result.seconds,
                    note=f"relative error {end:.1e} at the end, {largest:.1e} at most",
                    extra={"error_end": end, "error_max": largest},
                )
            )  # fmt: skip
    length = course.ticks * course.plant.period
    return Section("precision", f"Work and precision: {length:.1f} s of the circle under AHSC, one core", rows, [
        "Time is that of the physics. Errors are of base, joints, object and panel tips, against the same equations in "
        f"far smaller steps: ours and SciPy's against ETDRK4 in {FINE} steps per period of 2 ms, MuJoCo's against its "
        f"own RK4 in {MUJOCO_FINE} with the solver's tolerance at 0.",
        f"SciPy's methods drive the first {SCIPY_SECONDS} s; their errors are those there, their times scaled up.",
    ])  # fmt: skip


def draw_picture(section: Section) -> bytes:
    """Draw the diagram and return the content of its PNG file."""
    with drawing({}):
        return png(_picture(section))


def _picture(section: Section) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.2, 4.6), layout="constrained")
    axes = figure.subplots()
    for method, (colour, marker) in STYLES.items():
        rows = [row for row in section.rows if row.what.startswith(f"{method},")]
        times, errors = [row.median for row in rows], [row.extra["error_end"] for row in rows]
        axes.loglog(times, errors, color=colour, marker=marker, markersize=7, linewidth=1.4, label=method)
    axes.axhline(TARGET, color="#8a949b", linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
    axes.annotate(
        "target", (1.0, TARGET), (-2, 3), ("axes fraction", "data"), "offset points", color="#5b6770", ha="right"
    )
    axes.set(xlabel="time of the physics [s]", ylabel="relative error at the end")
    axes.set_title(section.title, loc="left", fontsize=10)
    axes.grid(color="#e3e6e8", linewidth=0.7)
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(frameon=False, loc="outside right upper")
    return figure


def _results(course: Course, repeats: int, quick: bool) -> Iterator[Result]:
    exact = drive(course, close_loop(course, ETDRK4, FINE), ETDRK4, FINE)
    for integrator, numbers in OUR_STEPS.items():
        for k in numbers:
            forces = close_loop(course, integrator, k)
            drives = [drive(course, forces, integrator, k) for _ in range(repeats)]
            timed = tuple(each.seconds for each in drives)
            yield Result(OUR_NAMES[integrator], _step(course, k), exact, drives[0], timed)
    mujoco_exact, _ = MujocoPlant(course, "RK4", course.plant.period / MUJOCO_FINE, tolerance=0.0).drive()
    for name, steps in MUJOCO_STEPS.items():
        for k in steps:
            yield Result(f"MuJoCo {name}", _step(course, k), mujoco_exact, *_mujoco(course, name, k, repeats))
    part = course if quick else make_course(SCIPY_SECONDS)
    exact = drive(part, close_loop(part, ETDRK4, FINE), ETDRK4, FINE)
    for method, tolerances in SCIPY_RTOL.items():
        for rtol in tolerances[:1] if quick else tolerances:
            driven = ScipyPlant(part, method, rtol).drive()
            whole = driven.seconds * course.ticks / part.ticks
            yield Result(f"SciPy {method}", f"rtol {rtol:g}", exact, driven, (whole,))


def _mujoco(course: Course, integrator: str, steps: int, repeats: int) -> tuple[Drive, tuple[float, ...]]:
    """Drive MuJoCo, and return its drive and the time of the whole of it after that of its first part."""
    plant = MujocoPlant(course, integrator, course.plant.period / steps)
    driven, forces = plant.drive()
    part = forces[:TIMED]
    return driven, tuple(plant.replay(part) * len(forces) / len(part) for _ in range(repeats))


def _step(course: Course, steps: int) -> str:
    return f"{1e3 * course.plant.period / steps:.3g} ms"
