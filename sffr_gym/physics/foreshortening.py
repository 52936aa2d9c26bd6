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
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.linalg import symmetric_inverse, times
from sffr_gym.config.sections import Panel
from sffr_gym.physics.beam import N_TIP, Beam, Modes, shape_functions
from sffr_gym.types import Array

if TYPE_CHECKING:
    from sffr_gym.physics.model import Model

SLOWEST = 3  # modes that have terms of second order
POINTS = 4  # of mass along a panel, and of its strain, by Gauss


class Foreshortening(NamedTuple):
    """Points of each panel and its shapes there, of the slowest modes; of no length for linear panels.

    There is room for ``SLOWEST`` modes, zeros where a panel has fewer. What belongs to a point of mass is weighted by
    the root of it, and a curvature by the root of the stiffness that it stands for: products of two are sums' terms.
    """

    x: Array  #: (n_p, n_q) distance of each point from the root [kg^(1/2) m]
    W: Array  #: (n_p, n_q, n_b) transverse displacement of each mode there
    G: Array  #: (n_p, n_q, n_b, n_b) integral of W' W'^T up to it
    total: Array  #: (n_p, n_b, n_b) mass times that integral, summed over the points
    tip: Array  #: (n_p, n_b, n_b) that integral up to the tip, not weighted
    slope: Array  #: (n_p, n_q, n_b) W' there
    bend: Array  #: (n_p, n_q, n_b) W''
    translation: Array  #: (n_p, n_b) those of :class:`sffr_gym.physics.model.Model`, of the slowest modes
    rotation: Array  #: (n_p, n_b)


class Bent(NamedTuple):
    """Memory of one panel's equations."""

    b: Array  #: (n_b,) amplitudes and rates of the slowest modes
    bd: Array  #: (n_b,)
    inverse: Array  #: (n_b, n_b) of their mass matrix


def foreshortening_shapes(n_p, n_b):
    """Shapes of :class:`Foreshortening` for so many panels and modes of second order, of these 0 for linear ones."""
    n_q = POINTS if n_b else 0
    return Foreshortening(
        x=(n_p, n_q), W=(n_p, n_q, n_b), G=(n_p, n_q, n_b, n_b), total=(n_p, n_b, n_b), tip=(n_p, n_b, n_b),
        slope=(n_p, n_q, n_b), bend=(n_p, n_q, n_b), translation=(n_p, n_b), rotation=(n_p, n_b),
    )  # fmt: skip


def bent_shapes(model):
    """Shapes of :class:`Bent` for a robot."""
    n_b = model.foreshortening.tip.shape[1]
    return Bent(b=(n_b,), bd=(n_b,), inverse=(n_b, n_b))


def make_foreshortening(panels: Sequence[Panel], beams: Sequence[Beam], modes: Sequence[Modes]) -> Foreshortening:
    """Return the points of panels.

    Args:
        panels: the panels.
        beams: their integrals.
        modes: clamped modes of each, none of them axial.
    """
    parts = [_points(*each) for each in zip(panels, beams, modes, strict=True)]
    stacked = [np.array(arrays) for arrays in zip(*parts, strict=True)]
    return Foreshortening(*stacked) if parts else no_foreshortening(0, SLOWEST)


def no_foreshortening(n_p: int, n_b: int = 0) -> Foreshortening:
    """Return zeros: of no length for so many linear panels."""
    return Foreshortening(*(np.zeros(shape) for shape in foreshortening_shapes(n_p, n_b)))


