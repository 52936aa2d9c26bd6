"""Energy and momentum of robot and object, for linear and for foreshortened panels, in plain NumPy."""

from __future__ import annotations

import numpy as np

from sffr_gym.physics import monolithic
from sffr_gym.physics.foreshortening import panel_inertia, strain_energy
from sffr_gym.physics.kinematics import rotation
from sffr_gym.physics.model import Model, first_mode, joint_slice, object_slice
from sffr_gym.types import Array


def energy_of(model: Model, p: Array, v: Array) -> float:
    """Return the kinetic and strain energy [J] at flat positions and velocities (n,)."""
    momentum, rates = _conjugate(model, p, v)
    energy = 0.5 * momentum @ rates
    for i, omega2 in enumerate(model.omega2):
        b = _amplitudes(model, p, i)
        energy += 0.5 * b @ (omega2 * b) + strain_energy(model, i, b)
    return float(energy)


def momentum_of(model: Model, p: Array, v: Array) -> Array:
    """Return linear momentum and angular momentum about the inertial origin (3,) [N s, N s, N m s]."""
    momentum, _ = _conjugate(model, p, v)
    px, py, pz = momentum[:3]
    total = np.array([px, py, pz + p[0] * py - p[1] * px])
    if model.object_mass > 0.0:
        at, (hx, hy, spin) = object_slice(model).start, momentum[-3:]
        total += np.array([hx, hy, spin + p[at] * hy - p[at + 1] * hx])
    return total


def _conjugate(model: Model, p: Array, v: Array) -> tuple[Array, Array]:
    """Return momenta and rates (n,), whose product is twice the kinetic energy: of base and joints, modes, object."""
    at = joint_slice(model).stop
    q, qd = p[:at], v[:at]
    momentum = np.zeros_like(v)
    momentum[:at] = monolithic.rigid_equations(model, q, qd)[0] @ qd
    for i in range(len(model.omega2)):
        J, _ = monolithic.root_jacobian(model, q, qd, i)
        turn = np.eye(3)
        turn[:2, :2] = rotation(q[2] + monolithic.panel_angle(model, i)).T
        J = turn @ J  # of the root, panel axes
        own = first_mode(model, i) + np.arange(model.omega2.shape[1])
        h = panel_inertia(model, i, p[own]) @ np.concatenate([J @ qd, v[own]])
        momentum[:at] += J.T @ h[:3]
        momentum[own] = h[3:]
    if model.object_mass > 0.0:
        momentum[object_slice(model)] = (
            np.array([model.object_mass, model.object_mass, model.object_inertia]) * v[object_slice(model)]
        )
    return momentum, v


def _amplitudes(model: Model, p: Array, i: int) -> Array:
    start = first_mode(model, i)
    return p[start : start + model.omega2.shape[1]]
