"""The batch of ``SFFRFlexDamping-v0`` as a Stable-Baselines3 ``VecEnv``, with a row for each environment or each panel.

With a row for each panel, one small network learns to schedule a single panel: every panel sees itself in its own axes,
and is rewarded for its own vibration and effort and its share of tracking. The rows' rewards add up to the
environment's.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvObs, VecEnvStepReturn

from sffr_baselines.damping_env import SFFRFlexDampingVectorEnv, damping_spaces
from sffr_gym.task.reward import REWARDS
from sffr_gym.types import Array

TRACKING = REWARDS.index("tracking")
_NOTHING: dict[str, Any] = {}  # the info of rows that are not done, shared by all of them


class DampingVecEnv(VecEnv):
    """A native vector environment with SB3's interface.

    Args:
        env: the environments, with SAME_STEP autoreset.
        per_panel: one row for each panel, not for each environment.

    Raises:
        ValueError: for another autoreset mode.
    """

    def __init__(self, env: SFFRFlexDampingVectorEnv, per_panel: bool = False) -> None:
        if env.autoreset_mode != AutoresetMode.SAME_STEP:
            raise ValueError(f"autoreset_mode must be SAME_STEP, got {env.autoreset_mode}")
        self.env = env
        self.rows = env.params.n_panels if per_panel else 1  # of each environment
        self._actions: Array = np.zeros(0)
        action, observation = damping_spaces(env.law, panels=env.params.n_panels // self.rows)
        super().__init__(env.num_envs * self.rows, observation, action)

    def reset(self) -> VecEnvObs:
        """Start new episodes, with the seeds of :meth:`seed` if there are any."""
        obs, _ = self.env.reset(seed=None if self._seeds[0] is None else self._seeds[:: self.rows])
        self._reset_seeds()
        self._reset_options()
        return self._row_observations(obs)

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions for :meth:`step_wait`."""
        self._actions = np.asarray(actions, dtype=np.float64).reshape(self.env.action_space.shape)

    def step_wait(self) -> VecEnvStepReturn:
        """Take a step; a finished environment is reset, its last observation in the infos of its rows."""
        obs, reward, terminated, truncated, infos = self.env.step(self._actions)
        done = terminated | truncated
        rows: list[dict[str, Any]] = [_NOTHING] * self.num_envs
        if done.any():
            final = self._row_observations(infos["final_obs"])
            for i in np.flatnonzero(np.repeat(done, self.rows)).tolist():
                late = bool(truncated[i // self.rows] and not terminated[i // self.rows])
                rows[i] = {"terminal_observation": final[i], "TimeLimit.truncated": late}
        return self._row_observations(obs), self._row_rewards(reward), np.repeat(done, self.rows), rows

    def _row_observations(self, obs: np.ndarray) -> np.ndarray:
        """Return observations of environments as rows."""
        return obs.reshape(self.num_envs, -1)

    def _row_rewards(self, reward: Array) -> np.ndarray:
        """Return rewards of environments as rows: a panel's own vibration and effort, and its share of tracking."""
        if self.rows == 1:
            return reward.astype(np.float32)
        own, terms = self.env.step_rewards
        return (own + terms[:, TRACKING, None] / self.rows).ravel().astype(np.float32)

    def close(self) -> None:
        """Close the environments."""
        self.env.close()

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seed environment i with ``seed + i`` at the next reset; all rows of an environment have one seed."""
        self._seeds = [None if seed is None else seed + i // self.rows for i in range(self.num_envs)]
        return self._seeds

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute, the same for every row."""
        value = None if attr_name == "render_mode" else getattr(self.env, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Raise NotImplementedError: the environments are one object."""
        raise NotImplementedError("the environments of a batch have no attributes of their own; make another batch")

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> list[Any]:
        """Raise NotImplementedError: the environments are one object."""
        raise NotImplementedError(f"call {method_name} on the batch, DampingVecEnv.env")

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """Return False for each row: no environment is wrapped."""
        return [False for _ in self._get_indices(indices)]


def make_sb3_vec_env(num_envs: int, per_panel: bool = False, **arguments: Any) -> DampingVecEnv:
    """Return a batch of ``SFFRFlexDamping-v0`` for Stable-Baselines3.

    Args:
        num_envs: number of environments.
        per_panel: one row for each panel.
        arguments: of :class:`SFFRFlexDampingVectorEnv`.
    """
    env = SFFRFlexDampingVectorEnv(num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **arguments)
    return DampingVecEnv(env, per_panel)


def batch_of(env: VecMonitor) -> SFFRFlexDampingVectorEnv:
    """Return the environments inside a monitored :class:`DampingVecEnv`."""
    rows = env.venv
    assert isinstance(rows, DampingVecEnv)
    return rows.env
