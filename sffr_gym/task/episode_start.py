"""The start of an episode, made of the numbers that were drawn for it: kernels, for one episode or for many."""

from __future__ import annotations

from math import atan2, cos, sin, sqrt
from typing import NamedTuple

import numpy as np

from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.linalg import assign
from sffr_gym.config.path import DEGREE, N_PIECE
from sffr_gym.physics.beam import N_TIP
from sffr_gym.task.disturbances import NEVER
from sffr_gym.task.episode_draws import N_IMPULSE, EpisodeDraws
from sffr_gym.task.quasi_static import panel_push, quasi_static_amplitude
from sffr_gym.task.reference import N_REFERENCE, desired, reference_at
from sffr_gym.types import Array, IntArray

RATE, PHASE, BEARING = 1, 2, 5  # places in a Reference


class Starts(NamedTuple):
    """Rows for starts of episodes; of the same name in :class:`sffr_gym.envs.batch.Batch`, which may stand for it."""

    p: Array
    v: Array
    reference: Array
    level: Array
    key: IntArray
    delay: IntArray
    quantum: Array
    coarse: IntArray
    impulse_tick: IntArray
    impulse: Array


def new_starts(draws: EpisodeDraws) -> Starts:
    """Allocate the start of one episode."""
    n, n_o, count = len(draws.p), len(draws.level), len(draws.moment)
    whole = np.zeros((3, 1), dtype=np.int64)
    return Starts(
        np.zeros((1, n)), np.zeros((1, n)), np.zeros((1, len(draws.reference))), np.zeros((1, n_o)), whole[0], whole[1],
        np.zeros((1, n_o)), whole[2], np.zeros((1, count), dtype=np.int64), np.zeros((1, count, 3)),
    )  # fmt: skip


@kernel
def start_episode(model, draws, numbers, starts, i):
    """Write the start of an episode to row ``i`` of ``starts``, and into its ``numbers`` (k,) what they came to be.

    model: the plant; draws: an :class:`EpisodeDraws`; starts: :class:`Starts`, with rows for as many impulses or more,
    row ``i`` being 0 or another start of these draws.
    """
    p, v, reference = starts.p[i], starts.v[i], starts.reference[i]
    assign(p, draws.p)
    assign(v, draws.v)
    assign(reference, draws.reference)
    at = draws.draws_speed + draws.draws_phase
    if at > 0:
        _leave(model, draws, numbers, reference, p, v)
    at = _excite(model, draws, numbers, at, p, v)
    if draws.bends > 0:
        _bend(model, reference_at(reference, len(model.link_mass)), p, v)
    if len(draws.offset) > 0:
        _shift(model, draws.offset, numbers, at, p, v)
        at += 3
    at = _put_impulses(draws, numbers, at, starts.impulse_tick[i], starts.impulse[i])
    _put_sensing(draws, numbers, at, starts, i)


@kernel
def _leave(model, draws, numbers, row, p, v):
    """Let path, robot and object leave at the drawn speed and phase, all moving as one; row: of the reference."""
    speed = numbers[0] if draws.draws_speed > 0 else draws.speed
    n_l, ratio = len(model.link_mass), speed / draws.speed
    if draws.reach > 0.0:
        row[RATE] = speed / draws.reach
    if draws.draws_phase > 0:
        row[PHASE] = numbers[draws.draws_speed]
    for at in range(N_REFERENCE + n_l, len(row), N_PIECE):  # polynomials in a time that passes faster
        row[at] = row[at] / ratio
        for part in range(3):
            power = 1.0
            for k in range(DEGREE + 1):
                row[at + 1 + part * (DEGREE + 1) + k] *= power
                power *= ratio
    reference = reference_at(row, n_l)
    want = desired(reference, 0.0)
    if len(reference.pieces) > 0 or reference.lobes > 1.0:
        row[BEARING] = atan2(want.yd, want.xd)
    x, y, turn = want.xd - draws.start[0], want.yd - draws.start[1], want.turn - draws.start[2]
    v[0] += x - turn * reference.base_y
    v[1] += y + turn * reference.base_x
    v[2] += turn
    if model.object_mass > 0.0:
        at = model.at.object
        v[at], v[at + 1], v[at + 2] = v[at] + x, v[at + 1] + y, v[at + 2] + turn


