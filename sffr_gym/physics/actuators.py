"""Actuators (Eqs. 14 and 15): thrusters, joint motors and piezo channels under their limits.

A command is one flat vector: piezo voltages panel by panel [V], base thrust along the base axes [N, N, N m], joint
torques [N m]. An action is a command divided by each actuator's limit.

Beside their limits actuators are ideal in the paper. Here they may take commands in steps, thrusters may be on or off,
and all may lag behind: in this order, as a command goes through an interface, a valve and the actuator itself.
"""

from __future__ import annotations

from math import ceil
from typing import NamedTuple

import numpy as np

from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.lanes import any_lane, floor, where
from sffr_gym.compile.linalg import assign
from sffr_gym.compile.workspace import Integers
from sffr_gym.config.actuator_sections import Actuators as ActuatorSection
from sffr_gym.config.params import Params
from sffr_gym.physics.each_panel import of_each_panel
from sffr_gym.physics.model import N_BASE, Model, first_mode, tip_rows
from sffr_gym.physics.piezo import channels
from sffr_gym.types import Array

LEAST_REACH = 1.0e-9  # of an array's largest reach; it is not asked for tip forces that it reaches less


class CommandIndex(NamedTuple):
    """The index map of a command: where each group begins; the piezos begin at 0."""

    thrust: int  #: base thrust and torque
    joints: int  #: joint torques
    end: int  #: length of a command, n_u


class Modulator(NamedTuple):
    """A pulse-width pulse-frequency modulator of each thruster axis; see :func:`modulate`."""

    active: float  #: 1 if thrusters are on or off, 0 if they are continuous
    gain: float  #: of the filter [-]
    decay: float  #: of the filter over a control period [-]
    opens: float  #: filtered command, as a part of the force, at which a thruster opens, and at which it shuts [-]
    shuts: float
    periods: float  #: control periods that it stays open at least


class Actuators(NamedTuple):
    """Limits and authority of the actuators, ready for the kernels.

    Attributes:
        at: index map of a command.
        rated: (n_u,) what a unit action asks for, in the order of a command.
        limit: (n_u,) largest command: the same, or 0 for thrusters that are not there.
        ideal: 1 if actuators do at once what is asked of them within their limits, else 0.
        quantum: (n_u,) step in which each can be commanded; 0 for any value.
        decay: (n_u,) what is left of the distance to a held command after a control period; 0 without lag.
        behind: (n_u,) what is left of it in the period's mean.
        modulator: of thrusters that are on or off.
        K_PZ: (n_p, 3, n_c) tip forces (axial N, transverse N, moment N m) for one volt on each channel, Eq. 15, of the
            panel as one element; what the controllers know.
        allocation: (n_p, n_c, 3) volts that give a desired tip force in the least-squares sense.
        gain: (n_p, n_c) force or moment of a channel for one volt [N/V, N m/V].
        reach: (n_p, n_m, n_c) displacement [m] or slope that it works on, for a unit of each mode; of the plant.
        tips: (n_p, n_m, 3) tip coordinates for a unit of each mode.
    """

    at: CommandIndex
    rated: Array
    limit: Array
    ideal: float
    quantum: Array
    decay: Array
    behind: Array
    modulator: Modulator
    K_PZ: Array
    allocation: Array
    gain: Array
    reach: Array
    tips: Array


class ActuatorState(NamedTuple):
    """What the actuators of an episode remember from one control period to the next; zeros at its start."""

    force: Array  #: (n_u,) what lagging actuators give at the period's end [V, N, N m]
    filtered: Array  #: (3,) commands of the thruster axes behind the modulator's filter, as parts of the force [-]
    firing: Array  #: (3,) sign of the thrust; 0 is shut
    open: Array  #: (3,) control periods that each still has to stay open


def state_size(n_u: int) -> int:
    """Return the numbers of an :class:`ActuatorState` for commands of so many."""
    return n_u + 3 * N_BASE


@kernel
def actuator_state(actuators, numbers):
    """The :class:`ActuatorState` whose numbers are (n_u + 9,)."""
    n_u, n = len(actuators.limit), N_BASE
    return ActuatorState(
        numbers[:n_u], numbers[n_u : n_u + n], numbers[n_u + n : n_u + 2 * n], numbers[n_u + 2 * n : n_u + 3 * n]
    )


