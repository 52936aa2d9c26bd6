"""Robots of other structures, whose objects are as wide as the tips of their arms are apart."""

import numpy as np

from sffr_gym.config.params import load_params
from sffr_gym.physics.kinematics import arm_points, rotation
from sffr_gym.task.task_model import make_task_model

LONG_ARM = [
    # A third link at an angle; the object is as wide as the new distance between the tips, 0.6307 m.
    "arms.0.links=[{mass: 4, length: 1, inertia: 0.5, com: 0.4}, {mass: 3, length: 0.6, inertia: 0.3, com: 0.2}, "
    "{mass: 1.5, length: 0.5, inertia: 0.2, com: 0.3}]",
    "initial.q=[1, -2, 0.3, 0.6, 4.2, 0.4, 5.6, 2.1, 0.5, 0.1]",
    "initial.qd=[0.85, 0, 0, 0, 0, 0, 0, 0, 0, 0]",
]
THREE_ARMS = [
    "arms=["
    "{name: arm1, mount: [0.5, 0.5], mount_angle: 0, links: [{mass: 4, length: 1, inertia: 0.5, com: 0.5}, "
    "{mass: 3, length: 1, inertia: 0.5, com: 0.5}]}, "
    "{name: arm2, mount: [0.5, -0.5], mount_angle: 0, links: [{mass: 4, length: 1, inertia: 0.5, com: 0.4}, "
    "{mass: 3, length: 0.9, inertia: 0.5, com: 0.5}]}, "
    "{name: arm3, mount: [0.5, 0.1], mount_angle: 0.3, links: [{mass: 2, length: 0.7, inertia: 0.2, com: 0.3}, "
    "{mass: 1, length: 0.8, inertia: 0.1, com: 0.5}]}, "
    "{name: antenna, mount: [-0.5, 0], mount_angle: 3, links: [{mass: 3, length: 0.5, inertia: 0.1, com: 0.25}, "
    "{mass: 1, length: 0.5, inertia: 0.1, com: 0.2}]}]",
    "initial.q=[0, 0, -0.2, 0.6, 4.2, 5.6, 2.1, 0.4, -1.1, 0.3, 0.2]",
    "initial.qd=[0.85, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]",
]


VARIANTS = {
    "paper": [],
    "tangent": ["path.heading=tangent", "initial.q.2=0.4"],
    "long arm": [*LONG_ARM, "panel.elements=2"],
    "free": ["object=null", "path.heading=tangent"],
}


def make_params(variant):
    """Parameters of a variant; the object's width follows from the arms' tips."""
    params = load_params().with_overrides("object=null", *VARIANTS[variant])
    if variant == "free":
        return params
    model, q = make_task_model(params).model, np.array(params.initial.q)
    ends = [arm_points(model, q, 0 * q, arm)[1].x for arm in (0, 1)]
    half = np.linalg.norm(ends[0] - ends[1]) / 2
    grasps = f"[{{arm: arm1, point: [0, {half}]}}, {{arm: arm2, point: [0, {-half}]}}]"
    return params.with_overrides(f"object={{mass: 3, inertia: 0.5, grasps: {grasps}}}")


def grasping_params(overrides, arms, turned=0.0):
    """Parameters of a robot whose object, turned by an angle, is as wide as the arms' tips are apart."""
    params = load_params().with_overrides("object=null", *overrides)
    model, q = make_task_model(params).model, np.array(params.initial.q)
    ends = np.array([arm_points(model, q, 0 * q, arm)[1].x for arm in range(arms)])
    points = (ends - ends.mean(axis=0)) @ rotation(turned) + [0.12, -0.07]  # its centre of mass lies off their middle
    grasps = ", ".join(f"{{arm: arm{i + 1}, point: [{x}, {y}]}}" for i, (x, y) in enumerate(points))
    return params.with_overrides(f"object={{mass: 3, inertia: 0.5, grasps: [{grasps}]}}")


LIGHT = ["panel.mass=1.0e-6", "panel.axial_cut=1.0e+8", "panel.bending_cut=1.0e+8", "initial.qfd=[0, 0, 0]"]
STRAIGHT = "initial.qd=[0.85, 0, 0, 0, 0, 0, 0, 0, 0]"
ROBOTS = {
    "paper": lambda: load_params(),
    "yawed, tangent": lambda: make_params("tangent").with_overrides(STRAIGHT),
    "third link": lambda: grasping_params(LONG_ARM, arms=2),
    "three arms": lambda: grasping_params([*THREE_ARMS, "path.heading=tangent"], arms=3, turned=0.4),
    "no object": lambda: make_params("free"),
}
