"""How the cost of the physics grows with the panels' elements and with the arms' links."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sffr_gym.config.params import load_params
from sffr_workbench.speed.circle import Course, drive, make_course
from sffr_workbench.speed.measure import Contender, Row, Section, one_core, rounds

ELEMENTS, QUICK_ELEMENTS = (1, 2, 4, 8, 16), (1, 2)
LINKS, QUICK_LINKS = (6, 8, 12, 20, 36), (6, 7)
PERIODS, QUICK_PERIODS = 2000, 20
UNIT = "us/period"


def growth(repeats: int, quick: bool) -> Section:
    """Measure time of the physics of a control period of 2 ms, no forces, for finer panels and for longer arms."""
    elements, links = (QUICK_ELEMENTS, QUICK_LINKS) if quick else (ELEMENTS, LINKS)
    seconds = (QUICK_PERIODS if quick else PERIODS) * load_params().control.period
    finer = {k: make_course(seconds, f"panel.elements={k}") for k in elements}
    longer = {k: make_course(seconds, *_with_links(k)) for k in links}
    contenders = {f"elements-{k}": _cost(course) for k, course in finer.items()}
    contenders |= {f"links-{k}": _cost(course) for k, course in longer.items()}
    with one_core():
        samples = rounds(contenders, repeats)
    rows = [
        Row(
            f"elements-{k}", f"{k} elements per panel", UNIT, samples[f"elements-{k}"],
            note=f"{course.plant.model.omega2.shape[1]} modes, {course.plant.steps} steps",
        )
        for k, course in finer.items()
    ]  # fmt: skip
    rows += [Row(f"links-{k}", f"{k} links", UNIT, samples[f"links-{k}"]) for k in longer]
    section = Section("growth", "Growth of the physics' cost, one core", rows, [
        "Modes are those of a panel below panel.mode_cut; a panel's cost follows them. Links are added to the antenna.",
    ])  # fmt: skip
    modes = [course.plant.model.omega2.shape[1] for course in finer.values()]
    for what, sizes, keys in (
        ("modes of a panel", modes, [f"elements-{k}" for k in finer]),
        ("links", links, [f"links-{k}" for k in longer]),
    ):
        section.remarks.append(f"Cost over {what}: {_law(sizes, [section[key].median for key in keys])}")
    return section


def _cost(course: Course) -> Contender:
    still = np.zeros((course.ticks, len(course.p)))
    robot = course.plant
    return lambda: 1e6 * drive(course, still, robot.integrator, robot.steps).seconds / course.ticks


def _with_links(count: int) -> Sequence[str]:
    """Return overrides that give the robot ``count`` links in all, the further ones of the antenna's kind behind it."""
    params = load_params()
    data = params.to_dict()
    place = next(i for i, arm in enumerate(params.arms) if arm.name == "antenna")
    more = count - params.n_links
    at = 3 + sum(len(arm.links) for arm in params.arms[: place + 1])
    q, qd = list(params.initial.q), list(params.initial.qd or ())
    q[at:at], qd[at:at] = [0.0] * more, [0.0] * more
    link = data["arms"][place]["links"][0]
    return f"arms.{place}.links={[link] * (more + 1)}", f"initial.q={q}", f"initial.qd={qd}"


def _law(sizes: Sequence[int], times: Sequence[float]) -> str:
    """Fit a straight line through times over sizes, in words, with its largest deviation."""
    slope, start = np.polyfit(sizes, times, 1)
    off = max(abs(start + slope * size - time) / time for size, time in zip(sizes, times, strict=True))
    return f"{start:.2f} us + {slope:.3f} us each, within {100 * off:.0f} %"