def _points(panel: Panel, beam: Beam, modes: Modes) -> Foreshortening:
    """Return the points of one panel, without the first axis of :class:`Foreshortening`."""
    slow = modes.shapes[:, :SLOWEST]
    slow = np.pad(slow, ((0, 0), (0, SLOWEST - slow.shape[1])))
    shapes = np.pad(slow, ((N_TIP, 0), (0, 0)))  # the root does not move
    places, weights = np.polynomial.legendre.leggauss(POINTS)
    places, weights = (places + 1.0) / 2.0, weights / 2.0
    W, slope, bend = map(np.array, zip(*(_shapes_at(shapes, place, panel) for place in places), strict=True))
    G = np.array([_inward(shapes, place, panel) for place in places])
    mass, stiffness = np.sqrt(weights * panel.mass), np.sqrt(weights * panel.length * panel.EI)
    return Foreshortening(
        x=mass * places * panel.length, W=mass[:, None] * W, G=mass[:, None, None] * G,
        total=np.tensordot(mass**2, G, 1), tip=_inward(shapes, 1.0, panel), slope=slope, bend=stiffness[:, None] * bend,
        translation=beam.S_y @ slow, rotation=beam.c_y @ slow,
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
    points, bent, n_m = model.foreshortening, panels.bent, model.omega2.shape[1]
    start = model.at.modes + i * n_m
    w, w2 = yaw_rate, yaw_rate * yaw_rate
    S_y, c_y, f = model.translation[i], model.rotation[i], panels.f[i]
    for j in range(SLOWEST):
        bent.b[j], bent.bd[j], f[j] = 0.0, 0.0, 0.0
    first_y = first_yd = square = coriolis = 0.0
    for j in range(n_m):
        b, bd = p[start + j], v[start + j]
        f[j] = tau[start + j] - model.omega2[i, j] * b - model.damping[i, j] * bd + w2 * b
        first_y += S_y[j] * b
        first_yd += S_y[j] * bd
        square += b * b
        coriolis += b * bd
        if j < SLOWEST:
            bent.b[j], bent.bd[j] = b, bd
    b, bd = _three(bent.b), _three(bent.bd)
    force, c_slow, inertia, turning, moment = _move_inward(points, i, w, b, bd)
    force, c_slow = _plus(_stiffen(points, i, b, force), 1.0, f), _plus(c_slow, 1.0, points.rotation[i])
    S_slow, Pb = _three(points.translation[i]), times(points.total[i], b[0], b[1], b[2])
    symmetric_inverse(inertia, bent.inverse)
    force, along = _solved(bent.inverse, force, f), _solved(bent.inverse, Pb, panels.along[i])
    across, turn = _solved(bent.inverse, S_slow, panels.across[i]), _solved(bent.inverse, c_slow, panels.turn[i])
    first_x = model.panel_first_moment[i] - 0.5 * _dot(b, Pb)
    px = -w2 * first_x - 2.0 * w * first_yd - _dot(bd, times(points.total[i], bd[0], bd[1], bd[2])) - _dot(Pb, force)
    py = -w2 * first_y - 2.0 * w * _dot(bd, Pb) + _dot(S_slow, force)
    Myy, hy = model.panel_mass[i] - _dot(S_slow, across), first_x - _dot(S_slow, turn)
    J = model.panel_second_moment[i] + turning + square - _dot(c_slow, turn)
    moment += 2.0 * w * coriolis + _dot(c_slow, force)
    for j in range(SLOWEST, n_m):
        panels.along[i, j], panels.across[i, j], panels.turn[i, j] = 0.0, S_y[j], c_y[j]
        py += S_y[j] * f[j]
        Myy -= S_y[j] * S_y[j]
        hy -= S_y[j] * c_y[j]
        J -= c_y[j] * c_y[j]
        moment += c_y[j] * f[j]
    root = panels.root
    root.M_xx[i], root.M_xy[i], root.M_yy[i] = model.panel_mass[i] - _dot(Pb, along), _dot(Pb, across), Myy
    root.h_x[i], root.h_y[i], root.J[i] = _dot(Pb, turn) - first_y, hy, J
    root.p_x[i], root.p_y[i], root.moment[i] = px, py, moment


@kernel
def _move_inward(points, i, w, b, bd):
    """Sum what the inward motion of the points adds to a panel's equations.

    points: :class:`Foreshortening`; i: index of the panel; w: yaw rate [rad/s].
    b, bd: amplitudes and rates of the slowest modes.

    Returns the modes' forces, rotation coupling and mass matrix ``(xx, xy, xz, yy, yz, zz)``, the panel's ``m s (s - 2
    x)`` and the moment about the root.
    """
    turning, moment = 0.0, 0.0
    f, turn = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    xx, xy, xz, yy, yz, zz = 1.0, 0.0, 0.0, 1.0, 0.0, 1.0
    for q in range(POINTS):
        W, Gb, Gbd = points.W[i, q], times(points.G[i, q], b[0], b[1], b[2]), times(points.G[i, q], bd[0], bd[1], bd[2])
        s, sd, curl, y, yd = 0.5 * _dot(b, Gb), _dot(bd, Gb), _dot(bd, Gbd), _dot(W, b), _dot(W, bd)
        x, across = points.x[i, q], 2.0 * w * sd
        inward = w * (w * (s - x) - 2.0 * yd) - curl
        turning += s * (s - 2.0 * x)
        moment += y * curl - across * (x - s)
        f = _plus(_plus(f, inward, Gb), across, W)
        turn = _plus(_plus(turn, y, Gb), -s, W)
        xx, xy, xz = xx + Gb[0] * Gb[0], xy + Gb[0] * Gb[1], xz + Gb[0] * Gb[2]
        yy, yz, zz = yy + Gb[1] * Gb[1], yz + Gb[1] * Gb[2], zz + Gb[2] * Gb[2]
    return f, turn, (xx, xy, xz, yy, yz, zz), turning, moment


@kernel
def _stiffen(points, i, b, f):
    """Add the forces of the strain energy ``EI w''^2 w'^2 / 2``, which the exact curvature adds, to ``f``."""
    for q in range(POINTS):
        slope, bend = _dot(points.slope[i, q], b), _dot(points.bend[i, q], b)
        f = _plus(f, -bend * slope * slope, points.bend[i, q])
        f = _plus(f, -bend * bend * slope, points.slope[i, q])
    return f


@kernel
def _three(x):
    """Return the numbers of a vector of the slowest modes: compilers keep them in registers."""
    return x[0], x[1], x[2]


@kernel
def _dot(a, b):
    """Return the scalar product of two such vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _plus(a, factor, b):
    """Return ``a + factor b``."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@kernel
def _solved(inverse, x, out):
    """Return ``inverse @ x``, and write it into the first places of ``out``."""
    y = times(inverse, x[0], x[1], x[2])
    out[0], out[1], out[2] = y
    return y


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
    for x, W, G in zip(points.x[i], points.W[i, :, :n_b], points.G[i, :, :n_b, :n_b], strict=True):
        Gb, s, y = G @ slow, slow @ G @ slow / 2.0, W @ slow
        M[2, 2] += s * (s - 2.0 * x)
        M[2, bent] += y * Gb - s * W
        M[bent, bent] += np.outer(Gb, Gb)
    if n_b:
        Pb = points.total[i, :n_b, :n_b] @ slow
        M[0, bent] -= Pb
        M[1, 2] -= slow @ Pb / 2.0
    return np.triu(M) + np.triu(M, 1).T


def strain_energy(model: Model, i: int, b: Array) -> float:
    """Return the strain energy of panel ``i`` beyond that of a linear beam [J], of its exact curvature."""
    points, slow = model.foreshortening, b[: model.foreshortening.tip.shape[1]]
    bend, slope = points.bend[i, :, : len(slow)] @ slow, points.slope[i, :, : len(slow)] @ slow
    return float(0.5 * np.sum((bend * slope) ** 2))
