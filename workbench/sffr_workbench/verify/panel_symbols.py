"""The panel's equations of motion derived by SymPy from its kinetic and strain energy (Eqs. 44, 45, 47, 48).

One Hermite element in a floating frame; Eq. 44 is the element that starts at the root with its near node clamped.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import sympy as sp

from sffr_gym.physics.beam import N_TIP
from sffr_gym.types import Array


class Element(NamedTuple):
    """Symbols and equations ``M qdd + K q = Q_e + Q_v`` of one element.

    Attributes:
        numbers: start (distance of the element from the root), length, mass, EA, EI.
        q, qd: (9,) root x, y, angle delta, then (u, w, slope) of the near and of the far node, and rates.
        M, K: (9, 9); Q_v: (9, 1).
        T, V: kinetic and strain energy.
    """

    numbers: tuple[sp.Symbol, ...]
    q: tuple[sp.Symbol, ...]
    qd: tuple[sp.Symbol, ...]
    M: sp.Matrix
    K: sp.Matrix
    Q_v: sp.Matrix
    T: sp.Expr
    V: sp.Expr


@cache
def element() -> Element:
    """Derive the equations of Lagrange of one element.

    A point at xi has the place ``(start + length xi + u, w)`` in the panel's axes and the velocity of the root, turned
    into these axes, plus that of the rotation, plus that of the displacement; every integrand is a polynomial in xi.
    """
    numbers = sp.symbols("start length m EA EI", positive=True)
    start, length, mass, EA, EI = numbers
    q = sp.symbols("x y delta u0 w0 s0 u1 w1 s1", real=True)
    qd = sp.symbols("xd yd deltad u0d w0d s0d u1d w1d s1d", real=True)
    xi = sp.Symbol("xi", real=True)
    U, W = _shape_functions(xi, length)
    c, s = sp.cos(q[2]), sp.sin(q[2])
    u, w = U.dot(q[3:]), W.dot(q[3:])
    along, across = start + length * xi + u, w
    v_x = c * qd[0] + s * qd[1] - qd[2] * across + U.dot(qd[3:])
    v_y = c * qd[1] - s * qd[0] + qd[2] * along + W.dot(qd[3:])
    T = sp.expand(mass / 2 * _mean(v_x**2 + v_y**2, xi))
    V = sp.expand(
        length / 2 * _mean(EA * (sp.diff(u, xi) / length) ** 2 + EI * (sp.diff(w, xi, 2) / length**2) ** 2, xi)
    )
    momenta = sp.Matrix([sp.diff(T, rate) for rate in qd])
    # d/dt (dT/dqd) - dT/dq + dV/dq = Q_e, of which M qdd and K q stay on the left.
    Q_v = sp.Matrix([sp.diff(T, coordinate) for coordinate in q]) - momenta.jacobian(q) * sp.Matrix(qd)
    return Element(numbers, q, qd, momenta.jacobian(qd), sp.hessian(V, q), Q_v, T, V)


@cache
def clamped() -> Element:
    """Return the paper's panel: one element, near node at rest; (6,) coordinates x, y, delta, q4, q5, q6."""
    e = element()
    start, length, mass, EA, EI = e.numbers
    L = sp.Symbol("L", positive=True)
    q = (*e.q[:3], *sp.symbols("q4:7", real=True))
    qd = (*e.qd[:3], *sp.symbols("q4d q5d q6d", real=True))
    kept = [0, 1, 2, 6, 7, 8]
    values: dict[Any, Any] = {start: 0, length: L}
    for old, new in ((e.q, q), (e.qd, qd)):
        values |= dict.fromkeys(old[3:6], 0) | dict(zip(old[6:], new[3:], strict=True))
    M, K = (matrix.extract(kept, kept).subs(values) for matrix in (e.M, e.K))
    Q_v = e.Q_v.extract(kept, [0]).subs(values)
    return Element((sp.Integer(0), L, mass, EA, EI), q, qd, M, K, Q_v, e.T.subs(values), e.V.subs(values))


def vanishes(expression: sp.Expr) -> bool:
    """Decide whether an expression of polynomials, sines and cosines is zero."""
    return sp.expand(sp.trigsimp(sp.expand(expression))) == 0


def assembled(
    numbers: tuple[float, float, float, float], elements: int, delta: float, delta_d: float, qf: Array, qfd: Array
) -> tuple[Array, Array, Array]:
    """Sum :func:`element` to M and K (3 + n_f, 3 + n_f) and Q_v (3 + n_f,) of a panel of several elements.

    Args:
        numbers: mass [kg], length [m], EA [N] and EI [N m2] of the panel.
        elements: how many.
        delta: angle of the panel [rad].
        delta_d: its rate [rad/s].
        qf: (n_f,) nodal coordinates, root node left out.
        qfd: (n_f,) their rates.
    """
    mass, length, EA, EI = numbers
    size, n = length / elements, 3 + N_TIP * (elements + 1)
    M, K, Q_v = np.zeros((n, n)), np.zeros((n, n)), np.zeros(n)
    nodes, rates = np.concatenate([np.zeros(N_TIP), qf]), np.concatenate([np.zeros(N_TIP), qfd])
    for k in range(elements):
        own = slice(N_TIP * k, N_TIP * (k + 2))
        place = np.r_[0:3, 3 + N_TIP * k : 3 + N_TIP * (k + 2)]
        arguments = (k * size, size, mass / elements, EA, EI, delta, delta_d, *nodes[own], *rates[own])
        parts = [np.array(function(*arguments)) for function in _functions()]
        M[np.ix_(place, place)] += parts[0].reshape(9, 9)
        K[np.ix_(place, place)] += parts[1].reshape(9, 9)
        Q_v[place] += parts[2]
    kept = np.r_[0:3, 3 + N_TIP : n]
    return M[np.ix_(kept, kept)], K[np.ix_(kept, kept)], Q_v[kept]


def _shape_functions(xi: sp.Symbol, length: sp.Symbol) -> tuple[sp.Matrix, sp.Matrix]:
    """Return the rows of S over both nodes' (u, w, slope); the far node's columns are Eq. 44."""
    U = sp.Matrix([[1 - xi, 0, 0, xi, 0, 0]])
    W = sp.Matrix([[
        0, 1 - 3 * xi**2 + 2 * xi**3, length * (xi - 2 * xi**2 + xi**3),
        0, 3 * xi**2 - 2 * xi**3, length * (xi**3 - xi**2),
    ]])  # fmt: skip
    return U, W


def _mean(integrand: sp.Expr, xi: sp.Symbol) -> sp.Expr:
    """Return the integral of a polynomial in xi from 0 to 1."""
    return sum(coefficient / (power[0] + 1) for power, coefficient in sp.Poly(sp.expand(integrand), xi).terms())


@cache
def _functions() -> tuple[Callable[..., list[float]], ...]:
    """Compile M, K and Q_v of an element over its numbers, delta, its rate, both nodes' coordinates and rates."""
    e = element()
    arguments = [*e.numbers, e.q[2], e.qd[2], *e.q[3:], *e.qd[3:]]
    still = dict.fromkeys(e.qd[:2], 0)  # Q_v does not depend on the root's velocity
    parts = (e.M, e.K, e.Q_v.applyfunc(lambda entry: sp.trigsimp(sp.expand(entry)).subs(still)))
    return tuple(sp.lambdify(arguments, list(part), "math", cse=True) for part in parts)
