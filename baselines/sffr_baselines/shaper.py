"""Input shaping: the desired motion convolved with impulses that leave no vibration of the believed panels.

A motion from rest to rest, done in a shorter time and repeated by each impulse after its time with its share, ends
when the task's does, and the vibrations that the repetitions excite cancel. That takes no actuator on the panels; the
path in between is another one than the task's. Only where a path has an arrival, and is known ahead.

Source: N. C. Singer and W. P. Seering, "Preshaping command inputs to reduce system vibration", 1990.
"""

from __future__ import annotations

from math import comb, cos, sin

import numpy as np

from sffr_gym.compile.angles import wrap
from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.linalg import assign
from sffr_gym.config.params import Params
from sffr_gym.config.path import DEGREE, N_PIECE
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.physics.model import Model
from sffr_gym.task.reference import Reference, desired
from sffr_gym.types import Array

ORDER = {"zv": 1, "zvd": 2}  # zeros at the frequency: of the vibration, and of its derivative by the frequency
SHAPED_MODES = 2  # lowest bending modes of each panel; a smooth motion does not excite higher ones
SAME = 1.0e-6  # relative difference of frequencies, or of times, that count as one
LEAST_SHARE = 0.1  # of a motion's time that must be left for the motion itself
ANGLE = 2  # axis of a tracked angle, see observer.Observer


def shaper_impulses(kind: str, omega: Array, damping: Array) -> tuple[Array, Array]:
    """Return times (k,) [s] and shares (k,), which add up to 1, of the impulses for some vibrations at once.

    Args:
        kind: ``zv``, two impulses half a period apart for each vibration; ``zvd``, that twice, which leaves 5 % of the
            vibration of a frequency that is 14 % off.
        omega: (n,) natural frequencies [rad/s].
        damping: (n,) their damping, parts of the critical one.
    """
    times, shares = np.zeros(1), np.ones(1)
    for frequency, part in zip(omega.tolist(), damping.tolist(), strict=True):
        root = np.sqrt(1.0 - part**2)
        half, K = np.pi / (frequency * root), np.exp(-np.pi * part / root)
        for _ in range(ORDER[kind]):
            times = np.concatenate([times, times + half])
            shares = np.concatenate([shares, K * shares]) / (1.0 + K)
    order = np.argsort(times, kind="stable")
    return times[order], shares[order]


def shaped_pieces(pieces: Array, times: Array, shares: Array) -> Array:
    """Return the pieces (m, ``N_PIECE``) of a path from rest to rest convolved with impulses: exact, not sampled.

    Args:
        pieces: (n, ``N_PIECE``), see :attr:`sffr_gym.config.path.Path.pieces`; before the first one all is 0.
        times: (k,) of the impulses [s].
        shares: (k,) of them.
    """
    knots = np.sort((pieces[:, 0, None] + times).ravel())
    knots = knots[np.append(True, np.diff(knots) > SAME * knots[-1])]
    shaped = np.zeros((len(knots), N_PIECE))
    shaped[:, 0] = knots
    for row, knot in zip(shaped, knots.tolist(), strict=True):
        for time, share in zip(times.tolist(), shares.tolist(), strict=True):
            piece = np.searchsorted(pieces[:, 0], knot - time + SAME * knots[-1], side="right") - 1
            if piece >= 0:
                polynomials = pieces[piece, 1:].reshape(3, -1) @ _shift(knot - time - pieces[piece, 0])
                row[1:] += share * polynomials.ravel()
    return shaped


def make_shaped_reference(prior: Params, model: Model, reference: Reference) -> Reference:
    """Return the path that a law follows in place of the task's; without pieces where that is the task's.

    Args:
        prior: what the controller believes.
        model: the same as arrays.
        reference: the task's path.

    Raises:
        ConfigError: if the shaper leaves no time for the motion.
    """
    kind, path = prior.control.shaper, prior.path
    if kind == "none" or path.arrival is None or not len(model.omega2):
        return reference._replace(pieces=np.zeros(0))
    omega = np.sort(np.sqrt(model.omega2[:, model.n_axial : model.n_axial + SHAPED_MODES].ravel()))
    omega = omega[np.append(True, np.diff(omega) > SAME * omega[1:])]
    times, shares = shaper_impulses(kind, omega, 0.5 * prior.panel.strain_rate_damping * omega)
    if path.time - times[-1] < LEAST_SHARE * path.time:
        raise ConfigError(
            f"control.shaper = {kind!r}: takes {times[-1]:.3g} s, which leaves too little of path.time = "
            f"{path.time:g} s; give it more than {times[-1] / (1.0 - LEAST_SHARE):.3g} s"
        )
    short = path.model_copy(update={"time": path.time - float(times[-1])})
    return reference._replace(pieces=shaped_pieces(short.pieces, times, shares).ravel())


def _shift(by: float) -> Array:
    """Return the matrix that turns ascending coefficients in ``s + by`` into those in ``s``; applied from the right."""
    size = DEGREE + 1
    return np.array([[comb(k, j) * by ** (k - j) if j <= k else 0.0 for j in range(size)] for k in range(size)])


@kernel
def reshape_reference(task, shaped, at, tracked, t, obs, seen):
    """Write the observation ``seen`` (n_o,) as if the shaped path had been asked for, of ``obs`` (n_o,).

    task, shaped: :class:`reference.Reference` of the task and of the law; at: index map of the observation.
    tracked: an :class:`observer.Observer`, for its list of errors; t: time of the observation [s].
    """
    assign(seen, obs)
    old, new = desired(task, t), desired(shaped, t)
    c, s = cos(new.heading - old.heading), sin(new.heading - old.heading)
    ch, sh = cos(new.heading), sin(new.heading)
    dx, dy, dvx, dvy = new.x - old.x, new.y - old.y, new.xd - old.xd, new.yd - old.yd
    for k in range(len(tracked.error)):
        e, ed = tracked.error[k], tracked.rate[k]
        if tracked.axis[k] == ANGLE:
            seen[e], seen[ed] = wrap(obs[e] + new.heading - old.heading), obs[ed] + new.turn - old.turn
        elif tracked.axis[k] == 0:  # with the next one a point, which the path carries at (bx, by) in its axes
            bx, by = tracked.lever[k + 1], -tracked.lever[k]
            x, y = obs[e] - bx, obs[e + 1] - by
            seen[e] = c * x + s * y + bx + ch * dx + sh * dy
            seen[e + 1] = c * y - s * x + by + ch * dy - sh * dx
            x, y = obs[ed] + old.turn * by, obs[ed + 1] - old.turn * bx
            seen[ed] = c * x + s * y - new.turn * by + ch * dvx + sh * dvy
            seen[ed + 1] = c * y - s * x + new.turn * bx + ch * dvy - sh * dvx
    v, a, j = at.reference_velocity, at.reference_acceleration, at.reference_jerk
    seen[v], seen[v + 1] = ch * new.xd + sh * new.yd, ch * new.yd - sh * new.xd
    seen[a], seen[a + 1] = ch * new.xdd + sh * new.ydd, ch * new.ydd - sh * new.xdd
    seen[j], seen[j + 1] = ch * new.xddd + sh * new.yddd, ch * new.yddd - sh * new.xddd
    seen[at.reference_turn] = new.turn
    seen[at.reference_turn_acceleration], seen[at.reference_turn_jerk] = new.turn_acceleration, new.turn_jerk
