"""Policies made to fit: actions inside the action space, and what acts in ``SFFRFlexDamping-v0``."""

from __future__ import annotations

from typing import Any

import numpy as np

from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv
from sffr_baselines.learned import LearnedSchedule, learned_file, load_schedule
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.types import Array

DampingEnv = SFFRFlexDampingEnv | SFFRFlexDampingVectorEnv


class BoxPolicy:
    """A policy whose actions lie in ``Box(-1, 1, float32)``: what goes beyond is clipped, as the environment does.

    Args:
        policy: of any actions.
    """

    def __init__(self, policy: Any) -> None:
        self.name, self._policy = policy.name, policy

    def __getattr__(self, name: str) -> Any:
        """Return what else the policy has, such as ``B_hat`` or ``set_plant``."""
        if name.startswith("__") or name == "_policy":  # a copy that has nothing yet
            raise AttributeError(name)
        return getattr(self._policy, name)

    def reset(self, seed: int | None = None) -> None:
        """Forget the last episode."""
        self._policy.reset(seed)

    def __call__(self, obs: Array) -> np.ndarray:
        """Return actions of the policy, rounded to float32 and clipped."""
        return np.clip(self._policy(obs), -1.0, 1.0).astype(np.float32)


class LawInside:
    """Action 0 of ``SFFRFlexDamping-v0``: the law inside as it is.

    Args:
        name: of the law.
        n_actions: length of an action.
    """

    def __init__(self, name: str, n_actions: int) -> None:
        self.name, self._n_actions = name, n_actions

    def reset(self, seed: int | None = None) -> None:
        """Do nothing: the environment keeps what a law remembers."""

    def __call__(self, obs: Array) -> np.ndarray:
        """Return zeros for one observation or a batch."""
        return np.zeros((*np.shape(obs)[:-1], self._n_actions), np.float32)


class ScheduleInside(LawInside):
    """A learned schedule in the learner's environment, whose law, ``rho`` and periods are the environment's.

    Args:
        name: what tables call it.
        schedule: that was learned.
    """

    def __init__(self, name: str, schedule: LearnedSchedule) -> None:
        super().__init__(name, len(schedule.action_names))
        self.schedule = schedule

    def __call__(self, obs: Array) -> np.ndarray:
        """Return the schedule's actions for one observation or a batch."""
        return self.schedule.predict(obs)[0]


def policy_inside(name: str, title: str, env: DampingEnv) -> LawInside:
    """Return a policy for ``SFFRFlexDamping-v0``: a learned schedule, or the environment's own law.

    Args:
        name: of a shipped schedule, an ``.npz`` file, or the law's.
        title: what tables call it.
        env: bare, single or batched.

    Raises:
        ConfigError: for a law that commands actuators, or a schedule of other observations or actions.
    """
    if learned_file(name) is None:
        if name == env.law_name:
            return LawInside(name, len(env.action_names))
        raise ConfigError(
            f"{name} commands the actuators of SFFRFlex-v0; in SFFRFlexDamping-v0 a policy schedules the damping of "
            f"the law inside: {env.law_name} (action 0), random, or a learned one such as sac"
        )
    schedule = load_schedule(name)
    if (schedule.obs_names, schedule.action_names) != (env.obs_names, env.action_names):
        raise ConfigError(
            f"{name} was made for another environment: law={schedule.law}, stack_size={schedule.stack_size}, with the "
            f"actions {', '.join(schedule.action_names)}"
        )
    return ScheduleInside(title, schedule)
