"""Work and precision: what an error at the end of the circle costs in time, for our integrators, SciPy's and MuJoCo's."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from agents.bench.circle import Course, Drive, close_loop, drive, make_course, relative_errors
from agents.bench.measure import Row, Section, one_core
from agents.bench.mujoco_circle import MujocoPlant
from agents.bench.scipy_circle import ScipyPlant
from sffr_gym.integrator import ETDRK4, RK4

PICTURE = "work_precision.png"
QUICK_SECONDS = 0.2  # of the circle
FINE, MUJOCO_FINE = 32, 16  # steps per control period of what counts as exact
OUR_STEPS = {ETDRK4: (1, 2, 4), RK4: (3, 4, 8)}  # below 3 the classical method is unstable
OUR_NAMES = {ETDRK4: "sffr-gym ETDRK4", RK4: "sffr-gym RK4"}
MUJOCO_STEPS = {"RK4": (1, 2, 4), "implicitfast": (1, 2, 4, 8, 16)}
SCIPY_RTOL = {"DOP853": (1.0e-3, 1.0e-6, 1.0e-9), "Radau": (1.0e-3, 1.0e-6)}
STYLES = {
    "sffr-gym ETDRK4": ("#0b6e99", "o"), "sffr-gym RK4": ("#5aa9c9", "s"), "MuJoCo RK4": ("#b3541e", "^"),
    "MuJoCo implicitfast": ("#e0a16d", "v"), "SciPy DOP853": ("#5b6770", "D"), "SciPy Radau": ("#9aa5ad", "P"),
}  # fmt: skip


class Point(NamedTuple):
    """One setting of a method: label, the method's exact result, and how to run it."""

    method: str
    setting: str
    exact: Drive
    run: Callable[[], Drive]


def precision(repeats: int, quick: bool) -> Section:
    """Time and error of every method and setting around the circle under AHSC, on one core."""
    course = make_course(QUICK_SECONDS if quick else None)
    rows = []
    with one_core():
        for point in _points(course, quick):
            result = point.run()
            errors = relative_errors(result, point.exact)
            end, largest = float(errors[-1]), float(errors.max())
            rows.append(
                Row(
                    f"{point.method} {point.setting}", f"{point.method}, {point.setting}", "s", (result.seconds,),
                    note=f"relative error {end:.1e} at the end, {largest:.1e} at most",
                    extra={"error_end": end, "error_max": largest},
                )
            )  # fmt: skip
    length = course.ticks * course.robot.period
    return Section("precision", f"Work and precision: physics of {length:.1f} s of the circle under AHSC, one core", rows, [
        "Errors are of base, joints, object and panel tips, against the same equations in far smaller steps: ours and "
        f"SciPy's against ETDRK4 in {FINE} steps per period of 2 ms, MuJoCo's against its own RK4 in {MUJOCO_FINE}.",
    ])  # fmt: skip


def save_picture(section: Section, folder: Path) -> Path:
    """Draw the diagram; raises ModuleNotFoundError without matplotlib."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 4.8), layout="constrained")
    axes = figure.subplots()
    for method, (colour, marker) in STYLES.items():
        rows = [row for row in section.rows if row.what.startswith(f"{method},")]
        times, errors = [row.median for row in rows], [row.extra["error_end"] for row in rows]
        axes.loglog(times, errors, color=colour, marker=marker, markersize=7, linewidth=1.4, label=method)
    axes.set(xlabel="time of the physics [s]", ylabel="relative error at the end")
    axes.set_title(section.title.split(": ")[1], loc="left", fontsize=10)
    axes.grid(color="#e3e6e8", linewidth=0.7)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    file = folder / PICTURE
    figure.savefig(file, dpi=150)
    return file


def _points(course: Course, quick: bool) -> Iterator[Point]:
    def ours(integrator: int, steps: int) -> Drive:
        return drive(course, close_loop(course, integrator, steps), integrator, steps)

    exact = ours(ETDRK4, FINE)
    for integrator, numbers in OUR_STEPS.items():
        for k in numbers:
            yield _point(course, OUR_NAMES[integrator], k, exact, lambda i=integrator, k=k: ours(i, k))
    mujoco_exact = _mujoco(course, "RK4", MUJOCO_FINE)
    for name, numbers in MUJOCO_STEPS.items():
        for k in numbers:
            yield _point(course, f"MuJoCo {name}", k, mujoco_exact, lambda n=name, k=k: _mujoco(course, n, k))
    for method, tolerances in SCIPY_RTOL.items():
        for rtol in tolerances[:1] if quick else tolerances:
            run: Any = lambda m=method, r=rtol: ScipyPlant(course, m, r).drive()  # noqa: E731  (one of several)
            yield Point(f"SciPy {method}", f"rtol {rtol:g}", exact, run)


def _point(course: Course, method: str, steps: int, exact: Drive, run: Callable[[], Drive]) -> Point:
    return Point(method, f"{1e3 * course.robot.period / steps:.3g} ms", exact, run)


def _mujoco(course: Course, integrator: str, steps: int) -> Drive:
    return MujocoPlant(course, integrator, course.robot.period / steps).drive()[0]
