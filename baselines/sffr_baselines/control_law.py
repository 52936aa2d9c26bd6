"""A control law of the paper's kind: what it believes, what it remembers, and what it makes of an observation.

It estimates what it cannot measure well, suppresses the panels' vibration, and moves base, arms and object by inverse
dynamics; each part can do more than the paper's law does, and by itself does not.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from sffr_baselines.free_floating import FloatWork, float_base, float_shapes
from sffr_baselines.mic import Gains, MicWork, answer, ask, mic_shapes
from sffr_baselines.observer import Observer, estimate, integrate
from sffr_baselines.panel_reaction import N_BENDING, PanelReaction, add_panel_reaction
from sffr_baselines.position_feedback import PositionFeedback, feed_back
from sffr_baselines.predictive import Plan, Predictive, plan_shapes, predict
from sffr_baselines.regulator import Regulator, deviate, regulate
from sffr_baselines.schedule import N_FEATURES, Schedule, ScheduleWork, schedule_shapes
from sffr_baselines.shaper import reshape_reference
from sffr_baselines.suppression import Suppression, suppress
from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.lanes import where
from sffr_gym.physics.beam import N_TIP
from sffr_gym.physics.model import N_BASE, Model
from sffr_gym.task.observation import ObservationIndex
from sffr_gym.task.reference import Reference
from sffr_gym.types import Array, IntArray


class Law(NamedTuple):
    """HSC and its relatives as one compiled law; everything here is what the controller believes."""

    prior: Model  #: the robot
    reference: Reference  #: what the task asks for
    shaped: Reference  #: the path that the law follows instead, if it has pieces; the paper's laws follow the task's
    held: IntArray  #: joints that hold their angles
    gains: Gains  #: of the error law
    at: ObservationIndex  #: index map of the observation
    suppression: Suppression  #: the panels' law
    regulator: Regulator  #: what is added to it, of no effect in the paper's laws
    predictive: Predictive  #: what the piezos' limits ask of the regulator, likewise
    filters: PositionFeedback  #: positive position feedback of the panels, likewise
    observer: Observer  #: what it makes of measurements, of no effect in them
    floating: bool  #: whether the base has no thrusters, and the law controls what is left
    reaction: PanelReaction  #: feed-forward of what the panels pull the base with, of no effect in them
    schedule: Schedule  #: what changes the virtual damping over time, of no effect in them
    allocation: Array  #: (n_p, n_c, 3) volts for a desired tip force
    scale: Array  #: (n_u,) command of a unit action


class LawState(NamedTuple):
    """What a law remembers from one control period to the next."""

    B_hat: Array  #: (n_p, 3) virtual damping
    factor: Array  #: (n_p, 3) by which a schedule multiplies it, or the deviations that a regulator acts on
    share: Array  #: (n_p,) of each panel's predicted reaction that is fed forward; a schedule lowers it
    demand: Array  #: (n_p + 1,) largest command over its limit, of each panel's piezos and of all else; for schedules
    seen: Array  #: (n_p stack N_FEATURES,) what a schedule's last decisions saw, panel by panel, the newest first
    integral: Array  #: (n_t,) of the tracked errors over time [m s, rad s]
    errors: Array  #: (n_t, 2) estimates of the tracked errors and of their rates
    late: Array  #: (1,) 1 if the sensors were found to lag a period, else 0
    age: Array  #: (1,) observations that the estimates were made of
    filters: Array  #: (n_p, 2, 2) of positive position feedback: each mode's filter, and its rate
    plan: Array  #: (n_p, n) what the last prediction under limits found, see :class:`predictive.Predictive`
    wait: Array  #: (1,) control periods until the next one


class LawWork(NamedTuple):
    """Memory of a law's period."""

    mic: MicWork
    schedule: ScheduleWork
    floating: FloatWork
    seen: Array  #: (n_o,) what the law acts on
    shaped: Array  #: (n_o,) what was measured, seen from the path that it follows
    deviation: Array  #: (4,) of a panel's q5, q6 and of their rates from the quasi-static motion
    plan: Plan


def law_shapes(law):
    """Shapes of the :class:`LawWork` of a :class:`Law`."""
    n_o = law.at.end
    return LawWork(
        mic_shapes(law.prior), schedule_shapes(law), float_shapes(), seen=(n_o,), shaped=(n_o,),
        deviation=(2 * N_BENDING,), plan=plan_shapes(law.predictive),
    )  # fmt: skip


def state_shapes(law):
    """Shapes of the :class:`LawState` of a :class:`Law`."""
    n_p, n_t = len(law.allocation), len(law.observer.error)
    return LawState(
        B_hat=(n_p, N_TIP), factor=(n_p, N_TIP), share=(n_p,), demand=(n_p + 1,),
        seen=(n_p * law.schedule.stack * N_FEATURES,), integral=(n_t,), errors=(n_t, 2), late=(1,), age=(1,),
        filters=(n_p, N_BENDING, 2), plan=(n_p, law.predictive.scale.shape[1]), wait=(1,),
    )  # fmt: skip


