"""Robots as rows of numbers: every environment of a batch has its own plant, and a kernel gets them all as two arrays.

A :class:`task.Robot` is some sixty arrays, whose way from Python into a kernel takes longer than a control period. Here
its numbers stand one after the other in the order of its fields, and a kernel looks at them through arrays again.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from sffr_gym._jit import kernel
from sffr_gym.actuators import Actuators
from sffr_gym.beam import Array
from sffr_gym.memory import Tape, matrix, number, tensor, vector
from sffr_gym.model import IntArray, Model
from sffr_gym.task import Robot


class Fleet(NamedTuple):
    """Robots of one structure: as many links, modes and channels, coupled alike; their numbers differ.

    Attributes:
        numbers: (n, ...) floats of each robot, or a single row if all are alike.
        integers: what they share: sizes, then indices and switches.
        staggered: the coupling; see ``model.Model``.
    """

    numbers: Array
    integers: IntArray
    staggered: tuple[bool, ...]


def make_fleet(robot: Robot, n: int = 1) -> Fleet:
    """``n`` rows that begin alike and may be replaced, or one row for any number of robots that stay alike."""
    numbers, integers = _flatten(robot)
    return Fleet(np.tile(numbers, (n, 1)), integers, robot.model.staggered)


def put_robot(fleet: Fleet, i: int, robot: Robot) -> None:
    """Replace a robot of the fleet.

    Raises:
        ValueError: for a robot of another structure.
    """
    numbers, integers = _flatten(robot)
    if not np.array_equal(integers, fleet.integers) or robot.model.staggered != fleet.staggered:
        raise ValueError(
            "the robots of a batch must have as many links, kept modes, stiff modes, channels and steps in a control "
            "period each; draw parameters that change none of them, or simulate these robots one by one"
        )
    fleet.numbers[i] = numbers


@kernel(allocates=True)
def robot_at(fleet, i, cursor):
    """Look at robot ``i``; the arrays belong to the fleet, which must stay alive.

    cursor: (2,) of integers, overwritten.
    """
    cursor[:] = 0
    x, k = Tape(fleet.numbers[min(i, len(fleet.numbers) - 1)], cursor[:1]), Tape(fleet.integers, cursor[1:])
    n_a, n_l, n_p, n_m, n_f, n_c = number(k), number(k), number(k), number(k), number(k), number(k)
    n_g, n_s, n_h, n_o, n_axial = number(k), number(k), number(k), number(k), number(k)
    model = Model(
        base_mass=number(x),
        base_inertia=number(x),
        arm_first=vector(k, n_a + 1),
        arm_mount=matrix(x, n_a, 3),
        link_mass=vector(x, n_l),
        link_inertia=vector(x, n_l),
        link_length=vector(x, n_l),
        link_com=vector(x, n_l),
        panel_root=matrix(x, n_p, 2),
        panel_axis=matrix(x, n_p, 2),
        panel_inertia=matrix(x, n_p, 3),
        n_axial=number(k),
        omega2=matrix(x, n_p, n_m),
        damping=matrix(x, n_p, n_m),
        translation=matrix(x, n_p, n_m),
        rotation=matrix(x, n_p, n_m),
        gyro=tensor(x, n_p, n_m - n_axial, n_axial),
        shapes=tensor(x, n_p, n_f, n_m),
        inverse=tensor(x, n_p, n_m, n_f),
        object_mass=number(x),
        object_inertia=number(x),
        grasp_arm=vector(k, n_g),
        grasp_point=matrix(x, n_g, 2),
        staggered=fleet.staggered,
        baumgarte=number(x),
        longest_step=number(x),
        stiff=matrix(k, n_s, 3),
        stiff_omega=vector(x, n_s),
        eta=number(x),
    )
    n_u = n_p * n_c + 3 + n_l
    actuators = Actuators(
        limit=vector(x, n_u),
        K_PZ=tensor(x, n_p, 3, n_c),
        allocation=tensor(x, n_p, n_c, 3),
        gain=matrix(x, n_p, n_c),
        reach=tensor(x, n_p, n_m, n_c),
        tips=tensor(x, n_p, n_m, 3),
    )
    return Robot(
        model=model,
        actuators=actuators,
        held=vector(k, n_h),
        period=number(x),
        steps=number(k),
        integrator=number(k),
        limit=vector(x, 3),
        scale=vector(x, n_u),
        bound=vector(x, n_o),
        weight=vector(x, 3),
    )


def _flatten(robot: Robot) -> tuple[Array, IntArray]:
    """Numbers and integers of a robot in the order in which :func:`robot_at` takes them."""
    model = robot.model
    n_p, n_f, n_m = model.shapes.shape
    sizes = (
        len(model.arm_mount), len(model.link_mass), n_p, n_m, n_f, robot.actuators.gain.shape[1],
        len(model.grasp_arm), len(model.stiff), len(robot.held), len(robot.bound), model.n_axial,
    )  # fmt: skip
    leaves = [np.ravel(leaf) for leaf in _leaves(robot._replace(model=model._replace(staggered=())))]
    numbers = [leaf for leaf in leaves if leaf.dtype.kind == "f"]
    integers = [leaf for leaf in leaves if leaf.dtype.kind != "f"]
    return np.concatenate(numbers), np.concatenate([sizes, *integers]).astype(np.int64)


def _leaves(value: Any) -> list[Any]:
    """Fields of nested tuples, depth first."""
    return [leaf for field in value for leaf in _leaves(field)] if isinstance(value, tuple) else [value]
