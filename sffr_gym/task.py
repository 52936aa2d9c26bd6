"""The circular object-manipulation task: signals that are measured, reward, and the ends of an episode.

Pure functions of the state; one source for the single environment, the batch and the compiled closed loop.
"""

from __future__ import annotations

from math import cos, isfinite, sin, sqrt
from typing import NamedTuple

import numpy as np

from sffr_gym import arms
from sffr_gym._jit import assign, kernel
from sffr_gym.actuators import Actuators, generalized_forces, pack_actuators, saturate
from sffr_gym.angles import wrap
from sffr_gym.beam import Array
from sffr_gym.episode import Episode
from sffr_gym.integrator import INTEGRATORS, StepWork, advance, step_workspace
from sffr_gym.lanes import ONE, any_lane, where, zeros
from sffr_gym.model import N_BASE, IntArray, Model, n_positions, pack, steps_in
from sffr_gym.observation import held_joints, observation_fields, observe
from sffr_gym.params import Params
from sffr_gym.reference import desired

# What is measured each control period: states at its end, commands during it, Q_flex under them at its start.
SIGNALS = (
    "object_error",  # m, distance of the object (without one: the base) from its desired position
    "attitude_error",  # rad, its orientation error
    "vibration",  # J, bending energy of all panels about the quasi-static shape
    "tip",  # m, largest transverse tip displacement
    "force_deviation",  # N, Q_flex about its quasi-static value
    "moment_deviation",  # N m
    "piezo_square",  # V2, sum over channels
    "thrust",  # N, sum of magnitudes over the base axes
    "joint_square",  # N2 m2, sum over joints
    "piezo_saturated",  # fraction of the group's actuators at their limit
    "thruster_saturated",
    "joint_saturated",
)
N_SIGNALS = len(SIGNALS)
(ERROR, ATTITUDE, VIBRATION, TIP, FORCE, MOMENT, PIEZO, THRUST, JOINT, SAT_PIEZO, SAT_THRUST, SAT_JOINT) = range(
    N_SIGNALS
)

# Why an episode ends before its time, a float since lanes hold nothing else; the text of each in REASONS.
RUNNING, TIP_RANGE, ARM_SINGULAR, GRASP_LOST, OUT_OF_RANGE, NOT_FINITE = map(float, range(6))
REASONS = {
    RUNNING: "",
    TIP_RANGE: "panel tip beyond the model's range",
    ARM_SINGULAR: "singular arm",
    GRASP_LOST: "lost grasp",
    OUT_OF_RANGE: "observation out of range",
    NOT_FINITE: "non-finite state",
}

REWARDS = ("tracking", "vibration", "effort")


class Robot(NamedTuple):
    """A plant with its actuators, and what the task asks of it.

    Attributes:
        model: the rigid part, panels and object.
        actuators: limits and authority.
        held: joints that hold their angles.
        period: control period [s]; steps: integration steps in it; integrator: see ``integrator``.
        limit: (3,) largest tip displacement [m], smallest |sin| of a grasping arm's elbow, largest grasp gap [m].
        scale: (n_u,) command of a unit action.
        bound: (n_o,) range of the observation.
        weight: (3,) reward per second for each unit of the terms' measures, in the order of ``REWARDS``.
    """

    model: Model
    actuators: Actuators
    held: IntArray
    period: float
    steps: int
    integrator: int
    limit: Array
    scale: Array
    bound: Array
    weight: Array


class Buffers(NamedTuple):
    """Buffers of one control period. One set for each thread."""

    step: StepWork
    tau: Array  # (n,) generalised forces
    applied: Array  # (n_u,) command after the limits
    q_flex: Array  # (3,) quasi-static wrench of the panels
    energy: Array  # (n_p,) each panel's share of the signal `vibration` [J]
    p: Array  # (n,) state before the period
    v: Array
    obs: Array  # (n_o,) what was observed and measured before it, kept only where it goes on in another lane
    signals: Array


