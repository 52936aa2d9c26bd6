"""Robots as rows of numbers: every environment of a batch has its own plant, and a kernel gets them all as two arrays.

A :class:`task.Robot` is some sixty arrays, whose way from Python into a kernel takes longer than a control period. Here
its numbers stand one after the other in the order of its fields, and a kernel looks at them through arrays again.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import config
from numba.core import cgutils, types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from sffr_gym._jit import kernel
from sffr_gym.actuators import Actuators
from sffr_gym.beam import Array
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


class Reader(NamedTuple):
    """A place in a row from which the next number or array is taken."""

    data: Array
    at: IntArray  # (1,)


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
    x, k = Reader(fleet.numbers[min(i, len(fleet.numbers) - 1)], cursor[:1]), Reader(fleet.integers, cursor[1:])
    n_a, n_l, n_p, n_m, n_f, n_c = _next(k), _next(k), _next(k), _next(k), _next(k), _next(k)
    n_g, n_s, n_h, n_o, n_axial = _next(k), _next(k), _next(k), _next(k), _next(k)
    model = Model(
        base_mass=_next(x),
        base_inertia=_next(x),
        arm_first=_vector(k, n_a + 1),
        arm_mount=_matrix(x, n_a, 3),
        link_mass=_vector(x, n_l),
        link_inertia=_vector(x, n_l),
        link_length=_vector(x, n_l),
        link_com=_vector(x, n_l),
        panel_root=_matrix(x, n_p, 2),
        panel_axis=_matrix(x, n_p, 2),
        panel_inertia=_matrix(x, n_p, 3),
        n_axial=_next(k),
        omega2=_matrix(x, n_p, n_m),
        damping=_matrix(x, n_p, n_m),
        translation=_matrix(x, n_p, n_m),
        rotation=_matrix(x, n_p, n_m),
        gyro=_tensor(x, n_p, n_m - n_axial, n_axial),
        shapes=_tensor(x, n_p, n_f, n_m),
        inverse=_tensor(x, n_p, n_m, n_f),
        object_mass=_next(x),
        object_inertia=_next(x),
        grasp_arm=_vector(k, n_g),
        grasp_point=_matrix(x, n_g, 2),
        staggered=fleet.staggered,
        baumgarte=_next(x),
        longest_step=_next(x),
        stiff=_matrix(k, n_s, 3),
        stiff_omega=_vector(x, n_s),
        eta=_next(x),
    )
    n_u = n_p * n_c + 3 + n_l
    actuators = Actuators(
        limit=_vector(x, n_u),
        K_PZ=_tensor(x, n_p, 3, n_c),
        allocation=_tensor(x, n_p, n_c, 3),
        gain=_matrix(x, n_p, n_c),
        reach=_tensor(x, n_p, n_m, n_c),
        tips=_tensor(x, n_p, n_m, 3),
    )
    return Robot(
        model=model,
        actuators=actuators,
        held=_vector(k, n_h),
        period=_next(x),
        steps=_next(k),
        integrator=_next(k),
        limit=_vector(x, 3),
        scale=_vector(x, n_u),
        bound=_vector(x, n_o),
        weight=_vector(x, 3),
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


@kernel(inline=True, allocates=True)
def _next(reader):
    at = reader.at[0]
    reader.at[0] = at + 1
    return reader.data[at]


@kernel(inline=True, allocates=True)
def _vector(reader, n):
    at = reader.at[0]
    reader.at[0] = at + n
    return _borrow(reader.data, at, (n,))


@kernel(inline=True, allocates=True)
def _matrix(reader, n, m):
    at = reader.at[0]
    reader.at[0] = at + n * m
    return _borrow(reader.data, at, (n, m))


@kernel(inline=True, allocates=True)
def _tensor(reader, n, m, k):
    at = reader.at[0]
    reader.at[0] = at + n * m * k
    return _borrow(reader.data, at, (n, m, k))


if config.DISABLE_JIT:

    def _borrow(data: Any, at: Any, shape: Any) -> Any:
        return data[at : at + int(np.prod(shape))].reshape(shape)

else:

    @intrinsic
    def _borrow(typingctx: Any, data: Any, at: Any, shape: Any) -> Any:
        """An array of a shape over ``data`` (1-D, contiguous) from an index on, without a share in its ownership."""
        result = types.Array(data.dtype, len(shape), "C")

        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            source = make_array(data)(context, builder, arguments[0])
            dims = cgutils.unpack_tuple(builder, arguments[2])
            size = context.get_abi_sizeof(context.get_data_type(data.dtype))
            strides: list[Any] = []
            step = context.get_constant(types.intp, size)
            for dim in reversed(dims):
                strides.insert(0, step)
                step = builder.mul(step, dim)
            array = make_array(result)(context, builder)
            populate_array(
                array, data=builder.gep(source.data, [arguments[1]]), shape=dims, strides=strides,
                itemsize=context.get_constant(types.intp, size), meminfo=None,
            )  # fmt: skip
            return array._getvalue()

        return result(data, at, shape), codegen
