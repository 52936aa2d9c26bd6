"""A panel that keeps its length as it bends: the terms that a linear beam leaves out.

A point at ``x`` is drawn towards the root by ``s = b' G(x) b / 2``, with the bending amplitudes ``b`` and ``G(x)`` the
integral of ``W' W'^T`` up to it; the curvature is ``w'' / sqrt(1 - w'^2)``. In panel axes, whose root accelerates by
``(ax, ay)`` and which turn at the rate ``w``, a point accelerates by::

    x:  ax - alpha y - w^2 (x - s) - 2 w yd - (b'G bdd + bd'G bd)      y = W b
    y:  ay + alpha (x - s) - w^2 y - 2 w sd + W bdd

By d'Alembert's principle ``bdd`` follows, and what the root feels. The linear beam's part of the sums is integrated
exactly, as in ``panel``; what the inward motion adds is summed over a few points of mass, of the slowest modes alone:
that of the faster ones lies far below what is left out anyway. A spinning panel stiffens by it, by ``w^2`` times the
integral of ``rho a x G``, where a linear one softens.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sffr_gym.compile.kernels import kernel
from sffr_gym.config.sections import Panel
from sffr_gym.physics.beam import N_TIP, Modes, shape_functions
from sffr_gym.types import Array

if TYPE_CHECKING:
    from sffr_gym.physics.model import Model

SLOWEST = 3  # modes that have terms of second order
POINTS = 4  # of mass along a panel, and of its strain, by Gauss


class Foreshortening(NamedTuple):
    """Points of each panel and its shapes there, of the slowest modes; of no length for linear panels.

    There is room for ``SLOWEST`` modes, zeros where a panel has fewer: compilers unroll loops of a known length.
    """

    mass: Array  #: (n_p, n_q) of each point [kg]
    x: Array  #: (n_p, n_q) its distance from the root [m]
    W: Array  #: (n_p, n_q, n_b) transverse displacement of each mode there
    G: Array  #: (n_p, n_q, n_b, n_b) integral of W' W'^T up to it
    tip: Array  #: (n_p, n_b, n_b) the same of the tip
    stiffness: Array  #: (n_p, n_q) EI times the length that a point stands for [N m3]
    slope: Array  #: (n_p, n_q, n_b) W' and W'' there
    bend: Array  #: (n_p, n_q, n_b)


class Bent(NamedTuple):
    """Memory of one panel's equations."""

    b: Array  #: (n_b,) amplitudes and rates of the slowest modes
    bd: Array  #: (n_b,)
    f: Array  #: (n_b,) their forces beside those of a linear panel
    mass: Array  #: (n_b, n_b) mass matrix in its lower triangle, then its Cholesky factor
    Gb: Array  #: (n_q, n_b) how each point moves inwards with each mode
    s: Array  #: (n_q,) how far each has moved [m], and sideways [m]
    y: Array  #: (n_q,)
    inward: Array  #: (n_q,) forces of the points' acceleration along and across, less those of the root's [N]
    across: Array  #: (n_q,)
    along: Array  #: (n_b,) coupling with the root's acceleration along the panel
    turn: Array  #: (n_b,) rotation coupling beside that of a linear panel


def foreshortening_shapes(n_p, n_b):
    """Shapes of :class:`Foreshortening` for so many panels and modes of second order, of these 0 for linear ones."""
    n_q = POINTS if n_b else 0
    return Foreshortening(
        mass=(n_p, n_q), x=(n_p, n_q), W=(n_p, n_q, n_b), G=(n_p, n_q, n_b, n_b), tip=(n_p, n_b, n_b),
        stiffness=(n_p, n_q), slope=(n_p, n_q, n_b), bend=(n_p, n_q, n_b),
    )  # fmt: skip


def bent_shapes(model):
    """Shapes of :class:`Bent` for a robot."""
    n_b = model.foreshortening.tip.shape[1]
    n_q = POINTS if n_b else 0
    return Bent(
        b=(n_b,), bd=(n_b,), f=(n_b,), mass=(n_b, n_b), Gb=(n_q, n_b), s=(n_q,), y=(n_q,), inward=(n_q,),
        across=(n_q,), along=(n_b,), turn=(n_b,),
    )  # fmt: skip