def make_robot(params: Params) -> Robot:
    """Pack parameters for the compiled control period."""
    model = pack(params)
    actuators = pack_actuators(params, model)
    period, limits, reward = params.control.period, params.limits, params.reward
    fields = observation_fields(model, params).values()
    return Robot(
        model=model,
        actuators=actuators,
        held=held_joints(model),
        period=period,
        steps=steps_in(model, period),
        integrator=INTEGRATORS[params.simulation.integrator],
        limit=np.array([limits.tip * params.panel.length, limits.arm_singularity, limits.grasp_gap]),
        scale=actuators.limit.copy(),
        bound=np.concatenate([np.full(field.size, field.bound) for field in fields]),
        weight=np.array([
            reward.tracking.weight / reward.tracking.scale**2,
            reward.vibration.weight / reward.vibration.scale,
            reward.effort.weight / reward.effort.scale**2,
        ]),
    )  # fmt: skip


def episode_robot(robot: Robot, episode: Episode) -> Robot:
    """The plant of an episode with its faults; ``robot`` itself if it is what the controllers believe and all works.

    An action still asks for a part of the limits that the controllers believe in; what is lost of them cuts it off.

    Args:
        robot: what the controllers believe.
        episode: as drawn.
    """
    left = episode.health.left(robot.actuators)
    if episode.plant is episode.prior and left.min() == 1.0:
        return robot
    plant = robot if episode.plant is episode.prior else make_robot(episode.plant)
    actuators = plant.actuators._replace(limit=plant.actuators.limit * left)
    return plant._replace(actuators=actuators, scale=robot.scale)


@kernel(allocates=True)
def make_buffers(robot, one=ONE):
    """Allocate the buffers of :func:`control_period` for a robot, or for robots in lanes; see :func:`lanes.zeros`."""
    n, n_u, n_p = n_positions(robot.model), len(robot.actuators.limit), len(robot.model.panel_root)
    return Buffers(
        step_workspace(robot.model, one), zeros(one, n), zeros(one, n_u), zeros(one, 3), zeros(one, n_p), zeros(one, n),
        zeros(one, n), zeros(one, len(robot.bound)), zeros(one, N_SIGNALS),
    )  # fmt: skip


@kernel(inline=True)
def control_period(robot, reference, t_end, p, v, command, wrench, buffers, obs, signals):
    """Hold a command for the control period that ends at ``t_end`` [s]; advance ``p, v`` (n,) in place.

    A state that is not finite is not returned: ``p, v`` go back to what they were, observation and signals stay.

    command: (n_u,) piezo volts, base thrust, joint torques, before the limits.
    wrench: (3,) force of the surroundings on the base [N, N, N m], base axes.
    obs: (n_o,) observation at the end, written; signals: (N_SIGNALS,) written.

    Returns the status of the new state: ``RUNNING``, or why the episode ends.
    """
    assign(buffers.p, p)
    assign(buffers.v, v)
    saturate(robot.actuators, command, buffers.applied)
    generalized_forces(robot.model, robot.actuators, buffers.applied, buffers.tau)
    for k in range(N_BASE):
        buffers.tau[k] += wrench[k]
    advance(robot.model, p, v, buffers.tau, robot.period, robot.steps, robot.integrator, buffers.step)
    lost = 0.0
    for k in range(len(p)):
        lost = where(isfinite(p[k]) & isfinite(v[k]), lost, 1.0)
    if any_lane(lost > 0.0):
        for k in range(len(p)):
            p[k], v[k] = where(lost > 0.0, buffers.p[k], p[k]), where(lost > 0.0, buffers.v[k], v[k])
        if not any_lane(lost == 0.0):
            return where(lost > 0.0, NOT_FINITE, RUNNING)
        assign(buffers.obs, obs)
        assign(buffers.signals, signals)
    want = desired(reference, t_end)
    observe(robot, reference, want, p, v, buffers.step.dynamics, obs, False)
    _measure_state(robot, reference, want, p, v, buffers, signals)
    _measure_effort(robot, buffers, signals)
    status = _status(robot, p, v, obs, buffers)
    if any_lane(lost > 0.0):
        for k in range(len(obs)):
            obs[k] = where(lost > 0.0, buffers.obs[k], obs[k])
        for k in range(len(signals)):
            signals[k] = where(lost > 0.0, buffers.signals[k], signals[k])
    return where(lost > 0.0, NOT_FINITE, status)