def pack_actuators(params: Params, model: Model) -> Actuators:
    """Turn validated parameters into the arrays of the kernels."""
    piezo, panel = params.actuators.piezo, params.panel
    n_p = len(model.panel_root)
    known = of_each_panel(params, lambda each: channels(piezo, each, elements=1))
    nodal = of_each_panel(params, lambda each: channels(piezo, each, panel.elements).reach)
    gain = known[0].gain
    K_PZ = np.array([each.reach * each.gain for each in known])[:n_p]
    section, n_l = params.actuators, len(model.link_mass)
    counts = n_p * len(gain), 2, 1, n_l
    limits = section.piezo.voltage, section.thruster_force, section.thruster_torque, section.joint_torque
    there = 1.0, *[float(section.thrusters != "none")] * 2, 1.0
    lag, quanta = section.lag, section.quantisation
    constants = np.repeat([lag.piezo, lag.thruster, lag.thruster, lag.joint], counts)
    quantum = np.repeat([quanta.piezo, quanta.thruster_force, quanta.thruster_torque, quanta.joint], counts)
    rated = np.repeat(limits, counts)
    modulator = _modulator(section, params.control.period)
    decay, behind = _lag(constants, params.control.period)
    thrust_at = n_p * len(gain)
    joints_at = thrust_at + N_BASE
    return Actuators(
        at=CommandIndex(thrust_at, joints_at, joints_at + n_l),
        rated=rated,
        limit=rated * np.repeat(there, counts),
        ideal=float(not (quantum.any() or constants.any() or modulator.active)),
        quantum=quantum,
        decay=decay,
        behind=behind,
        modulator=modulator,
        K_PZ=K_PZ,
        allocation=np.array(np.linalg.pinv(K_PZ, rcond=LEAST_REACH), dtype=np.float64, order="C"),
        gain=np.tile(gain, (n_p, 1)),
        reach=np.array(model.shapes.transpose(0, 2, 1) @ np.array(nodal)[:n_p], order="C"),
        tips=tip_rows(model).transpose(0, 2, 1).copy(),
    )


def _lag(constants: Array, period: float) -> tuple[Array, Array]:
    """Return :attr:`Actuators.decay` and ``behind`` of first-order lags with time constants (n_u,) [s].

    After a period T under a held command the distance d to it is ``d exp(-T / c)``, its mean ``d (1 - exp(-T / c)) c /
    T``: the mean is what moves the robot as the true course does, to the impulse.
    """
    rates = period / np.where(constants > 0.0, constants, period)
    return np.where(constants > 0.0, np.exp(-rates), 0.0), np.where(constants > 0.0, -np.expm1(-rates) / rates, 0.0)


def _modulator(section: ActuatorSection, period: float) -> Modulator:
    """Return the modulator of thrusters for a control period [s]."""
    asked = section.modulator
    decay = float(np.exp(-period / asked.time_constant)) if asked.time_constant > 0.0 else 0.0
    return Modulator(
        active=float(section.thrusters == "on-off"),
        gain=asked.gain,
        decay=decay,
        opens=asked.opens,
        shuts=asked.shuts,
        periods=float(max(1, ceil(asked.minimum_on_time / period - 1.0e-9))),
    )


def actuator_shapes(n, n_c, n_u):
    """Shapes of :class:`Actuators`, for :func:`sffr_gym.compile.workspace.structure`.

    n: :class:`sffr_gym.physics.model.Sizes`; n_c: channels of a panel; n_u: length of a command.
    """
    return Actuators(
        at=CommandIndex(Integers(()), Integers(()), Integers(())), rated=(n_u,), limit=(n_u,), ideal=(),
        quantum=(n_u,), decay=(n_u,), behind=(n_u,), modulator=Modulator((), (), (), (), (), ()),
        K_PZ=(n.panels, 3, n_c),
        allocation=(n.panels, n_c, 3), gain=(n.panels, n_c), reach=(n.panels, n.modes, n_c),
        tips=(n.panels, n.modes, 3),
    )  # fmt: skip


@kernel
def command_of(action, scale, command):
    """Write the command (n_u,) of an action (n_u,): clipped to [-1, 1], times what a unit action asks for (n_u,)."""
    for k in range(len(command)):
        command[k] = min(max(action[k], -1.0), 1.0) * scale[k]