def make_foreshortening(panels: Sequence[Panel], modes: Sequence[Modes]) -> Foreshortening:
    """Return the points of panels.

    Args:
        panels: the panels.
        modes: clamped modes of each, none of them axial.
    """
    parts = [_points(panel, own) for panel, own in zip(panels, modes, strict=True)]
    stacked = [np.array(arrays) for arrays in zip(*parts, strict=True)]
    return Foreshortening(*stacked) if parts else no_foreshortening(0, SLOWEST)


def no_foreshortening(n_p: int, n_b: int = 0) -> Foreshortening:
    """Return zeros: of no length for so many linear panels."""
    return Foreshortening(*(np.zeros(shape) for shape in foreshortening_shapes(n_p, n_b)))


def _points(panel: Panel, modes: Modes) -> Foreshortening:
    """Return the points of one panel, without the first axis of :class:`Foreshortening`."""
    slow = modes.shapes[:, :SLOWEST]
    shapes = np.pad(slow, ((N_TIP, 0), (0, SLOWEST - slow.shape[1])))
    places, weights = np.polynomial.legendre.leggauss(POINTS)
    places, weights = (places + 1.0) / 2.0, weights / 2.0
    W, slope, bend = map(np.array, zip(*(_shapes_at(shapes, place, panel) for place in places), strict=True))
    return Foreshortening(
        mass=weights * panel.mass, x=places * panel.length, W=W,
        G=np.array([_inward(shapes, place, panel) for place in places]), tip=_inward(shapes, 1.0, panel),
        stiffness=weights * panel.length * panel.EI, slope=slope, bend=bend,
    )  # fmt: skip


def _shapes_at(shapes: Array, place: float, panel: Panel) -> tuple[Array, Array, Array]:
    """Return W, W' and W'' (n_b,) at a place, a part of the length; shapes: (n_f, n_b) nodal, root first."""
    element = min(int(place * panel.elements), panel.elements - 1)
    own = shapes[N_TIP * element : N_TIP * (element + 2)]
    _, W, _, dW, d2W = shape_functions(place * panel.elements - element, panel.length / panel.elements)
    return W @ own, dW @ own, d2W @ own


def _inward(shapes: Array, place: float, panel: Panel) -> Array:
    """Return the integral of ``W' W'^T`` (n_b, n_b) from the root to a place; arguments as before."""
    total, points, weights = np.zeros((shapes.shape[1],) * 2), *np.polynomial.legendre.leggauss(3)  # of degree 4: exact
    ends = np.append(np.arange(0.0, place, 1.0 / panel.elements), place)
    for start, stop in pairwise(ends):
        for point, weight in zip((points + 1.0) / 2.0, weights / 2.0, strict=True):
            _, slope, _ = _shapes_at(shapes, start + (stop - start) * point, panel)
            total += weight * (stop - start) * panel.length * np.outer(slope, slope)
    return total


