"""What controllers and agents see: tracking errors, joint and elastic coordinates, the reference's motion.

Every vector is in the reference axes (``reference``), SI units, errors are desired minus actual. Nothing grows around
the circle. The observation is all that a policy gets; see :func:`observation_fields` for its layout.
"""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple

import numpy as np

from sffr_gym import arms
from sffr_gym._jit import kernel
from sffr_gym.angles import cos_sin_near, wrap
from sffr_gym.beam import N_TIP
from sffr_gym.model import N_BASE, IntArray, Model
from sffr_gym.params import Params


class Field(NamedTuple):
    """A named stretch of the observation.

    Attributes:
        name: what it is.
        start, size: where it lies.
        unit: SI unit.
        bound: largest magnitude of the observation space.
    """

    name: str
    start: int
    size: int
    unit: str
    bound: float

    @property
    def slice(self) -> slice:
        """The field's place in an observation."""
        return slice(self.start, self.start + self.size)

    @property
    def units(self) -> list[str]:
        """The unit of each number."""
        units = self.unit.split(", ")
        return units * (self.size // len(units))

    @property
    def measured(self) -> bool:
        """Whether sensors give it; the reference's motion is what the task asks for, and known."""
        return not self.name.startswith("reference_")


def held_joints(model: Model) -> IntArray:
    """Joints that the task asks to hold their angles: all but the first two of each grasping arm."""
    moving = [model.arm_first[arm] + k for arm in model.grasp_arm for k in (0, 1)]
    return np.setdiff1d(np.arange(len(model.link_mass)), moving).astype(np.int64)


def observation_fields(model: Model, params: Params) -> dict[str, Field]:
    """Layout of the observation of a robot, in order."""
    limits = params.limits
    n_l, n_p, n_g, n_h = len(model.link_mass), len(model.panel_root), len(model.grasp_arm), len(held_joints(model))
    n_o = N_BASE if model.object_mass > 0 else 0
    tip = params.panel.length
    spans: list[tuple[str, int, str, float]] = [
        ("base_error", 2, "m", limits.position), ("yaw_error", 1, "rad", limits.angle),
        ("base_error_rate", 2, "m/s", limits.velocity), ("yaw_error_rate", 1, "rad/s", limits.rate),
        ("tip_error", 2 * n_g, "m", limits.position), ("tip_error_rate", 2 * n_g, "m/s", limits.velocity),
        ("object_error", max(n_o - 1, 0), "m", limits.position), ("object_angle_error", n_o // 3, "rad", limits.angle),
        ("object_error_rate", max(n_o - 1, 0), "m/s", limits.velocity),
        ("object_angle_error_rate", n_o // 3, "rad/s", limits.rate),
        ("hold_error", n_h, "rad", limits.angle),
        ("joint_angle", n_l, "rad", limits.angle), ("joint_rate", n_l, "rad/s", limits.rate),
        ("yaw_rate", 1, "rad/s", limits.rate),
        ("elastic", N_TIP * n_p, "m, m, rad", tip), ("elastic_rate", N_TIP * n_p, "m/s, m/s, rad/s", limits.rate),
        ("reference_velocity", 2, "m/s", limits.velocity), ("reference_turn", 1, "rad/s", limits.rate),
        ("reference_acceleration", 2, "m/s2", limits.velocity),
    ]  # fmt: skip
    fields, start = {}, 0
    for name, size, unit, bound in spans:
        fields[name] = Field(name, start, size, unit, bound)
        start += size
    return fields


@kernel(inline=True)
def observe(robot, reference, want, p, v, work, obs, anew):
    """Write the observation (n_o,) of positions and velocities ``p, v`` (n,).

    robot: the plant as a :class:`task.Robot`; reference: the episode's :class:`reference.Reference`.
    want: the :class:`reference.Desired` of this time; work: a :class:`dynamics.Work`, whose heading and
        link directions are set.
    anew: the state is not the one after a step with ``work``; see :func:`dynamics.accelerations`.
    """
    model = robot.model
    ch, sh, turn = cos(want.heading), sin(want.heading), want.turn
    n_l, n_p, n_m = len(model.link_mass), model.omega2.shape[0], model.omega2.shape[1]
    at = 0
    # Base: formation relative to the object's desired pose.
    ox, oy = ch * reference.base_x - sh * reference.base_y, sh * reference.base_x + ch * reference.base_y
    at = _error(obs, at, ch, sh, want.x + ox - p[0], want.y + oy - p[1])
    obs[at] = wrap(want.heading + reference.yaw - p[2])
    at = _error(obs, at + 1, ch, sh, want.xd - turn * oy - v[0], want.yd + turn * ox - v[1])
    obs[at] = turn - v[2]
    at += 1
    # Grippers: desired points of the object, actual tips from the joint angles.
    arms.link_directions(model, p, v, work, anew)
    cb, sb = cos_sin_near(work.anchor[n_l], p[2], anew)
    work.heading[0], work.heading[1] = cb, sb
    cp, sp = cos(want.heading + reference.phi), sin(want.heading + reference.phi)
    n_g = len(model.grasp_arm)
    for g in range(n_g):
        gx, gy = model.grasp_point[g, 0], model.grasp_point[g, 1]
        gx, gy = cp * gx - sp * gy, sp * gx + cp * gy
        x, y, xd, yd = arms.tip_motion(model, model.grasp_arm[g], v[2], work)
        _error(obs, at + 2 * g, ch, sh, want.x + gx - p[0] - cb * x + sb * y, want.y + gy - p[1] - sb * x - cb * y)
        xd, yd = v[0] + cb * xd - sb * yd, v[1] + sb * xd + cb * yd
        _error(obs, at + 2 * (n_g + g), ch, sh, want.xd - turn * gy - xd, want.yd + turn * gx - yd)
    at += 4 * n_g
    if model.object_mass > 0.0:
        o = len(p) - 3
        at = _error(obs, at, ch, sh, want.x - p[o], want.y - p[o + 1])
        obs[at] = wrap(want.heading + reference.phi - p[o + 2])
        at = _error(obs, at + 1, ch, sh, want.xd - v[o], want.yd - v[o + 1])
        obs[at] = turn - v[o + 2]
        at += 1
    for k in range(len(robot.held)):
        joint = robot.held[k]
        obs[at + k] = wrap(reference.joints[joint] - p[N_BASE + joint])
    at += len(robot.held)
    for k in range(n_l):
        obs[at + k] = wrap(p[N_BASE + k])
        obs[at + n_l + k] = v[N_BASE + k]
    at += 2 * n_l
    obs[at] = v[2]
    at += 1
    start = N_BASE + n_l
    for i in range(n_p):
        for k in range(N_TIP):
            displacement = rate = 0.0
            for m in range(n_m):
                displacement += robot.actuators.tips[i, m, k] * p[start + i * n_m + m]
                rate += robot.actuators.tips[i, m, k] * v[start + i * n_m + m]
            obs[at + N_TIP * i + k] = displacement
            obs[at + N_TIP * (n_p + i) + k] = rate
    at += 2 * N_TIP * n_p
    at = _error(obs, at, ch, sh, want.xd, want.yd)
    obs[at] = turn
    _error(obs, at + 1, ch, sh, want.xdd, want.ydd)


@kernel(inline=True)
def _error(obs, at, ch, sh, x, y):
    """Write an inertial vector in reference axes at ``at`` and return the index behind it."""
    obs[at] = ch * x + sh * y
    obs[at + 1] = ch * y - sh * x
    return at + 2