@kernel(inline=True)
def reward_terms(robot, signals, terms):
    """Write the reward of one period, term by term in the order of ``REWARDS``, and return their sum."""
    terms[0] = -robot.period * robot.weight[0] * signals[ERROR] * signals[ERROR]
    terms[1] = -robot.period * robot.weight[1] * signals[VIBRATION]
    terms[2] = -robot.period * robot.weight[2] * signals[PIEZO]
    return terms[0] + terms[1] + terms[2]


@kernel(inline=True)
def period_cost(signals, status):
    """The cost of a period for safe reinforcement learning: 1 if an actuator saturates or the episode fails, else 0."""
    saturated = (signals[SAT_PIEZO] > 0.0) | (signals[SAT_THRUST] > 0.0) | (signals[SAT_JOINT] > 0.0)
    return where(saturated | (status != RUNNING), 1.0, 0.0)


@kernel(inline=True)
def _status(robot, p, v, obs, buffers):
    """Say whether a finite state lies in the model's range; call after ``observe``, whose result is bounded."""
    model, work = robot.model, buffers.step.dynamics
    outcome = RUNNING
    for k in range(len(obs)):
        beyond = abs(obs[k]) > robot.bound[k]
        if any_lane(beyond):
            outcome = where(beyond, OUT_OF_RANGE, outcome)
            obs[k] = where(beyond, where(obs[k] > 0.0, robot.bound[k], -robot.bound[k]), obs[k])
    cp = sp = 0.0
    if model.object_mass > 0.0:
        cp, sp = cos(p[len(p) - 1]), sin(p[len(p) - 1])
    for g in range(len(model.grasp_arm) - 1, -1, -1):
        outcome = where(_gap(model, g, p, v, cp, sp, work) > robot.limit[2], GRASP_LOST, outcome)
        outcome = where(_elbow(model, model.grasp_arm[g], work) < robot.limit[1], ARM_SINGULAR, outcome)
    n_m, start = model.omega2.shape[1], N_BASE + len(model.link_mass)
    for i in range(model.omega2.shape[0]):
        outcome = where(_tip(robot, i, p, start + i * n_m) > robot.limit[0], TIP_RANGE, outcome)
    return outcome


@kernel
def view(robot, reference, t, p, v, buffers, obs, signals):
    """Observe and measure a state at time ``t`` [s] without a step; the signals of the command are 0."""
    want = desired(reference, t)
    observe(robot, reference, want, p, v, buffers.step.dynamics, obs, True)
    signals[:] = 0.0
    _measure_state(robot, reference, want, p, v, buffers, signals)


@kernel(inline=True)
def _measure_state(robot, reference, want, p, v, buffers, signals):
    """Fill the signals that depend on the state alone, and the quasi-static wrench of the panels in ``buffers``."""
    model = robot.model
    if model.object_mass > 0.0:
        o = len(p) - 3
        signals[ERROR] = _length(want.x - p[o], want.y - p[o + 1])
        signals[ATTITUDE] = abs(wrap(want.heading + reference.phi - p[o + 2]))
    else:
        signals[ERROR] = _length(want.x - p[0], want.y - p[1])
        signals[ATTITUDE] = abs(wrap(want.heading + reference.yaw - p[2]))
    signals[VIBRATION] = tip = 0.0
    fx = fy = moment = 0.0
    ch, sh, turn2 = cos(want.heading), sin(want.heading), want.turn * want.turn
    bx, by = ch * reference.base_x - sh * reference.base_y, sh * reference.base_x + ch * reference.base_y
    yaw = want.heading + reference.yaw
    cb, sb = cos(yaw), sin(yaw)
    n_m, start = model.omega2.shape[1], N_BASE + len(model.link_mass)
    for i in range(model.omega2.shape[0]):
        # The root's acceleration under the reference's motion, in panel axes.
        rx, ry = model.panel_root[i, 0], model.panel_root[i, 1]
        rx, ry = cb * rx - sb * ry, sb * rx + cb * ry
        ax, ay = want.xdd - turn2 * (bx + rx), want.ydd - turn2 * (by + ry)
        c, s = model.panel_axis[i, 0], model.panel_axis[i, 1]
        c, s = cb * c - sb * s, sb * c + cb * s
        across = c * ay - s * ax
        at = start + i * n_m
        first_x, first_y = model.panel_inertia[i, 1], 0.0
        energy = 0.0
        for m in range(model.n_axial, n_m):
            shape = -model.translation[i, m] * across / model.omega2[i, m]  # quasi-static amplitude
            first_y += model.translation[i, m] * shape
            deflection = p[at + m] - shape
            energy += 0.5 * (v[at + m] * v[at + m] + model.omega2[i, m] * deflection * deflection)
        buffers.energy[i] = energy
        signals[VIBRATION] += energy
        tip = max(tip, _tip(robot, i, p, at))
        first_x, first_y = c * first_x - s * first_y, s * first_x + c * first_y
        mass = model.panel_inertia[i, 0]
        gx, gy = mass * ax - turn2 * first_x, mass * ay - turn2 * first_y
        fx -= gx
        fy -= gy
        moment -= rx * gy - ry * gx + first_x * ay - first_y * ax
    signals[TIP] = tip
    buffers.q_flex[0], buffers.q_flex[1], buffers.q_flex[2] = fx, fy, moment


