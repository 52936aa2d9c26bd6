"""The reward of a control period, term by term, and its cost for safe reinforcement learning."""

from __future__ import annotations

from typing import NamedTuple

from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.lanes import where
from sffr_gym.config.params import Params
from sffr_gym.task.signals import ERROR, PIEZO, SAT_JOINT, SAT_PIEZO, SAT_THRUST, VIBRATION
from sffr_gym.task.status import RUNNING

REWARDS = ("tracking", "vibration", "effort")
TRACKING, VIBRATION_TERM, EFFORT = range(len(REWARDS))


class Weights(NamedTuple):
    """Reward per second for each unit of the terms' measures, named as in ``REWARDS``."""

    tracking: float  #: [1/(m2 s)]
    vibration: float  #: [1/(J s)]
    effort: float  #: [1/(V2 s)]


def reward_weights(params: Params) -> Weights:
    """Return the weights of the parameters: of each term its weight over its scale."""
    reward = params.reward
    return Weights(
        tracking=reward.tracking.weight / reward.tracking.scale**2,
        vibration=reward.vibration.weight / reward.vibration.scale,
        effort=reward.effort.weight / reward.effort.scale**2,
    )


@kernel
def reward_terms(weights, period, signals, terms):
    """Write the reward of one period, term by term in the order of ``REWARDS``, and return their sum.

    weights: :class:`Weights`; period: [s]; signals: (N_SIGNALS,); terms: (3,).
    """
    terms[TRACKING] = -period * weights.tracking * signals[ERROR] * signals[ERROR]
    terms[VIBRATION_TERM] = -period * weights.vibration * signals[VIBRATION]
    terms[EFFORT] = -period * weights.effort * signals[PIEZO]
    return terms[TRACKING] + terms[VIBRATION_TERM] + terms[EFFORT]


@kernel
def period_cost(signals, status):
    """The cost of a period for safe reinforcement learning: 1 if an actuator saturates or the episode fails, else 0."""
    saturated = (signals[SAT_PIEZO] > 0.0) | (signals[SAT_THRUST] > 0.0) | (signals[SAT_JOINT] > 0.0)
    return where(saturated | (status != RUNNING), 1.0, 0.0)