@kernel
def _excite(model, draws, numbers, at, p, v):
    """Set every panel to free vibration in the drawn modes alone; returns the place of the next number."""
    n_p, n_m = model.omega2.shape
    if len(draws.modes) == 0:
        return at
    for k in range(model.at.modes, model.at.modes + n_p * n_m):
        p[k] = v[k] = 0.0
    for panel in range(n_p):
        tip_row = model.shapes.shape[1] - N_TIP + 1
        for mode in draws.modes:
            amplitude, phase = numbers[at] / model.shapes[panel, tip_row, mode], numbers[at + 1]
            place = model.at.modes + panel * n_m + mode
            p[place] = amplitude * cos(phase)
            v[place] = -amplitude * sqrt(model.omega2[panel, mode]) * sin(phase)
            at += 2
    return at


@kernel
def _bend(model, reference, p, v):
    """Add to every panel its quasi-static shape under the path's acceleration, and the rate of it."""
    n_p, n_m = model.omega2.shape
    want = desired(reference, 0.0)
    for panel in range(n_p):
        push, push_rate = panel_push(model, panel, reference, want, 1.0, 0.0)  # headings count from the start
        for mode in range(model.n_axial, n_m):
            place = model.at.modes + panel * n_m + mode
            p[place] += quasi_static_amplitude(model, panel, mode, push, want.turn_acceleration)
            v[place] += quasi_static_amplitude(model, panel, mode, push_rate, want.turn_jerk)


@kernel
def _shift(model, offset, numbers, at, p, v):
    """Shift and turn robot and object as one about the object; the base keeps its velocity."""
    numbers[at], numbers[at + 2] = offset[0] * sqrt(numbers[at]), offset[1] * numbers[at + 2]
    x, y = numbers[at] * cos(numbers[at + 1]), numbers[at] * sin(numbers[at + 1])
    if model.object_mass > 0.0:
        c, s, k = cos(numbers[at + 2]), sin(numbers[at + 2]), model.at.object
        from_object_x, from_object_y = p[0] - p[k], p[1] - p[k + 1]
        turned_x, turned_y = c * from_object_x - s * from_object_y, s * from_object_x + c * from_object_y
        beside_x, beside_y = v[k] - v[0] - v[2] * from_object_y, v[k + 1] - v[1] + v[2] * from_object_x
        v[k] = v[0] + v[2] * turned_y + c * beside_x - s * beside_y
        v[k + 1] = v[1] - v[2] * turned_x + s * beside_x + c * beside_y
        p[0], p[1] = p[k] + x + turned_x, p[k + 1] + y + turned_y
        p[k], p[k + 1], p[k + 2] = p[k] + x, p[k + 1] + y, p[k + 2] + numbers[at + 2]
    else:
        p[0], p[1] = p[0] + x, p[1] + y
    p[2] += numbers[at + 2]


@kernel
def _put_impulses(draws, numbers, at, tick, impulse):
    """Write the drawn impulses, and none after them; returns the place of the next number."""
    for k in range(len(tick)):
        tick[k], impulse[k, 0], impulse[k, 1], impulse[k, 2] = NEVER, 0.0, 0.0, 0.0
        if k < len(draws.moment):
            size, direction = numbers[at + 1], numbers[at + 2]
            tick[k], impulse[k, 0], impulse[k, 1] = int(numbers[at]), size * cos(direction), size * sin(direction)
            impulse[k, 2] = numbers[at + 3] * draws.moment[k]
            numbers[at] = tick[k] * draws.period
            numbers[at + 1], numbers[at + 2], numbers[at + 3] = impulse[k, 0], impulse[k, 1], impulse[k, 2]
            at += N_IMPULSE
    return at


@kernel
def _put_sensing(draws, numbers, at, starts, i):
    """Write how what is measured differs from the truth."""
    starts.delay[i] = starts.key[i] = starts.coarse[i] = 0
    if draws.delay > 0.0:
        starts.delay[i] = 1 if numbers[at] < draws.delay else 0
        numbers[at] = starts.delay[i]
        at += 1
    if draws.noisy > 0:
        starts.key[i] = int(numbers[at])
        at += 1
    if draws.noisy > 0:
        assign(starts.level[i], draws.level)
    for k in range(at, len(numbers)):
        if numbers[k] > 0.0:
            starts.coarse[i] = 1
    if len(numbers) > at:
        for k in range(len(draws.steps)):
            starts.quantum[i, k] = numbers[at + draws.steps[k]] if draws.steps[k] >= 0 else 0.0
