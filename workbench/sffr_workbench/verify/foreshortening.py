"""The robot with panels that bend as a geometrically exact beam does, to the order that a linear beam leaves out.

A bent, inextensible panel draws its points towards the root by ``1/2 integral of w'^2``, and its curvature is
``w'' / sqrt(1 - w'^2)``. The equations are built here from points of mass along the panels, with these terms and
without axial strain, and solved by the classical Runge-Kutta method: slow and short, to show where two engines and a
linear beam part. With the terms left out it is one more independent implementation of the linear beam.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sffr_gym.config import sections
from sffr_gym.config.params import Params
from sffr_gym.physics import monolithic
from sffr_gym.physics.beam import N_TIP, Modes
from sffr_gym.physics.each_panel import panel_modes
from sffr_gym.physics.kinematics import rotation
from sffr_gym.physics.model import Model, pack
from sffr_gym.types import Array
from sffr_workbench.verify.motion import RECORD, Motion, Piece, stack

STEP = 1.0e-2  # s


class Panel(NamedTuple):
    """Points of mass along a panel, in its bending modes; the last point is the tip and has no mass."""

    mass: Array  #: (k,) [kg]
    x: Array  #: (k,) distance from the root [m]
    length: Array  #: (k,) of the panel that the point stands for [m]
    W: Array  #: (k, n_m) transverse displacement of each mode, slope and curvature
    dW: Array  #: (k, n_m)
    d2W: Array  #: (k, n_m)
    G: Array  #: (k, n_m, n_m) integral of W' W'^T up to the point, which moves inwards by b' G b / 2
    omega2: Array  #: (n_m,) squared clamped frequencies [rad2/s2]
    EI: float  #: bending stiffness [N m2]


def simulate(params: Params, pieces: Sequence[Piece], geometric: bool = True) -> Motion:
    """Run an experiment of ``sffr_workbench.verify.motion`` without object.

    Args:
        params: the robot at rest; ``panel.elements`` is used, its damping is not.
        pieces: the forces.
        geometric: False leaves the terms of higher order out, which gives the linear beam.
    """
    model, panels = pack(params), _panels(params)
    if not geometric:
        panels = [panel._replace(G=0 * panel.G, EI=0.0) for panel in panels]
    n = 3 + len(model.link_mass)
    state = np.zeros((2, n + sum(len(panel.omega2) for panel in panels)))
    state[0, :n] = params.initial.q
    rows = [_row(panels, state[0], n)]
    every = round(RECORD / STEP)
    for piece in pieces:
        force = np.zeros(state.shape[1])
        force[:n] = np.concatenate([piece.wrench, piece.joints])
        for k in range(round(piece.duration / STEP)):
            state = _runge_kutta(model, panels, state, force)
            if (k + 1) % every == 0:
                rows.append(_row(panels, state[0], n))
    return stack(rows)


def _panels(params: Params) -> list[Panel]:
    return [_panel(panel, modes) for panel, modes in zip(params.panel.each, panel_modes(params), strict=True)]


def _panel(panel: sections.Panel, modes: Modes) -> Panel:
    kept = modes.shapes[:, modes.n_axial :]
    nodes = np.vstack([np.zeros((N_TIP, kept.shape[1])), kept])
    size = panel.length / panel.elements
    points, weights = np.polynomial.legendre.leggauss(4)
    G = np.zeros((kept.shape[1], kept.shape[1]))  # up to the start of an element
    x, lengths, shapes, inward = [], [], [], []
    for element in range(panel.elements):
        own = nodes[N_TIP * element : N_TIP * (element + 2)]
        last = [1.0] if element == panel.elements - 1 else []
        for xi, weight in zip([*(points + 1) / 2, *last], [*weights / 2, *np.zeros(len(last))], strict=True):
            x.append(size * (element + xi))
            lengths.append(size * weight)
            shapes.append([row @ own for row in _hermite(xi, size)])
            inward.append(G + _slope_products(own, xi, size))
        G = G + _slope_products(own, 1.0, size)
    W, dW, d2W = np.array(shapes).swapaxes(0, 1)
    length = np.array(lengths)
    mass = panel.mass / panel.length * length
    omega2 = modes.omega[modes.n_axial :] ** 2
    return Panel(mass, np.array(x), length, W, dW, d2W, np.array(inward), omega2, panel.EI)


def _hermite(xi: float, size: float) -> Array:
    """Return an element's transverse shape functions over (u, w, slope) of both nodes, and two derivatives."""
    s = size
    return np.array([
        [0, 1 - 3 * xi**2 + 2 * xi**3, s * (xi - 2 * xi**2 + xi**3), 0, 3 * xi**2 - 2 * xi**3, s * (xi**3 - xi**2)],
        [0, 6 * (xi**2 - xi) / s, 1 - 4 * xi + 3 * xi**2, 0, 6 * (xi - xi**2) / s, 3 * xi**2 - 2 * xi],
        [0, (12 * xi - 6) / s**2, (6 * xi - 4) / s, 0, (6 - 12 * xi) / s**2, (6 * xi - 2) / s],
    ])  # fmt: skip


