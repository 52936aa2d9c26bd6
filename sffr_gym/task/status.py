"""The ends of an episode: why a state lies outside of the model's range."""

from __future__ import annotations

from enum import IntEnum
from math import cos, sin, sqrt

from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.lanes import any_lane, where
from sffr_gym.physics import arms
from sffr_gym.task.signals import tip_deflection

# Why an episode ends before its time, a float since lanes hold nothing else; the text of each in REASONS.
# LIMIT_CYCLE is found in a whole episode (``metrics.instability``), and ends none.
RUNNING, TIP_RANGE, ARM_SINGULAR, GRASP_LOST, OUT_OF_RANGE, NOT_FINITE, LIMIT_CYCLE = map(float, range(7))
REASONS = {
    RUNNING: "",
    TIP_RANGE: "panel tip beyond the model's range",
    ARM_SINGULAR: "singular arm",
    GRASP_LOST: "lost grasp",
    OUT_OF_RANGE: "observation out of range",
    NOT_FINITE: "non-finite state",
    LIMIT_CYCLE: "unstable: saturated actuators keep the panels swinging",
}


class Failure(IntEnum):
    """Why an episode ended before its time: a number, as files hold it, 0 for no failure; its text is the reason."""

    NONE = int(RUNNING)
    TIP_RANGE = int(TIP_RANGE)
    ARM_SINGULAR = int(ARM_SINGULAR)
    GRASP_LOST = int(GRASP_LOST)
    OUT_OF_RANGE = int(OUT_OF_RANGE)
    NOT_FINITE = int(NOT_FINITE)
    LIMIT_CYCLE = int(LIMIT_CYCLE)

    def __str__(self) -> str:
        """Return the reason, empty for no failure."""
        return REASONS[self]

    def __format__(self, form: str) -> str:
        """Return the reason as f-strings show it."""
        return format(str(self), form)


def failure_text(number: int) -> str:
    """Return the reason of a :class:`Failure` in words; empty for none."""
    return REASONS[number]


@kernel
def status_of(task, p, v, work, obs):
    """Say whether a finite state lies in the model's range, and clip its observation to its bounds.

    task: the plant as a :class:`task_model.TaskModel`; p, v: (n,) positions and velocities.
    work: :class:`dynamics.Work`, whose directions are those of this state; obs: (n_o,) its observation.

    Returns ``RUNNING``, or the reason why the episode ends.
    """
    model, limits = task.model, task.limits
    outcome = RUNNING
    for k in range(len(obs)):
        beyond = abs(obs[k]) > task.bound[k]
        if any_lane(beyond):
            outcome = where(beyond, OUT_OF_RANGE, outcome)
            obs[k] = where(beyond, where(obs[k] > 0.0, task.bound[k], -task.bound[k]), obs[k])
    cp = sp = 0.0
    if model.at.object < model.at.end:
        cp, sp = cos(p[model.at.object + 2]), sin(p[model.at.object + 2])
    for g in range(len(model.grasp_arm) - 1, -1, -1):
        outcome = where(_gap(model, g, p, v, cp, sp, work) > limits.gap, GRASP_LOST, outcome)
        outcome = where(_elbow(model, model.grasp_arm[g], work.links) < limits.elbow, ARM_SINGULAR, outcome)
    for i in range(model.omega2.shape[0]):
        tip = abs(tip_deflection(task.actuators, model, i, p))
        outcome = where(tip > limits.tip * model.panel_length[i], TIP_RANGE, outcome)
    return outcome


@kernel
def _elbow(model, arm, links):
    """``|sin|`` of the angle between an arm's first link and the rest of it; 0 when it is singular."""
    first, last = model.arm_first[arm], model.arm_first[arm + 1]
    x = y = 0.0
    for k in range(first + 1, last):
        x += model.link_length[k] * links.c[k]
        y += model.link_length[k] * links.s[k]
    return abs(links.c[first] * y - links.s[first] * x) / max(sqrt(x * x + y * y), 1e-12)


@kernel
def _gap(model, g, p, v, cp, sp, work):
    """Distance of a gripper from its grasp point [m].

    cp, sp: cosine and sine of the object's angle; work: :class:`dynamics.Work` with the directions of ``p``.
    """
    o = model.at.object
    x, y, _, _ = arms.tip_motion(model, model.grasp_arm[g], v[2], work.links)
    cb, sb = work.yaw.cos[0], work.yaw.sin[0]
    gx, gy = model.grasp_point[g, 0], model.grasp_point[g, 1]
    dx = p[0] + cb * x - sb * y - p[o] - cp * gx + sp * gy
    dy = p[1] + sb * x + cb * y - p[o + 1] - sp * gx - cp * gy
    return sqrt(dx * dx + dy * dy)
