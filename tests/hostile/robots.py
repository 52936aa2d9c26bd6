"""Random robots and configurations as a user's file would have them: mappings that are laid over the case study.

Their lists fit each other, so that most of them are robots; their numbers lie anywhere, ends of the ranges included.
What is drawn has to run, or to be refused in lines that name its keys.
"""

from __future__ import annotations

import math
from typing import Any

from hypothesis import strategies as st

Config = dict[str, Any]
Point = tuple[float, float]

ODD_NAMES = (
    "", " ", "0", "link1", "arm link1 mass factor", "a" * 64, "a" * 65, "a\nb", "\x1b[31m", "<b>", "a,b", "a/b", "../x",
    "\u8155", "\u202eabc", "\ud800", "null", "{0}", "[red]", "%s",
)  # fmt: skip
MOST_ARMS, MOST_LINKS, MOST_PANELS, MOST_ELEMENTS = 5, 4, 4, 6  # of a drawn robot; more of them only take longer


def sizes(least: float, most: float) -> st.SearchStrategy[float]:
    """Draw a positive number, each power of ten as often, and now and then an end of the range."""
    spread = st.floats(math.log10(least), math.log10(most)).map(lambda power: min(max(10.0**power, least), most))
    return st.one_of(spread, spread, spread, st.sampled_from([least, most]))


ANGLES = st.one_of(
    st.floats(-math.pi, math.pi), st.sampled_from([0.0, math.pi / 2, math.pi, -math.pi, 2 * math.pi, 1e-300])
)
PLAUSIBLE = {  # mass, length, moment of inertia, stiffness of a robot that somebody might build
    "mass": st.floats(0.1, 100.0), "length": st.floats(0.1, 5.0), "inertia": st.floats(0.01, 50.0),
    "EI": sizes(0.1, 1e4), "places": st.floats(-2.0, 2.0), "rates": st.floats(-0.1, 0.1),
}  # fmt: skip
WILD = {  # and of one that nobody would
    "mass": sizes(1e-6, 1e6), "length": sizes(1e-3, 1e3), "inertia": sizes(1e-12, 1e9), "EI": sizes(1e-9, 1e12),
    "places": st.one_of(st.floats(-1e3, 1e3), st.just(0.0)), "rates": st.floats(-1e3, 1e3),
}  # fmt: skip


@st.composite
def names(draw: st.DrawFn, count: int) -> list[str]:
    """Draw names, which are seldom odd or alike."""
    plain = [f"part {k}" for k in range(count)]
    if count and draw(st.integers(0, 19)) == 0:
        plain[draw(st.integers(0, count - 1))] = draw(st.one_of(st.sampled_from(ODD_NAMES), st.text(max_size=5)))
    return plain


def tip_of(arm: Config, joints: list[float]) -> Point:
    """Return the place of an arm's tip in the base frame [m]."""
    (x, y), angle = arm["mount"], arm["mount_angle"]
    for link, joint in zip(arm["links"], joints, strict=True):
        angle += joint
        x, y = x + link["length"] * math.cos(angle), y + link["length"] * math.sin(angle)
    return x, y


@st.composite
def arms(draw: st.DrawFn, kind: Config) -> tuple[list[Config], list[list[float]]]:
    """Draw arms with their joint angles; straight, folded and closed ones among them."""
    counts = draw(st.lists(st.integers(1, MOST_LINKS), max_size=MOST_ARMS))
    joints = [[draw(st.one_of(ANGLES, st.floats(0.3, 2.8))) for _ in range(count)] for count in counts]
    found = []
    for name, count in zip(draw(names(len(counts))), counts, strict=True):
        links = []
        for _ in range(count):
            length = draw(kind["length"])
            com = length * draw(st.sampled_from([0.0, 0.5, 1.0]))
            links.append({"mass": draw(kind["mass"]), "length": length, "inertia": draw(kind["inertia"]), "com": com})
        mount = [draw(kind["places"]), draw(kind["places"])]
        found.append({"name": name, "mount": mount, "mount_angle": draw(ANGLES), "links": links})
    return found, joints


@st.composite
def panels(draw: st.DrawFn, kind: Config) -> Config:
    """Draw the panels: none, one, or several of them anywhere, also on one place."""
    mounts = [
        {"name": name, "root": [draw(kind["places"]), draw(kind["places"])], "angle": draw(ANGLES)}
        for name in draw(names(draw(st.integers(0, MOST_PANELS))))
    ]
    return {
        "mass": draw(kind["mass"]), "length": draw(kind["length"]), "EI": draw(kind["EI"]), "E": draw(sizes(1e6, 1e13)),
        "area": draw(sizes(1e-9, 1.0)), "elements": draw(st.integers(1, MOST_ELEMENTS)),
        "strain_rate_damping": draw(st.one_of(st.just(0.0), sizes(1e-9, 10.0))),
        "axial_cut": draw(sizes(1e-6, 1e9)), "bending_cut": draw(st.one_of(st.just(60.0), sizes(1e-6, 1e9))),
        "mounts": mounts,
    }  # fmt: skip


