"""Learning for a linear system: values in units of the energy that a panel still has.

Free vibration that is twice as large costs four times as much and is best damped in just the same way, so the value of
a state is its energy times a function of the motion's direction. The critic learns this function alone, and states
count alike at any amplitude; else the first seconds of the liveliest episodes would drown all that comes later, where
the score is made as well. For PPO this divides values, returns and advantages; for the algorithms with a replay buffer
``Q = E q`` in ``Q(s, a) = r + gamma Q(s', a')`` gives ``q(s, a) = r / E + (gamma E' / E) q(s', a')``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from stable_baselines3.common.buffers import ReplayBuffer, RolloutBuffer
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.type_aliases import ReplayBufferSamples, Schedule

from sffr_baselines.schedule import LOG_AMPLITUDE, N_FEATURES

FLOOR = 0.02  # of the energy scale, about what the path's own acceleration keeps in a damped panel


def energy(obs: Any, stack_size: int) -> Any:
    """Return the energy (...) of all panels in observations, over the reward's scale.

    Args:
        obs: (..., panels x stack_size x N_FEATURES).
        stack_size: observations of each panel, of which the first is the newest.
    """
    return (10.0 ** (2.0 * obs[..., LOG_AMPLITUDE :: stack_size * N_FEATURES]) + FLOOR).sum(-1)


class SchedulePolicy(ActorCriticPolicy):
    """Actor and critic of a schedule.

    The mean of the actions goes through tanh: the best schedules jump between the bounds, and a mean that leaves the
    bounds explores nothing any more. Their spread can stay as it was: since it costs, it is soon learned away, and with
    it goes how far a clipped update can move the mean.

    Args:
        arguments: of ``ActorCriticPolicy``.
        learn_spread: let the spread of the actions be learned.
    """

    def __init__(self, *arguments: Any, learn_spread: bool = True, **named: Any) -> None:
        self._learn_spread = learn_spread
        super().__init__(*arguments, **named)

    def _build(self, lr_schedule: Schedule) -> None:
        super()._build(lr_schedule)
        self.action_net = torch.nn.Sequential(self.action_net, torch.nn.Tanh())
        self.log_std.requires_grad_(self._learn_spread)


class EnergyPolicy(SchedulePolicy):
    """Actor and critic of a schedule, whose critic learns values per unit of energy.

    Args:
        arguments: of :class:`SchedulePolicy`.
        stack_size: observations that are seen at once.
    """

    def __init__(self, *arguments: Any, stack_size: int = 1, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._stack_size = stack_size

    def forward(
        self, obs: torch.Tensor, deterministic: bool = False
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return actions, values and log-probabilities while collecting; values in units of the reward."""
        actions, values, log_probability = super().forward(obs, deterministic)
        return actions, values * energy(obs, self._stack_size)[:, None], log_probability

    def predict_values(self, obs: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
        """Return values in units of the reward."""
        return super().predict_values(obs) * energy(obs, self._stack_size)[:, None]


class EnergyRolloutBuffer(RolloutBuffer):
    """Rollouts whose advantages and returns are divided by the energy of their state.

    Args:
        arguments: of ``RolloutBuffer``.
        stack_size: observations that are seen at once.
    """

    def __init__(self, *arguments: Any, stack_size: int = 1, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._stack_size = stack_size

    def compute_returns_and_advantage(self, last_values: torch.Tensor, dones: np.ndarray) -> None:
        """Estimate advantages in units of the reward, then divide."""
        super().compute_returns_and_advantage(last_values, dones)
        scale = energy(self.observations, self._stack_size)
        for array in (self.advantages, self.returns, self.values):
            array /= scale


class EnergyReplayBuffer(ReplayBuffer):
    """Transitions whose rewards are divided by the energy of their state, and whose discounts follow it.

    Args:
        gamma: discount of an action.
        stack_size: observations that are seen at once.
        arguments: of ``ReplayBuffer``.
    """

    def __init__(self, *arguments: Any, gamma: float, stack_size: int = 1, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.gamma, self._stack_size = gamma, stack_size

    def _get_samples(self, batch_inds: np.ndarray, env: Any = None) -> ReplayBufferSamples:
        samples = super()._get_samples(batch_inds, env)
        scale = energy(samples.observations, self._stack_size)[:, None]
        discounts = self.gamma * energy(samples.next_observations, self._stack_size)[:, None] / scale
        return samples._replace(rewards=samples.rewards / scale, discounts=discounts)
