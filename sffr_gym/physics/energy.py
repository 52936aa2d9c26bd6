"""Energy, momentum and natural frequencies of robot and object, in plain NumPy."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cholesky, null_space, solve_triangular, svdvals

from sffr_gym.physics import monolithic
from sffr_gym.physics.foreshortening import panel_inertia, strain_energy
from sffr_gym.physics.kinematics import rotation
from sffr_gym.physics.model import Model, joint_slice, mode_slice, object_slice
from sffr_gym.types import Array

RIGID_MODE = 1.0e-3  # rad/s, slower modes count as rigid motion


def energy_of(model: Model, p: Array, v: Array) -> float:
    """Return the kinetic and strain energy [J] at flat positions and velocities (n,)."""
    energy = 0.5 * v @ inertia_of(model, p) @ v
    for i, omega2 in enumerate(model.omega2):
        b = p[_modes(model, i)]
        energy += 0.5 * b @ (omega2 * b) + strain_energy(model, i, b)
    return float(energy)


def momentum_of(model: Model, p: Array, v: Array) -> Array:
    """Return linear momentum and angular momentum about the inertial origin (3,) [N s, N s, N m s]."""
    momenta = inertia_of(model, p) @ v
    px, py, pz = momenta[:3]
    total = np.array([px, py, pz + p[0] * py - p[1] * px])
    if model.object_mass > 0.0:
        at, (hx, hy, spin) = object_slice(model).start, momenta[-3:]
        total += np.array([hx, hy, spin + p[at] * hy - p[at + 1] * hx])
    return total


def inertia_of(model: Model, p: Array) -> Array:
    """Return the mass matrix (n, n) over flat velocities: base and joints, modal amplitudes, object."""
    at, M = joint_slice(model).stop, np.zeros((model.at.end, model.at.end))
    q, still = p[:at], np.zeros(at)
    M[:at, :at] = monolithic.rigid_equations(model, q, still)[0]
    for i in range(len(model.omega2)):
        J, _ = monolithic.root_jacobian(model, q, still, i)
        turn = np.eye(3)
        turn[:2, :2] = rotation(q[2] + monolithic.panel_angle(model, i)).T
        J, own = turn @ J, _modes(model, i)  # of the root, panel axes
        panel = panel_inertia(model, i, p[own])
        M[:at, :at] += J.T @ panel[:3, :3] @ J
        M[:at, own] = J.T @ panel[:3, 3:]
        M[own, :at] = M[:at, own].T
        M[own, own] = panel[3:, 3:]
    if model.object_mass > 0.0:
        body = np.diag([model.object_mass, model.object_mass, model.object_inertia])
        M[object_slice(model), object_slice(model)] = body
    return M


def natural_frequencies(model: Model, p: Array) -> Array:
    """Return the undamped natural frequencies [rad/s] of a robot at rest at ``p`` (n,), rigid motion left out.

    With an object, of the motion that the pins allow; straight panels if they keep their length. They are the singular
    values of ``Omega L^-T``, ``M = L L^T``, which keeps the slow ones accurate beside fast ones.
    """
    M, at, body = inertia_of(model, p), mode_slice(model), object_slice(model)
    stretch = np.zeros((at.stop - at.start, len(M)))
    stretch[:, at] = np.diag(np.sqrt(model.omega2.ravel()))
    if body.stop > body.start:
        n = at.start
        J, _ = monolithic.constraint_jacobian(model, p[:n], np.zeros(n), p[body])
        allowed = null_space(np.hstack([J[:, :n], np.zeros((len(J), at.stop - at.start)), J[:, n:]]))
        M, stretch = allowed.T @ M @ allowed, stretch @ allowed
    omega = svdvals(solve_triangular(cholesky(M, lower=True), stretch.T, lower=True))
    return np.sort(omega[omega > RIGID_MODE])


def _modes(model: Model, i: int) -> slice:
    """Modal amplitudes of panel ``i`` in ``p``."""
    start, n_m = model.at.modes + i * model.omega2.shape[1], model.omega2.shape[1]
    return slice(start, start + n_m)
