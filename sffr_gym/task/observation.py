"""What controllers and agents see: tracking errors, joint and elastic coordinates, the reference's motion.

Every vector is in the reference axes (``reference``), SI units, errors are desired minus actual. Nothing grows around
the circle. The observation is all that a policy gets; see :func:`observation_fields` for its layout.
"""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple

import numpy as np

from sffr_gym.compile.angles import wrap
from sffr_gym.compile.kernels import kernel
from sffr_gym.config.params import Params
from sffr_gym.physics import arms
from sffr_gym.physics.beam import N_TIP
from sffr_gym.physics.dynamics import directions
from sffr_gym.physics.foreshortening import tip_foreshortening
from sffr_gym.physics.model import N_BASE, Model, first_mode
from sffr_gym.types import IntArray


class Field(NamedTuple):
    """A named stretch of the observation."""

    name: str  #: what it is
    start: int  #: where it lies
    size: int
    unit: str  #: SI unit
    bound: float  #: largest magnitude of the observation space

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
    tip = max((panel.length for panel in params.panel.each), default=params.panel.length)
    bends = int(params.path.kind != "circle")  # whose motion is not all in velocity and turn
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
        ("reference_jerk", 2 * bends, "m/s3", limits.velocity),
        ("reference_turn_acceleration", bends, "rad/s2", limits.rate),
        ("reference_turn_jerk", bends, "rad/s3", limits.rate),
    ]  # fmt: skip
    fields, start = {}, 0
    for name, size, unit, bound in spans:
        fields[name] = Field(name, start, size, unit, bound)
        start += size
    return fields


class ObservationIndex(NamedTuple):
    """The index map of an observation: where each field begins, named as in :func:`observation_fields`."""

    base_error: int
    yaw_error: int
    base_error_rate: int
    yaw_error_rate: int
    tip_error: int
    tip_error_rate: int
    object_error: int
    object_angle_error: int
    object_error_rate: int
    object_angle_error_rate: int
    hold_error: int
    joint_angle: int
    joint_rate: int
    yaw_rate: int
    elastic: int
    elastic_rate: int
    reference_velocity: int
    reference_turn: int
    reference_acceleration: int
    reference_jerk: int
    reference_turn_acceleration: int
    reference_turn_jerk: int
    end: int  #: n_o


def observation_index(fields: dict[str, Field]) -> ObservationIndex:
    """Return where each field of an observation begins."""
    end = sum(field.size for field in fields.values())
    return ObservationIndex(**{name: field.start for name, field in fields.items()}, end=end)


@kernel
def observe(task, reference, des, p, v, work, obs, refresh):
    """Write the observation (n_o,) of positions and velocities ``p, v`` (n,).

    task: the plant as a :class:`task_model.TaskModel`; reference: the episode's :class:`reference.Reference`.
    des: the :class:`reference.Desired` of this time; work: a :class:`dynamics.Work`, whose directions are set.
    refresh: the state is not the one after a step with ``work``; see :func:`dynamics.accelerations`.
    """
    model, at = task.model, task.at
    ch, sh, turn = cos(des.heading), sin(des.heading), des.turn
    # Base: formation relative to the object's desired pose.
    ox, oy = ch * reference.base_x - sh * reference.base_y, sh * reference.base_x + ch * reference.base_y
    _write(obs, at.base_error, ch, sh, des.x + ox - p[0], des.y + oy - p[1])
    obs[at.yaw_error] = wrap(des.heading + reference.yaw - p[2])
    _write(obs, at.base_error_rate, ch, sh, des.xd - turn * oy - v[0], des.yd + turn * ox - v[1])
    obs[at.yaw_error_rate] = turn - v[2]
    # Grippers: desired points of the object, actual tips from the joint angles.
    directions(model, p, v, work, refresh)
    cb, sb = work.yaw.cos[0], work.yaw.sin[0]
    cp, sp = cos(des.heading + reference.phi), sin(des.heading + reference.phi)
    for g in range(len(model.grasp_arm)):
        gx, gy = model.grasp_point[g, 0], model.grasp_point[g, 1]
        gx, gy = cp * gx - sp * gy, sp * gx + cp * gy
        x, y, xd, yd = arms.tip_motion(model, model.grasp_arm[g], v[2], work.links)
        ex, ey = des.x + gx - p[0] - cb * x + sb * y, des.y + gy - p[1] - sb * x - cb * y
        _write(obs, at.tip_error + 2 * g, ch, sh, ex, ey)
        xd, yd = v[0] + cb * xd - sb * yd, v[1] + sb * xd + cb * yd
        _write(obs, at.tip_error_rate + 2 * g, ch, sh, des.xd - turn * gy - xd, des.yd + turn * gx - yd)
    if model.at.object < model.at.end:
        o = model.at.object
        _write(obs, at.object_error, ch, sh, des.x - p[o], des.y - p[o + 1])
        obs[at.object_angle_error] = wrap(des.heading + reference.phi - p[o + 2])
        _write(obs, at.object_error_rate, ch, sh, des.xd - v[o], des.yd - v[o + 1])
        obs[at.object_angle_error_rate] = turn - v[o + 2]
    for k in range(len(task.held)):
        joint = task.held[k]
        obs[at.hold_error + k] = wrap(reference.joints[joint] - p[N_BASE + joint])
    for k in range(len(model.link_mass)):
        obs[at.joint_angle + k] = wrap(p[N_BASE + k])
        obs[at.joint_rate + k] = v[N_BASE + k]
    obs[at.yaw_rate] = v[2]
    for i in range(model.omega2.shape[0]):
        start = first_mode(model, i)
        for k in range(N_TIP):
            displacement = rate = 0.0
            for m in range(model.omega2.shape[1]):
                displacement += task.actuators.tips[i, m, k] * p[start + m]
                rate += task.actuators.tips[i, m, k] * v[start + m]
            obs[at.elastic + N_TIP * i + k] = displacement
            obs[at.elastic_rate + N_TIP * i + k] = rate
        inward, inward_rate = tip_foreshortening(model, i, p, v)
        obs[at.elastic + N_TIP * i] -= inward
        obs[at.elastic_rate + N_TIP * i] -= inward_rate
    _write(obs, at.reference_velocity, ch, sh, des.xd, des.yd)
    obs[at.reference_turn] = turn
    _write(obs, at.reference_acceleration, ch, sh, des.xdd, des.ydd)
    if at.reference_jerk < at.end:
        _write(obs, at.reference_jerk, ch, sh, des.xddd, des.yddd)
        obs[at.reference_turn_acceleration], obs[at.reference_turn_jerk] = des.turn_acceleration, des.turn_jerk


@kernel
def reference_turning(at, obs):
    """Angular acceleration [rad/s2] and jerk [rad/s3] of the reference in an observation; 0 on a circle."""
    if at.reference_jerk < at.end:
        return obs[at.reference_turn_acceleration], obs[at.reference_turn_jerk]
    none = 0.0 * obs[at.reference_turn]
    return none, none


@kernel
def clip(bound, obs):
    """Bring an observation (n_o,) within its bounds (n_o,), in place."""
    for k in range(len(obs)):
        obs[k] = min(max(obs[k], -bound[k]), bound[k])


@kernel
def _write(obs, at, ch, sh, x, y):
    """Write an inertial vector in reference axes at ``at``; ch, sh: cosine and sine of the heading."""
    obs[at] = ch * x + sh * y
    obs[at + 1] = ch * y - sh * x