@st.composite
def carried(draw: st.DrawFn, kind: Config, own: list[Config], joints: list[list[float]]) -> Config | None:
    """Draw what the arms carry: nothing, or an object whose points are where their tips are, or seldom elsewhere."""
    able = [k for k, arm in enumerate(own) if len(arm["links"]) > 1] or list(range(len(own)))
    grasping = draw(st.lists(st.sampled_from(able), unique=True, max_size=3)) if able else []
    if not grasping:
        return None
    tips = [tip_of(own[k], joints[k]) for k in grasping]
    x0, y0, turn = draw(st.floats(-1.0, 1.0)), draw(st.floats(-1.0, 1.0)), draw(ANGLES)
    x0, y0 = x0 + sum(x for x, _ in tips) / len(tips), y0 + sum(y for _, y in tips) / len(tips)
    off = draw(st.sampled_from([0.0] * 9 + [0.01, 1.0]))
    c, s = math.cos(turn), math.sin(turn)
    points = [[c * (x - x0) + s * (y - y0) + off * k, c * (y - y0) - s * (x - x0)] for k, (x, y) in enumerate(tips)]
    grasps = [{"arm": own[k]["name"], "point": point} for k, point in zip(grasping, points, strict=True)]
    return {"mass": draw(kind["mass"]), "inertia": draw(kind["inertia"]), "grasps": grasps}


@st.composite
def robots(draw: st.DrawFn) -> Config:
    """Draw a robot: any number of arms, links and panels, with or without an object, plausible or wild."""
    kind = draw(st.sampled_from([PLAUSIBLE, PLAUSIBLE, WILD]))
    own, joints = draw(arms(kind))
    panel = draw(panels(kind))
    q = [draw(kind["places"]), draw(kind["places"]), draw(ANGLES), *(angle for each in joints for angle in each)]
    moving = draw(st.sampled_from(["path", "rest", "any"]))
    rates = [0.0] * len(q) if moving == "rest" else [draw(kind["rates"]) for _ in q]
    tips = [[draw(st.floats(-1e-3, 1e-3)) for _ in range(3)] for _ in range(2)]
    initial = {"q": q, "qd": None if moving == "path" else rates, "qf": tips[0], "qfd": tips[1]}
    if draw(st.booleans()):
        initial["qf"] = [tips[0]] * len(panel["mounts"]) or [0.0] * 3
    base = {"mass": draw(kind["mass"]), "inertia": draw(kind["inertia"]), "side": draw(kind["length"])}
    held = draw(carried(kind, own, joints))
    return {"base": base, "arms": own, "panel": panel, "object": held, "initial": initial}


@st.composite
def settings(draw: st.DrawFn) -> Config:
    """Draw actuators, path, control, suppression, simulation, limits and reward, anywhere in their ranges."""
    period = draw(st.one_of(st.just(2.0e-3), sizes(1e-5, 0.1)))
    force = st.one_of(st.floats(0.1, 100.0), sizes(1e-9, 1e9))
    piezo = {
        "array": draw(st.sampled_from(["generalized", "patches", "tip"])), "force": draw(force), "moment": draw(force),
        "voltage": draw(sizes(1e-9, 1e9)),
    }  # fmt: skip
    terms = {
        name: {"weight": draw(sizes(1e-3, 1e6)), "scale": draw(sizes(1e-12, 1e12))}
        for name in ("tracking", "vibration", "effort")
    }
    coordinates = st.one_of(
        st.sampled_from(["auto", "all"]),
        st.lists(st.sampled_from(["q4", "q5", "q6"]), min_size=1, unique=True),
    )
    return {
        "actuators": {
            "thruster_force": draw(force), "thruster_torque": draw(force), "joint_torque": draw(force), "piezo": piezo,
        },
        "path": {
            "radius": draw(sizes(1e-3, 1e7)), "speed": draw(st.one_of(st.just(0.85), sizes(1e-3, 100.0))),
            "heading": draw(st.sampled_from(["fixed", "tangent"])),
            "kind": draw(st.sampled_from(["circle", "circle", "figure-eight", "line", "slew", "waypoints"])),
            "time": draw(sizes(0.01, 1e6)), "turn": draw(st.floats(-6.28, 6.28)),
            "displacement": [draw(st.floats(-1e3, 1e3)) for _ in range(2)],
        },
        "control": {"period": period, "Kp": draw(sizes(1e-3, 1e4)), "Kd": draw(sizes(1e-3, 1e3))},
        "suppression": {
            "coordinates": draw(coordinates), "psi": draw(sizes(1e-9, 1e6)),
            "B0": [draw(sizes(1e-9, 1e6)) for _ in range(3)], "Gamma": [draw(sizes(1e-9, 1e6)) for _ in range(3)],
        },
        "simulation": {
            "coupling": draw(st.sampled_from(["exact"] * 7 + ["staggered"])), "max_step": draw(sizes(1e-5, 0.1)),
            "integrator": draw(st.sampled_from(["etdrk4", "etdrk4", "rk4"])),
            "baumgarte": draw(st.one_of(st.just(20.0), st.just(0.0), sizes(1e-3, 1e6))),
        },
        "limits": {
            "tip": draw(sizes(1e-6, 1.0)), "arm_singularity": draw(sizes(1e-9, 0.9)),
            "grasp_gap": draw(sizes(1e-9, 1.0)),
            "position": draw(sizes(1e-3, 1e6)), "angle": draw(st.floats(0.1, 6.28)),
            "velocity": draw(sizes(0.1, 1e6)), "rate": draw(sizes(0.1, 1e6)),
        },
        "reward": terms,
    }  # fmt: skip


@st.composite
def configs(draw: st.DrawFn) -> Config:
    """Draw a robot with some sections of its settings; the others are the case study's."""
    drawn = draw(settings())
    kept = draw(st.lists(st.sampled_from(sorted(drawn)), unique=True))
    return draw(robots()) | {name: drawn[name] for name in kept}