@kernel
def condense_bent(model, i, p, v, tau, yaw_rate, panels):
    """Eliminate the elastic accelerations of foreshortened panel ``i``; see :func:`sffr_gym.physics.panel.condense`."""
    bent, n_m = panels.bent, model.omega2.shape[1]
    start = model.at.modes + i * n_m
    b, bd, w, w2 = p[start : start + n_m], v[start : start + n_m], yaw_rate, yaw_rate * yaw_rate
    S_y, c_y, f = model.translation[i], model.rotation[i], panels.f[i]
    first_y = first_yd = square = coriolis = 0.0
    for j in range(n_m):
        f[j] = tau[start + j] - model.omega2[i, j] * b[j] - model.damping[i, j] * bd[j] + w2 * b[j]
        first_y += S_y[j] * b[j]
        first_yd += S_y[j] * bd[j]
        square += b[j] * b[j]
        coriolis += b[j] * bd[j]
    n_b = min(n_m, SLOWEST)
    for j in range(SLOWEST):
        bent.b[j], bent.bd[j] = (b[j], bd[j]) if j < n_b else (0.0, 0.0)
    drawn, drift, curl, turning, moment = _move_inward(model.foreshortening, i, w, bent)
    _stiffen(model.foreshortening, i, bent)
    _factor(bent.mass)
    along, across, turn = panels.along[i], panels.across[i], panels.turn[i]
    for j in range(n_m):
        along[j], across[j], turn[j] = 0.0, S_y[j], c_y[j]
        if j < n_b:
            f[j] += bent.f[j]
            along[j], turn[j] = bent.along[j], turn[j] + bent.turn[j]
    _solve(bent.mass, n_b, f)
    _solve(bent.mass, n_b, along)
    _solve(bent.mass, n_b, across)
    _solve(bent.mass, n_b, turn)
    first_x = model.panel_first_moment[i] - drawn
    Mxx = Myy = model.panel_mass[i]
    Mxy, hx, hy, J = 0.0, -first_y, first_x, model.panel_second_moment[i] + turning + square
    px = -w2 * first_x - 2.0 * w * first_yd - curl
    py = -w2 * first_y - 2.0 * w * drift
    moment += 2.0 * w * coriolis
    for j in range(n_m):
        Myy -= S_y[j] * across[j]
        hy -= S_y[j] * turn[j]
        py += S_y[j] * f[j]
        rotation = c_y[j]
        if j < n_b:
            rotation += bent.turn[j]
            Mxx -= bent.along[j] * along[j]
            Mxy -= bent.along[j] * across[j]
            hx -= bent.along[j] * turn[j]
            px += bent.along[j] * f[j]
        J -= rotation * turn[j]
        moment += rotation * f[j]
    root = panels.root
    root.M_xx[i], root.M_xy[i], root.M_yy[i], root.h_x[i], root.h_y[i], root.J[i] = Mxx, Mxy, Myy, hx, hy, J
    root.p_x[i], root.p_y[i], root.moment[i] = px, py, moment


@kernel
def _move_inward(points, i, w, bent):
    """Sum what the inward motion of the points adds to a panel's equations.

    points: :class:`Foreshortening`; i: index of the panel; w: yaw rate [rad/s].
    bent: :class:`Bent` with amplitudes and rates; its forces, mass matrix and couplings are written.

    Returns ``m s``, ``m sd``, ``m bd'G bd``, ``m s (s - 2 x)`` and the moment about the root.
    """
    b, bd = bent.b, bent.bd
    drawn = drift = curls = turning = moment = 0.0
    for q in range(POINTS):
        mass, x, s, sd, curl, y, yd = points.mass[i, q], points.x[i, q], 0.0, 0.0, 0.0, 0.0, 0.0
        for j in range(SLOWEST):
            Gb = Gbd = 0.0
            for k in range(SLOWEST):
                Gb += points.G[i, q, j, k] * b[k]
                Gbd += points.G[i, q, j, k] * bd[k]
            bent.Gb[q, j] = Gb
            s += 0.5 * b[j] * Gb
            sd += bd[j] * Gb
            curl += bd[j] * Gbd
            y += points.W[i, q, j] * b[j]
            yd += points.W[i, q, j] * bd[j]
        bent.s[q], bent.y[q] = s, y
        bent.inward[q], bent.across[q] = mass * (w * (w * (s - x) - 2.0 * yd) - curl), 2.0 * mass * w * sd
        drawn += mass * s
        drift += mass * sd
        curls += mass * curl
        turning += mass * s * (s - 2.0 * x)
        moment += mass * (y * curl - 2.0 * w * (x - s) * sd)
    for j in range(SLOWEST):
        f = along = turn = 0.0
        for q in range(POINTS):
            momentum = points.mass[i, q] * bent.Gb[q, j]
            f += bent.inward[q] * bent.Gb[q, j] + bent.across[q] * points.W[i, q, j]
            along -= momentum
            turn += bent.y[q] * momentum - points.mass[i, q] * bent.s[q] * points.W[i, q, j]
        bent.f[j], bent.along[j], bent.turn[j] = f, along, turn
        for k in range(j + 1):
            mass = 1.0 if k == j else 0.0
            for q in range(POINTS):
                mass += points.mass[i, q] * bent.Gb[q, j] * bent.Gb[q, k]
            bent.mass[j, k] = mass
    return drawn, drift, curls, turning, moment


@kernel
def _stiffen(points, i, bent):
    """Add the forces of the strain energy ``EI w''^2 w'^2 / 2``, which the exact curvature adds, to ``bent.f``."""
    for q in range(POINTS):
        slope = bend = 0.0
        for j in range(SLOWEST):
            slope += points.slope[i, q, j] * bent.b[j]
            bend += points.bend[i, q, j] * bent.b[j]
        moment = points.stiffness[i, q] * bend * slope
        for j in range(SLOWEST):
            bent.f[j] -= moment * (slope * points.bend[i, q, j] + bend * points.slope[i, q, j])


