"""Inverse kinematics: joint angles with which the arms hold the object, and the nearest place where they can.

Base axes, so that the base's pose plays no part. With the unknowns ``y = (pose of the object, joint angles of the
grasping arms)`` the problem is

    minimise  cost(y)    such that  tip_g = x_o + R(phi) gamma_g,    sin^2(elbow) >= sin^2_least

solved by sequential quadratic programming (SciPy's SLSQP) from both bends of every elbow, with exact derivatives. The
cost asks for elbows that are bent well and for arms that point as they are mounted or as a guess has them; of a place
that is out of reach, for the nearest one.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator
from math import pi, remainder
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sffr_gym.config.params import Params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.types import Array

CLOSED = 1.0e-9  # m, gap of a solution; Newton's method closes the rest
MARGIN = 3.0  # times limits.arm_singularity that |sin| of an elbow keeps, so that an episode has room
ROOM = 1.3  # times that of a pose which is suggested, so that its digits as printed can be held
COMFORT, NEAR = 1.0, 0.01  # weights of a bent elbow and of the guess [1/rad2]
MOST_BENDS = 6  # arms of which every combination of bends is tried


class Held(NamedTuple):
    """Joint angles that hold the object."""

    joints: Array  #: (n_l,) of all arms [rad], in (-pi, pi] for the grasping ones
    pose: Array  #: (3,) the object's, base axes [m, m, rad]


class _Arm(NamedTuple):
    """A grasping arm."""

    name: str
    first: int  #: its first joint among all
    mount: complex  #: [m]
    angle: float  #: of its mount [rad]
    lengths: Array  #: (n,) of its links [m]
    point: complex  #: that it grasps, object's frame [m]


def reach(params: Params, pose: ArrayLike | None = None, guess: ArrayLike | None = None) -> Held:
    """Return joint angles with which the arms hold the object.

    Args:
        params: the robot, with an object.
        pose: where the object shall be, base axes (3,) [m, m, rad]; wherever it is held best if left out.
        guess: angles of all joints (n_l,) [rad] to stay near; those of arms that hold nothing are kept.

    Raises:
        ConfigError: if there is nothing to hold, or no such angles; of a given pose the message has the nearest one
            that can be held.
        ValueError: for another number of coordinates or joints, or what is no finite number.
    """
    if params.object is None:
        raise ConfigError("initial.reach: there is no object to hold: leave it null, or add an object")
    arms, joints = _grasping(params), _numbers("guess", np.zeros(params.n_links) if guess is None else guess)
    pose = None if pose is None else _numbers("pose", pose)
    for name, array, size in (("guess", joints, params.n_links), ("pose", pose, 3)):
        if array is not None and array.shape != (size,):
            raise ValueError(f"{name} must have shape ({size},), got {array.shape}")
    least = min(MARGIN * params.limits.arm_singularity, 0.9)
    found = _best(arms, joints, least, pose)
    if found is not None:
        return Held(*found)
    if pose is None:
        names = ", ".join(arm.name for arm in arms)
        raise ConfigError(
            f"initial.reach: {names} cannot all hold the object at once: longer links, mounts or grasp points that lie "
            "nearer, or a smaller limits.arm_singularity"
        )
    nearest = _best(arms, joints, min(ROOM * least, 0.95), pose, strict=False)
    advice = "no pose can be held" if nearest is None else f"the nearest that can be held is {_text(nearest[1])}"
    raise ConfigError(f"initial.reach = {_text(pose)}: the arms do not reach the object's grasp points there; {advice}")


@functools.lru_cache(maxsize=64)
def initial_joints(params: Params) -> tuple[float, ...]:
    """Return the joint angles of the configured start, solved for if ``initial.reach`` asks for that.

    Raises:
        ConfigError: see :func:`reach`.
    """
    given = params.initial.q[3:]
    if params.initial.reach is None:
        return given
    pose = None if params.initial.reach == "auto" else params.initial.reach
    return tuple(reach(params, pose, given or None).joints.tolist())


def _numbers(name: str, value: ArrayLike) -> Array:
    """Return an array of finite numbers of its own; raises ValueError for anything else."""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be a list of numbers, got {value!r}; left out it is found") from None
    if not np.isfinite(array).all():
        raise ValueError(f"{name} has entries that are not finite: {array.tolist()}")
    return array


def _grasping(params: Params) -> list[_Arm]:
    """Return the arms that grasp."""
    first = dict(zip((arm.name for arm in params.arms), _firsts(params), strict=True))
    by_name = {arm.name: arm for arm in params.arms}
    grasps = params.object.grasps if params.object else ()
    return [
        _Arm(
            grasp.arm, first[grasp.arm], complex(*by_name[grasp.arm].mount), by_name[grasp.arm].mount_angle,
            np.array([link.length for link in by_name[grasp.arm].links]), complex(*grasp.point),
        )
        for grasp in grasps
    ]  # fmt: skip


def _firsts(params: Params) -> list[int]:
    """Return the first joint of each arm."""
    return [0, *np.cumsum([len(arm.links) for arm in params.arms])[:-1].tolist()] if params.arms else []


def _best(
    arms: list[_Arm], joints: Array, least: float, pose: Array | None, strict: bool = True
) -> tuple[Array, Array] | None:
    """Return all joint angles and the object's pose of the best solution from all starts; None if there is none.

    Args:
        arms: that grasp.
        joints: the guess, of all joints.
        least: bound of |sin| of the elbows.
        pose: to be held, or None.
        strict: False: the nearest to ``pose`` that can be held.
    """
    own = np.concatenate([np.arange(arm.first, arm.first + len(arm.lengths)) for arm in arms])
    fixed = pose if strict else None
    best: tuple[float, Array] | None = None
    for start in _starts(arms, joints, pose):
        problem = _Problem(arms, joints[own], least, fixed, pose if not strict else None)
        y = problem.solve(start)
        if y is not None and (best is None or problem.cost(y)[0] < best[0] - 1e-9):
            best = problem.cost(y)[0], y
    if best is None:
        return None
    solved = joints.copy()
    solved[own] = (best[1][3:] + np.pi) % (2 * np.pi) - np.pi
    return solved, best[1][:3]


def _starts(arms: list[_Arm], joints: Array, pose: Array | None) -> Iterator[Array]:
    """Yield starts: the guess as it is, and both bends of every elbow."""
    middle = np.mean([arm.mount + 0.7 * arm.lengths.sum() * np.exp(1j * arm.angle) for arm in arms])
    where = np.array([middle.real, middle.imag, 0.0]) if pose is None else pose
    guess = np.concatenate([joints[arm.first : arm.first + len(arm.lengths)] for arm in arms])
    yield np.concatenate([where, guess])
    bends = itertools.product((1.0, -1.0), repeat=min(len(arms), MOST_BENDS))
    for signs in bends:
        parts = []
        for k, arm in enumerate(arms):
            sign, rest = signs[min(k, MOST_BENDS - 1)], np.zeros(len(arm.lengths))
            target = complex(where[0], where[1]) + np.exp(1j * where[2]) * arm.point - arm.mount
            rest[0], rest[1] = np.angle(target) - arm.angle - sign * 0.6, sign * 1.4
            parts.append(rest)
        yield np.concatenate([where, *parts])


class _Problem:
    """The program for one start; arguments as of :func:`_best`.

    Args:
        guess: angles of the grasping arms' joints.
        fixed: pose that must be held, or None.
        target: pose to be near, or None.
    """

    def __init__(self, arms: list[_Arm], guess: Array, least: float, fixed: Array | None, target: Array | None) -> None:
        self._arms, self._guess, self._least, self._fixed, self._target = arms, guess, least, fixed, target
        starts = np.cumsum([3, *(len(arm.lengths) for arm in arms)])
        self._spans = [slice(int(a), int(b)) for a, b in itertools.pairwise(starts)]
        self._elbows = [span.start + 1 for span in self._spans]
        self._size = float(sum(arm.lengths.sum() for arm in arms))

    def solve(self, start: Array) -> Array | None:
        """Return the unknowns of a solution, or None."""
        from scipy.optimize import minimize  # here, since it takes a third of the time of `import sffr_gym` to load

        constraints = [{"type": "eq", "fun": lambda y: self.gaps(y)[0], "jac": lambda y: self.gaps(y)[1]}]
        constraints += [{"type": "ineq", "fun": lambda y: self.bent(y)[0], "jac": lambda y: self.bent(y)[1]}]
        found = minimize(
            self.cost, start, jac=True, method="SLSQP", constraints=constraints, options={"maxiter": 200, "ftol": 1e-12}
        )
        y = np.asarray(found.x, dtype=float)
        for _ in range(5):  # Newton's steps of least size
            gaps, jacobian = self.gaps(y)
            y = y - np.linalg.pinv(jacobian) @ gaps
        closed = bool(np.isfinite(y).all()) and abs(self.gaps(y)[0]).max() < CLOSED * max(self._size, 1.0)
        return y if closed and self.bent(y)[0].min() > -1e-6 else None

    def cost(self, y: Array) -> tuple[float, Array]:
        """Return the cost and its gradient."""
        gradient = np.zeros_like(y)
        if self._target is not None:
            off = (y[:3] - self._target) * [1.0 / self._size, 1.0 / self._size, 0.3]
            gradient[:3] = 2 * off * [1.0 / self._size, 1.0 / self._size, 0.3]
            return float(off @ off), gradient
        turn = np.arctan2(np.sin(y[3:] - self._guess), np.cos(y[3:] - self._guess))
        cosines = np.cos(y[self._elbows])
        gradient[3:] = 2 * NEAR * turn
        gradient[self._elbows] -= 2 * COMFORT * cosines * np.sin(y[self._elbows])
        gradient[2] = 2 * NEAR * y[2]
        return float(COMFORT * cosines @ cosines + NEAR * (turn @ turn + y[2] ** 2)), gradient

    def gaps(self, y: Array) -> tuple[Array, Array]:
        """Return the gaps of the grasps, and of a pose that must be held, with their Jacobian."""
        rows, jacobian = [], []
        for arm, span in zip(self._arms, self._spans, strict=True):
            links = arm.lengths * np.exp(1j * (arm.angle + np.cumsum(y[span])))
            turned = np.exp(1j * y[2]) * arm.point
            row = np.zeros(len(y), dtype=complex)
            row[:3] = -1.0, -1.0j, -1.0j * turned
            row[span] = 1j * np.cumsum(links[::-1])[::-1]
            rows.append(arm.mount + links.sum() - complex(y[0], y[1]) - turned)
            jacobian.append(row)
        gap, J = np.array(rows), np.array(jacobian)
        parts, blocks = [gap.real, gap.imag], [J.real, J.imag]
        if self._fixed is not None:
            parts.append(y[:3] - self._fixed)
            blocks.append(np.eye(len(y))[:3])
        return np.concatenate(parts), np.vstack(blocks)

    def bent(self, y: Array) -> tuple[Array, Array]:
        """Return how much more than the least the elbows are bent, as squared sines, with the Jacobian."""
        jacobian = np.zeros((len(self._elbows), len(y)))
        for k, at in enumerate(self._elbows):
            jacobian[k, at] = np.sin(2 * y[at])
        return np.asarray(np.sin(y[self._elbows]) ** 2 - self._least**2), jacobian


def _text(pose: Array) -> str:
    """Return a pose as a file has it."""
    x, y, angle = pose.tolist()
    shown = x, y, remainder(angle, 2.0 * pi) if abs(angle) > 2.0 * pi else angle  # of the solver's
    return f"[{', '.join(f'{round(each, 4) + 0.0:g}' for each in shown)}]"