def _slope_products(own: Array, end: float, size: float) -> Array:
    """Return the integral of W' W'^T over an element from its start to ``end`` (0 to 1)."""
    points, weights = np.polynomial.legendre.leggauss(3)  # exact: the integrand is of degree 4
    slopes = np.array([_hermite(end * (point + 1) / 2, size)[1] @ own for point in points])
    return np.einsum("k,ki,kj->ij", weights / 2 * end * size, slopes, slopes)


def _runge_kutta(model: Model, panels: Sequence[Panel], state: Array, force: Array) -> Array:
    def rate(y: Array) -> Array:
        return np.stack([y[1], _acceleration(model, panels, y[0], y[1], force)])

    k1 = rate(state)
    k2 = rate(state + STEP / 2 * k1)
    k3 = rate(state + STEP / 2 * k2)
    k4 = rate(state + STEP * k3)
    return np.asarray(state + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4))


def _acceleration(model: Model, panels: Sequence[Panel], z: Array, zd: Array, force: Array) -> Array:
    """Solve ``M zdd + h = force``, M and h summed over the rigid bodies and the points of mass."""
    n = start = 3 + len(model.link_mass)
    M, h = np.zeros((len(z), len(z))), np.zeros(len(z))
    M[:n, :n], h[:n] = monolithic.rigid_equations(model, z[:n], zd[:n])
    for i, panel in enumerate(panels):
        own = slice(start, start + len(panel.omega2))
        start = own.stop
        b, bd = z[own], zd[own]
        turn = rotation(z[2] + monolithic.panel_angle(model, i))
        root = rotation(z[2]) @ model.panel_root[i]
        place = np.stack([panel.x - b @ panel.G @ b / 2, panel.W @ b], axis=1)
        grow = np.stack([-panel.G @ b, panel.W], axis=1)  # (k, 2, n_m) derivative of the place
        rate, curl = grow @ bd, np.stack([-(panel.G @ bd) @ bd, 0 * panel.x], axis=1)
        r, w = root + place @ turn.T, zd[2]
        J = np.zeros((len(panel.x), 2, len(z)))
        J[:, 0, 0] = J[:, 1, 1] = 1.0
        J[:, 0, 2], J[:, 1, 2] = -r[:, 1], r[:, 0]
        J[:, :, own] = np.einsum("ab,kbm->kam", turn, grow)
        coriolis = 2 * w * np.stack([-(rate @ turn.T)[:, 1], (rate @ turn.T)[:, 0]], axis=1)
        bias = -(w**2) * r + coriolis + curl @ turn.T
        flat, weight = J.reshape(-1, len(z)), np.repeat(panel.mass, 2)
        M += flat.T @ (weight[:, None] * flat)
        h += flat.T @ (weight * bias.ravel())
        h[own] += panel.omega2 * b
        slope, bend = panel.dW @ b, panel.d2W @ b  # of EI w''^2 w'^2 / 2, the next term of the strain energy
        h[own] += (
            panel.EI * panel.length @ ((bend * slope**2)[:, None] * panel.d2W + (bend**2 * slope)[:, None] * panel.dW)
        )
    return np.asarray(np.linalg.solve(M, force - h))


def _row(panels: Sequence[Panel], z: Array, n: int) -> tuple[Array, ...]:
    bends = zip(panels, z[n:].reshape(len(panels), -1), strict=True)
    tips = np.array([[-b @ panel.G[-1] @ b / 2, panel.W[-1] @ b] for panel, b in bends])
    return z[:3], tips, np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2))
