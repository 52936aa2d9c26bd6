"""The reward of a control period, term by term, its cost for safe reinforcement learning, and the score's price of it.

Every term lies in (0, w], its weight: w where its measure vanishes, and falling with the logarithm of the measure where
that is large, so that there is a slope from metres to micrometres (the Lorentzian of S. Levine et al., "End-to-end
training of deep visuomotor policies", 2016, in a rational bound as the tolerances of Y. Tassa et al., "DeepMind control
suite", 2018). What is positive in every period is lost by an episode that ends early: a failure never pays.
"""

from __future__ import annotations

from math import log1p
from typing import NamedTuple

from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.lanes import where
from sffr_gym.config.params import Params
from sffr_gym.task.signals import ERROR, PIEZO, SAT_JOINT, SAT_PIEZO, SAT_THRUST, VIBRATION
from sffr_gym.task.status import RUNNING

REWARDS = ("tracking", "vibration", "effort")
TRACKING, VIBRATION_TERM, EFFORT = range(len(REWARDS))


class Weights(NamedTuple):
    """Weights of the terms, named as in ``REWARDS``, and the size of their measures that counts as 1."""

    tracking: float  #: [-]
    vibration: float
    effort: float
    tracking_scale: float  #: [m2]
    vibration_scale: float  #: [J]
    effort_scale: float  #: [V2]


def reward_weights(params: Params) -> Weights:
    """Return the weights and scales of the parameters."""
    reward = params.reward
    return Weights(
        tracking=reward.tracking.weight,
        vibration=reward.vibration.weight,
        effort=reward.effort.weight,
        tracking_scale=reward.tracking.scale**2,
        vibration_scale=reward.vibration.scale,
        effort_scale=reward.effort.scale**2,
    )


@kernel
def reward_terms(weights, signals, status, terms):
    """Write the reward of one period, term by term in the order of ``REWARDS``, and return their sum.

    weights: :class:`Weights`; signals: (N_SIGNALS,) of the period; status: of its end; a failure earns nothing.
    terms: (3,) written, each in (0, weight] but for a failure.
    """
    going = where(status == RUNNING, 1.0, 0.0)
    square = signals[ERROR] * signals[ERROR]
    terms[TRACKING] = going * weights.tracking * tolerance(square / weights.tracking_scale)
    terms[VIBRATION_TERM] = going * weights.vibration * tolerance(signals[VIBRATION] / weights.vibration_scale)
    terms[EFFORT] = going * weights.effort * tolerance(signals[PIEZO] / weights.effort_scale)
    return terms[TRACKING] + terms[VIBRATION_TERM] + terms[EFFORT]


@kernel
def tolerance(x):
    """``1 / (1 + log(1 + x))`` of a measure ``x`` >= 0 in its scales: 1 at 0, falling, positive at any size."""
    return 1.0 / (1.0 + log1p(x))


@kernel
def period_cost(signals, status):
    """The cost of a period for safe reinforcement learning: 1 if an actuator saturates or the episode fails, else 0."""
    saturated = (signals[SAT_PIEZO] > 0.0) | (signals[SAT_THRUST] > 0.0) | (signals[SAT_JOINT] > 0.0)
    return where(saturated | (status != RUNNING), 1.0, 0.0)
