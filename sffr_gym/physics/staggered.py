"""The step that the staggered coupling allows: Fig. 1 holds the panels' force on the base while the panels move on.

A step solves all accelerations at its start; until its end the base feels the Q_flex found there, and the panels follow
the base. The reaction to a mode's elastic force thus comes half a step late on average, which acts like a negative
damping: in small vibration at rest, with the modes' own frequencies Omega and the base's answer C to their forces,

    zdd = -Omega^2 (z + eta zd) - C Omega^2 (z_0 + eta zd_0)        z_0, zd_0 at the step's start.

A mode that the base stiffens by ``a``, to the squared frequency ``(1 + a) Omega^2``, loses ``a Omega^2 h / 2`` of its
damping ``(1 + a) eta Omega^2`` and grows beyond ``h = 2 eta (1 + a) / a``: for the case study's axial modes 0.3 ms.
Bending modes grow sooner but slowly, at ``a Omega^2 h / 4``: with steps of 0.29 ms at 1.4e-4 1/s.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
from scipy.linalg import expm

from sffr_gym.config.params import Params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.physics.beam import Beam, Modes
from sffr_gym.types import Array

FASTEST_GROWTH = 0.01  # 1/s; the virtual damping and the panels' own take out more
MOST_MODES = 100  # of all panels: the search for a stable step takes a minute, and grows with the third power
TRIED_STEPS = 2.0 ** (-np.arange(48, -1, -1) / 4)  # of the configured longest step, rising


def longest_stable_step(params: Params, beams: Sequence[Beam], modes: Sequence[Modes]) -> float:
    """Return the longest step [s] up to ``simulation.max_step`` that, as all shorter ones, lets no mode grow.

    Arms and object are left out: what they add to the base's inertia calms the coupling.

    Raises:
        ConfigError: if there is none, as for panels without damping, or if the search would take too long.
    """
    count = params.n_panels * len(modes[0].omega)
    if count > MOST_MODES:
        raise ConfigError(
            f"simulation.coupling = staggered: the panels have {count} modes, of which a stable step can be found for "
            f"at most {MOST_MODES}; take exact, fewer panel.elements, or lower panel.axial_cut and panel.bending_cut"
        )
    omega2 = np.array([each.omega**2 for each in modes])[: params.n_panels].ravel()
    C, eta = base_answer(params, beams, modes), params.panel.strain_rate_damping
    stable, step = _tried(omega2.tobytes(), eta, C.tobytes(), params.simulation.max_step)
    if stable == 0.0:
        raise ConfigError(
            "simulation.coupling = staggered: the panels' late reaction is unstable with any step down to "
            f"{step:.1g} s; take exact, more panel.strain_rate_damping (now {eta:g} s), or a panel.axial_cut below the "
            f"axial modes ({modes[0].omega[0]:.4g} rad/s)"
        )
    return stable


@functools.lru_cache(maxsize=64)
def _tried(omega2: bytes, eta: float, C: bytes, longest: float) -> tuple[float, float]:
    """Return the longest stable step, 0 if there is none, and the last one that was tried; a robot is packed often."""
    squares = np.frombuffer(omega2)
    answer, stable = np.frombuffer(C).reshape(len(squares), len(squares)), 0.0
    for step in longest * TRIED_STEPS:
        if growth_rate(squares, eta, answer, step) > FASTEST_GROWTH:
            break
        stable = step
    return stable, step


def base_answer(params: Params, beams: Sequence[Beam], modes: Sequence[Modes]) -> Array:
    """Return C (n, n): the accelerations of all panels' modes, by way of the base alone, for unit forces on each."""
    H = np.diag([params.base.mass, params.base.mass, params.base.inertia])
    answers = []
    for mount, beam, own in zip(params.panel.mounts, beams, modes, strict=False):
        m_rr = np.array([
            [beam.mass, 0.0, 0.0],
            [0.0, beam.mass, beam.first_moment],
            [0.0, beam.first_moment, beam.second_moment],
        ])  # fmt: skip
        m_rf = np.stack([beam.S_x, beam.S_y, beam.c_y]) @ own.shapes
        (x, y), c, s = mount.root, np.cos(mount.angle), np.sin(mount.angle)
        J_f = np.array([[c, s, s * x - c * y], [-s, c, c * x + s * y], [0.0, 0.0, 1.0]])
        H += J_f.T @ (m_rr - m_rf @ m_rf.T) @ J_f
        answers.append(J_f.T @ m_rf)
    forces = np.hstack(answers) if answers else np.zeros((3, 0))
    return forces.T @ np.linalg.solve(H, forces)


def growth_rate(omega2: Array, eta: float, C: Array, step: float) -> float:
    """Return the rate [1/s] at which the fastest mode grows, from the spectral radius of the map of one step.

    Args:
        omega2: (n,) squared clamped frequencies [rad2/s2].
        eta: strain-rate damping [s].
        C: (n, n) see :func:`base_answer`.
        step: duration of a step [s].
    """
    n = len(omega2)
    if n == 0:
        return 0.0
    flow = np.zeros((3 * n, 3 * n))  # of z, zd and the held acceleration
    flow[:n, n : 2 * n] = flow[n : 2 * n, 2 * n :] = np.eye(n)
    flow[n : 2 * n, :n], flow[n : 2 * n, n : 2 * n] = -np.diag(omega2), -eta * np.diag(omega2)
    transition = expm(step * flow)[: 2 * n]
    held = -C * omega2
    map_of_step = transition[:, : 2 * n] + transition[:, 2 * n :] @ np.hstack([held, eta * held])
    return float(np.log(np.abs(np.linalg.eigvals(map_of_step)).max()) / step)
