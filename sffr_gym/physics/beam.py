"""Finite-element matrices of a flexible panel and their clamped modes (Eqs. 44, 45 and 47 for any number of elements).

Each element has linear axial and cubic Hermite transverse shape functions; the root is clamped. Nodal coordinates run
``(u, w, slope)`` node by node, the tip last, so that one element gives the paper's ``(q4, q5, q6)``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, eigh

from sffr_gym.config.sections import Panel
from sffr_gym.types import Array

N_TIP = 3  # elastic coordinates of one node: axial, transverse, slope (the kernels read this number)


class Beam(NamedTuple):
    """Constant shape integrals of one panel in its own axes (x along the undeformed panel, y across it).

    ``U(x)`` and ``W(x)`` are the axial and transverse shape functions, (n_f,) each.
    """

    mass: float  #: panel mass [kg]
    first_moment: float  #: integral of rho a x [kg m]
    second_moment: float  #: integral of rho a x^2 [kg m2]
    M_ff: Array  #: (n_f, n_f) mass matrix, integral of rho a (U U' + W W')
    K: Array  #: (n_f, n_f) stiffness matrix, Eq. 47
    S_x: Array  #: (n_f,) integrals of rho a U and rho a W (translation coupling)
    S_y: Array  #: (n_f,)
    c_x: Array  #: (n_f,) integrals of rho a x U and rho a x W (rotation coupling)
    c_y: Array  #: (n_f,)
    N: Array  #: (n_f, n_f) integral of rho a W U' (gyroscopic coupling)


class Modes(NamedTuple):
    """Clamped modes of a panel, mass-normalised, axial ones first."""

    omega: Array  #: (n_m,) natural angular frequencies [rad/s]
    n_axial: int  #: number of axial modes
    shapes: Array  #: (n_f, n_m) nodal coordinates of each mode; the transverse (axial) tip displacement is positive


def shape_functions(xi: float, length: float) -> tuple[Array, Array, Array, Array, Array]:
    """Return the shape functions (Eq. 44) of one element, both nodes kept, and their derivatives.

    Args:
        xi: position in the element, 0 to 1 [-].
        length: element length [m].

    Returns:
        ``U, W, dU/dx, dW/dx, d2W/dx2``: (6,) each, over the coordinates ``(u1, w1, slope1, u2, w2, slope2)``.
    """
    s = length
    U = np.array([1 - xi, 0, 0, xi, 0, 0])
    W = np.array(
        [0, 1 - 3 * xi**2 + 2 * xi**3, s * (xi - 2 * xi**2 + xi**3), 0, 3 * xi**2 - 2 * xi**3, s * (xi**3 - xi**2)]
    )
    dU = np.array([-1, 0, 0, 1, 0, 0]) / s
    bend = 6 * (xi - xi**2)
    dW = np.array([0, -bend / s, 1 - 4 * xi + 3 * xi**2, 0, bend / s, 3 * xi**2 - 2 * xi])
    d2W = np.array([0, -6 + 12 * xi, s * (-4 + 6 * xi), 0, 6 - 12 * xi, s * (6 * xi - 2)]) / s**2
    return U, W, dU, dW, d2W


def beam(mass: float, length: float, EI: float, EA: float, elements: int) -> Beam:
    """Return the integrals of the shape functions over a clamped panel.

    Args:
        mass: panel mass [kg].
        length: panel length [m].
        EI: bending stiffness [N m2].
        EA: axial stiffness [N].
        elements: number of equal elements [-].
    """
    step, density = length / elements, mass / length
    size = N_TIP * (elements + 1)
    M_ff, K, N = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size))
    S_x, S_y, c_x, c_y = np.zeros(size), np.zeros(size), np.zeros(size), np.zeros(size)
    points, weights = np.polynomial.legendre.leggauss(4)  # exact to degree 7, the integrands have 6
    for element in range(elements):
        nodes = slice(N_TIP * element, N_TIP * (element + 2))
        for xi, weight in zip((points + 1) / 2, weights / 2 * step, strict=True):
            U, W, dU, _, d2W = shape_functions(xi, step)
            dm, x = density * weight, step * (element + xi)
            M_ff[nodes, nodes] += dm * (np.outer(U, U) + np.outer(W, W))
            N[nodes, nodes] += dm * np.outer(W, U)
            K[nodes, nodes] += weight * (EA * np.outer(dU, dU) + EI * np.outer(d2W, d2W))
            S_x[nodes] += dm * U
            S_y[nodes] += dm * W
            c_x[nodes] += dm * x * U
            c_y[nodes] += dm * x * W
    free = slice(N_TIP, None)  # the root node is clamped
    return Beam(
        mass, mass * length / 2, mass * length**2 / 3, M_ff[free, free], K[free, free],
        S_x[free], S_y[free], c_x[free], c_y[free], N[free, free],
    )  # fmt: skip


def one_element_beam(panel: Panel) -> Beam:
    """Return the paper's panel of one element, whose nodal coordinates are those of the tip: q4, q5 and q6."""
    return beam(panel.mass, panel.length, panel.EI, panel.E * panel.area, elements=1)


def section_motion(length: float, elements: int, place: float) -> tuple[Array, Array]:
    """Return axial displacement and slope, (n_f,) each, of a section of the panel for unit nodal coordinates.

    Args:
        length: panel length [m].
        elements: number of equal elements [-].
        place: of the section, as a part of the length [-].
    """
    element = min(int(place * elements), elements - 1)
    U, _, _, dW, _ = shape_functions(place * elements - element, length / elements)
    displacement, slope = np.zeros((2, N_TIP * (elements + 1)))
    nodes = slice(N_TIP * element, N_TIP * (element + 2))
    displacement[nodes], slope[nodes] = U, dW
    return displacement[N_TIP:], slope[N_TIP:]


def clamped_modes(panel: Beam, axial_cut: float, bending_cut: float) -> Modes:
    """Return the modes of ``K phi = omega^2 M_ff phi``, of each family up to its cut [rad/s].

    Axial and bending motion of a straight panel are uncoupled, so each family is solved by itself.
    """
    size = len(panel.S_x)
    axial = np.arange(0, size, N_TIP)
    bending = np.setdiff1d(np.arange(size), axial)
    omega_a, shapes_a = _family(panel, axial, tip=axial[-1], cut=axial_cut)
    omega_b, shapes_b = _family(panel, bending, tip=size - 2, cut=bending_cut)
    shapes = block_diag(shapes_a, shapes_b)
    order = np.argsort(np.concatenate([axial, bending]))
    return Modes(np.concatenate([omega_a, omega_b]), len(omega_a), shapes[order])


def slowest_modes(panel: Beam, like: Modes) -> Modes:
    """Return as many of the slowest modes of each family as another panel of as many elements has."""
    every = clamped_modes(panel, np.inf, np.inf)
    first, count = every.n_axial, len(like.omega) - like.n_axial
    kept = np.r_[0 : like.n_axial, first : first + count]
    return Modes(every.omega[kept], like.n_axial, np.ascontiguousarray(every.shapes[:, kept]))


def _family(panel: Beam, coordinates: NDArray[np.intp], tip: int, cut: float) -> tuple[Array, Array]:
    """Return the modes of one family of coordinates, signed by the displacement of nodal coordinate ``tip``."""
    block = np.ix_(coordinates, coordinates)
    squares, shapes = eigh(panel.K[block], panel.M_ff[block])
    omega = np.sqrt(squares)
    kept = omega <= cut
    row = int(np.flatnonzero(coordinates == tip)[0])
    return omega[kept], shapes[:, kept] * np.sign(shapes[row, kept])