@kernel
def saturate(actuators, command, applied):
    """Clip a command (n_u,) to the limits into ``applied``; NaN stays NaN."""
    for i in range(len(command)):
        applied[i] = min(max(command[i], -actuators.limit[i]), actuators.limit[i])


@kernel
def actuate(actuators, command, state, asked, applied):
    """Write what the actuators give of a command (n_u,) held over a control period, on average, into ``applied``.

    state: :class:`ActuatorState`, brought to the period's end; asked: (n_u,) the command within the limits, written.
    """
    saturate(actuators, command, asked)
    assign(applied, asked)
    if any_lane(actuators.ideal < 1.0):
        quantise(actuators.quantum, actuators.limit, applied)
        modulate(actuators, state, applied)
        _follow(actuators, state, applied)


@kernel
def quantise(quantum, bound, values):
    """Round ``values`` (n,) to multiples of ``quantum`` (n,) within ``bound`` (n,), in place; 0 leaves them."""
    for i in range(len(values)):
        steps = floor(values[i] / where(quantum[i] > 0.0, quantum[i], 1.0) + 0.5)
        rounded = min(max(steps * quantum[i], -bound[i]), bound[i])
        values[i] = where(quantum[i] > 0.0, rounded, values[i])


@kernel
def modulate(actuators, state, applied):
    """Turn the thrust in ``applied`` (n_u,) into thrusters that are on or off, in place.

    A pulse-width pulse-frequency modulator: the command less what the thruster does, as parts of its force, goes
    through a first-order lag into a Schmitt trigger. Over many pulses the thrust is nearly the command.

    Source: B. Wie, "Space Vehicle Dynamics and Control", AIAA, 1998, sec. 7.4; for flexible spacecraft G. Song and B.
    N. Agrawal, "Vibration suppression of flexible spacecraft during attitude control", Acta Astronautica 49, 2001.
    """
    modulator = actuators.modulator
    active = modulator.active > 0.0
    for k in range(N_BASE):
        i = actuators.at.thrust + k
        limit, firing = actuators.limit[i], state.firing[k]
        asked = applied[i] / where(limit > 0.0, limit, 1.0)
        filtered = modulator.gain * (asked - firing)
        filtered += modulator.decay * (state.filtered[k] - filtered)
        held = where(state.open[k] > 0.0, 1.0, where(firing * filtered > modulator.shuts, 1.0, 0.0))
        opened = where(filtered >= modulator.opens, 1.0, where(filtered <= -modulator.opens, -1.0, 0.0))
        fires = where((abs(firing) > 0.0) & (held > 0.0), firing, opened)
        begins = (abs(fires) > 0.0) & (fires != firing)
        left = where(begins, modulator.periods - 1.0, max(state.open[k] - 1.0, 0.0))
        state.filtered[k] = where(active, filtered, 0.0)
        state.firing[k] = where(active, fires, 0.0)
        state.open[k] = where(active, left, 0.0)
        applied[i] = where(active, fires * limit, applied[i])


@kernel
def _follow(actuators, state, applied):
    """Let lagging actuators follow ``applied`` (n_u,), which becomes what they give on average; see :func:`_lag`."""
    for i in range(len(applied)):
        distance, lags = state.force[i] - applied[i], actuators.decay[i] > 0.0
        state.force[i] = where(lags, applied[i] + actuators.decay[i] * distance, 0.0)
        applied[i] = where(lags, applied[i] + actuators.behind[i] * distance, applied[i])


@kernel
def generalized_forces(model, actuators, applied, tau):
    """Write the generalised forces ``tau`` (n,) of an applied command (n_u,); the object's stay as they are.

    Piezo forces are internal to a panel: they act on the elastic coordinates alone (Eq. 14).
    """
    n_p, n_m, n_c = actuators.reach.shape
    for i in range(model.at.modes):  # base and joints
        tau[i] = applied[actuators.at.thrust + i]
    for i in range(n_p):
        start = first_mode(model, i)
        for m in range(n_m):
            tau[start + m] = 0.0
        for c in range(n_c):
            force = actuators.gain[i, c] * applied[i * n_c + c]
            for m in range(n_m):
                tau[start + m] += actuators.reach[i, m, c] * force