def make_states(law: Law, n: int) -> LawState:
    """Return the state of ``n`` laws at the start of their episodes: arrays as in :class:`LawState`, (n, ...) each."""
    states = LawState(*(np.zeros((n, *shape)) for shape in state_shapes(law)))
    for i in range(n):
        start_state(law, states, i)
    return states


def start_state(law: Law, states: LawState, chosen: Any) -> None:
    """Put the chosen rows of the states (n, ...), by index or mask, to the start of an episode."""
    for array in states:
        array[chosen] = 0.0
    states.B_hat[chosen], states.factor[chosen], states.share[chosen] = (
        law.suppression.B0 * law.suppression.damped,
        1.0,
        1.0,
    )


@kernel
def state_at(states, i):
    """The :class:`LawState` in row ``i`` of states (n, ...)."""
    return LawState(
        states.B_hat[i], states.factor[i], states.share[i], states.demand[i], states.seen[i], states.integral[i],
        states.errors[i], states.late[i], states.age[i], states.filters[i], states.plan[i], states.wait[i],
    )  # fmt: skip


@kernel
def perceive(law, t, obs, state, work):
    """Write what the law acts on, ``work.seen`` (n_o,), for an observation ``obs`` (n_o,) measured at ``t`` [s].

    law: a :class:`Law`; state: its :class:`LawState`; work: :class:`LawWork`.
    """
    if len(law.shaped.pieces) > 0:
        reshape_reference(law.reference, law.shaped, law.at, law.observer, t, obs, work.shaped)
        estimate(law.observer, law.gains, law.at, work.shaped, state, work.seen)
    else:
        estimate(law.observer, law.gains, law.at, obs, state, work.seen)


@kernel
def control(law, state, work, command):
    """Write the command (n_u,) of the law for what it has perceived; arguments as for :func:`perceive`.

    The virtual damping adapts, and integrals grow, in ``state``.
    """
    n_volts = law.allocation.shape[0] * law.allocation.shape[1]
    volts, seen = command[:n_volts], work.seen
    suppress(law.suppression, law.allocation, law.scale[:n_volts], law.at, seen, state.factor, state.B_hat, volts)
    _act_on_deviations(law, state, work, volts)
    thrust, torque = command[n_volts : n_volts + N_BASE], command[n_volts + N_BASE :]
    ask(law.prior, law.reference, law.held, law.gains, law.at, seen, state.integral, work.mic)
    if law.floating:
        float_base(law, seen, state, work, volts, torque)
    answer(law.prior, law.reference, law.gains, law.at, seen, state.integral, work.mic, thrust, torque)
    if law.floating:
        thrust[:] = 0.0
    elif law.reaction.active:
        add_panel_reaction(law.reaction, law.scale, law.at, seen, volts, work.mic.base, state.share, thrust)
    if law.gains.Ki > 0.0:
        excess = 0.0
        for k in range(n_volts, len(command)):
            excess = max(excess, abs(command[k]) - law.scale[k])
        integrate(law.observer, seen, excess > 0.0, state)
    if law.schedule.hold > 0:
        _note_demand(law, command, state)


@kernel
def _note_demand(law, command, state):
    """Keep how far the command (n_u,) goes to its limits, for the schedule's next decision."""
    n_p, n_c, _ = law.allocation.shape
    for i in range(n_p + 1):
        state.demand[i] = 0.0
        for k in range(i * n_c, (i + 1) * n_c if i < n_p else len(command)):
            state.demand[i] = max(state.demand[i], abs(command[k]) / law.scale[k])


@kernel
def _act_on_deviations(law, state, work, volts):
    """Add to ``volts`` (n_p n_c,) what the panels' deviations from the quasi-static motion ask for; as before."""
    if not (law.regulator.active or law.filters.active):
        return
    n_p, n_c, _ = law.allocation.shape
    x, hold, wait = work.deviation, law.predictive.hold, state.wait[0]
    for i in range(n_p):
        own = volts[i * n_c : (i + 1) * n_c]
        deviate(law.regulator, law.at, work.seen, i, x)
        for j in range(N_BENDING):
            x[j] *= state.factor[i, 1 + j]
            x[N_BENDING + j] *= state.factor[i, 1 + j]
        if law.regulator.active:
            regulate(law.regulator, i, x, own)
        if law.filters.active:
            feed_back(law.filters, i, x, state.filters[i], own)
        if hold > 0:
            predict(law.predictive, i, x, wait, state.plan[i], work.plan, own)
    state.wait[0] = where(wait > 0.0, wait, 1.0 * hold) - 1.0