@kernel(inline=True)
def _measure_effort(robot, buffers, signals):
    """Fill the signals that depend on the applied command; call after ``advance`` and ``_measure_state``."""
    applied, limit, q_flex = buffers.applied, robot.actuators.limit, buffers.step.q_flex
    n_l = len(robot.model.link_mass)
    n_v = len(applied) - n_l - N_BASE
    signals[FORCE] = _length(q_flex[0] - buffers.q_flex[0], q_flex[1] - buffers.q_flex[1])
    signals[MOMENT] = abs(q_flex[2] - buffers.q_flex[2])
    signals[PIEZO] = signals[THRUST] = signals[JOINT] = 0.0
    signals[SAT_PIEZO] = signals[SAT_THRUST] = signals[SAT_JOINT] = 0.0
    for k in range(len(applied)):
        beyond = where(abs(applied[k]) >= limit[k], 1.0, 0.0) if limit[k] > 0.0 else 0.0  # not the dead ones
        if k < n_v:
            signals[PIEZO] += applied[k] * applied[k]
            signals[SAT_PIEZO] += beyond / n_v
        elif k < n_v + N_BASE:
            signals[SAT_THRUST] += beyond / N_BASE
            if k < n_v + 2:
                signals[THRUST] += abs(applied[k])
        else:
            signals[JOINT] += applied[k] * applied[k]
            signals[SAT_JOINT] += beyond / n_l


@kernel(inline=True)
def _length(x, y):
    return sqrt(x * x + y * y)


@kernel(inline=True)
def _tip(robot, i, p, at):
    """Magnitude of a panel's transverse tip displacement [m]."""
    tip = 0.0
    for m in range(robot.model.omega2.shape[1]):
        tip += robot.actuators.tips[i, m, 1] * p[at + m]
    return abs(tip)


@kernel(inline=True)
def _elbow(model, arm, work):
    """|sin| of the angle between an arm's first link and the rest of it; 0 when it is singular."""
    first, last = model.arm_first[arm], model.arm_first[arm + 1]
    x = y = 0.0
    for k in range(first + 1, last):
        x += model.link_length[k] * work.c[k]
        y += model.link_length[k] * work.s[k]
    return abs(work.c[first] * y - work.s[first] * x) / max(sqrt(x * x + y * y), 1e-12)


@kernel(inline=True)
def _gap(model, g, p, v, cp, sp, work):
    """Distance of a gripper from its grasp point [m]; heading and link directions are those of ``p``.

    cp, sp: cosine and sine of the object's angle.
    """
    o = len(p) - 3
    x, y, _, _ = arms.tip_motion(model, model.grasp_arm[g], v[2], work)
    cb, sb = work.heading[0], work.heading[1]
    gx, gy = model.grasp_point[g, 0], model.grasp_point[g, 1]
    dx = p[0] + cb * x - sb * y - p[o] - cp * gx + sp * gy
    dy = p[1] + sb * x + cb * y - p[o + 1] - sp * gx - cp * gy
    return sqrt(dx * dx + dy * dy)