@kernel
def _factor(A):
    """Cholesky factor of a symmetric matrix in its lower triangle, in place; the diagonal holds its reciprocals."""
    for j in range(SLOWEST):
        for k in range(j):
            A[j, j] -= A[j, k] * A[j, k]
        A[j, j] = 1.0 / sqrt(A[j, j])
        for i in range(j + 1, SLOWEST):
            for k in range(j):
                A[i, j] -= A[i, k] * A[j, k]
            A[i, j] *= A[j, j]


@kernel
def _solve(L, n, x):
    """Solve ``L L' x = x`` for the first ``n`` numbers, in place."""
    for j in range(n):
        for k in range(j):
            x[j] -= L[j, k] * x[k]
        x[j] *= L[j, j]
    for j in range(n - 1, -1, -1):
        for k in range(j + 1, n):
            x[j] -= L[k, j] * x[k]
        x[j] *= L[j, j]


@kernel
def tip_foreshortening(model, i, p, v):
    """Return how far panel ``i`` is drawn in at its tip [m], and its rate; 0 for a linear panel.

    p, v: (n,) positions and velocities.
    """
    G, start = model.foreshortening.tip[i], model.at.modes + i * model.omega2.shape[1]
    n_b, inward, rate = min(len(G), model.omega2.shape[1]), 0.0, 0.0
    for j in range(n_b):
        for k in range(n_b):
            inward += 0.5 * p[start + j] * G[j, k] * p[start + k]
            rate += p[start + j] * G[j, k] * v[start + k]
    return inward, rate


def panel_inertia(model: Model, i: int, b: Array) -> Array:
    """Return the inertia (3 + n_m, 3 + n_m) of a panel over its root's motion and its modal amplitudes ``b`` (n_m,).

    In panel axes, of root translation, rotation, and the amplitudes: its product with their rates is twice the kinetic
    energy. Of a linear panel those of Eq. 45, axial modes included.
    """
    n_a, translation, rotation, gyro = model.n_axial, model.translation[i], model.rotation[i], model.gyro[i]
    axial, bending = b[:n_a], b[n_a:]
    M = np.eye(3 + len(b))
    M[0, 0] = M[1, 1] = model.panel_mass[i]
    M[0, 2], M[1, 2] = -(translation[n_a:] @ bending), model.panel_first_moment[i] + translation[:n_a] @ axial
    M[2, 2] = model.panel_second_moment[i] + 2.0 * rotation[:n_a] @ axial + b @ b
    M[0, 3 : 3 + n_a], M[1, 3 + n_a :] = translation[:n_a], translation[n_a:]
    M[2, 3 : 3 + n_a], M[2, 3 + n_a :] = -(gyro.T @ bending), rotation[n_a:] + gyro @ axial
    points = model.foreshortening
    slow = b[: points.tip.shape[1]]
    n_b, bent = len(slow), slice(3, 3 + len(slow))
    W_i, G_i = points.W[i, :, :n_b], points.G[i, :, :n_b, :n_b]
    for mass, x, W, G in zip(points.mass[i], points.x[i], W_i, G_i, strict=True):
        Gb, s, y = G @ slow, slow @ G @ slow / 2.0, W @ slow
        M[1, 2] -= mass * s
        M[2, 2] += mass * s * (s - 2.0 * x)
        M[0, bent] -= mass * Gb
        M[2, bent] += mass * (y * Gb - s * W)
        M[bent, bent] += mass * np.outer(Gb, Gb)
    return np.triu(M) + np.triu(M, 1).T


def strain_energy(model: Model, i: int, b: Array) -> float:
    """Return the strain energy of panel ``i`` beyond that of a linear beam [J], of its exact curvature."""
    points, slow = model.foreshortening, b[: model.foreshortening.tip.shape[1]]
    bend, slope = points.bend[i, :, : len(slow)] @ slow, points.slope[i, :, : len(slow)] @ slow
    return float(0.5 * points.stiffness[i] @ (bend * slope) ** 2)
