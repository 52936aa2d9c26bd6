"""The batch of ``SFFRFlexDamping-v0`` as a Stable-Baselines3 ``VecEnv``, with a row for each environment or each panel.

With a row for each panel, one small network learns to schedule a single panel: every panel sees itself in its own axes,
and pays for its own vibration and effort and its share of tracking. Rewards are the score's terms and have no bounds:
the damping, which can only take energy out of a panel, gives no way to end an episode, the panels are linear, and
what is learned from motions of one size then holds for all.
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
from sffr_gym.envs.arguments import check_options
from sffr_gym.envs.infos import Infos
from sffr_gym.envs.spaces import check_action
from sffr_gym.types import Array

OPTIONS = ("scenario",)  # of a reset


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
        panels, dtype = env.params.n_panels // self.rows, np.dtype(env.single_observation_space.dtype)
        action, observation = damping_spaces(env.law, panels, dtype)
        super().__init__(env.num_envs * self.rows, observation, action)

    def reset(self) -> VecEnvObs:
        """Start new episodes, with the seeds of :meth:`seed` and options of :meth:`set_options` if there are any."""
        seeds = None if self._seeds[0] is None else self._seeds[:: self.rows]
        obs, infos = self.env.reset(seed=seeds, options=self._options[0])
        self._reset_seeds()
        self._reset_options()
        self.reset_infos = self._row_infos(infos)
        return self._row_observations(obs)

    def set_options(self, options: list[dict[str, Any]] | dict[str, Any] | None = None) -> None:
        """Set the options of the next reset: ``scenario``, the same one for all rows.

        Raises:
            ValueError: for another option, or options that differ from row to row.
        """
        rows = list(options) if isinstance(options, list | tuple) else [options] * self.num_envs
        if len(rows) != self.num_envs or any((row or {}) != (rows[0] or {}) for row in rows):
            raise ValueError(
                f"options must be the same for all {self.num_envs} rows, which are one batch; got {options}"
            )
        super().set_options(check_options(rows[0], OPTIONS))

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions for :meth:`step_wait`; raises ValueError as the environments' ``step`` does."""
        rows = check_action(actions, (self.num_envs, *(self.action_space.shape or ())))
        self._actions = rows.reshape(self.env.action_space.shape)

    def step_wait(self) -> VecEnvStepReturn:
        """Take a step; a finished environment is reset, its last observation in the infos of its rows.

        The info of a row is that of its environment, of a finished one that of its last step, and a dict of its own.
        """
        obs, _, terminated, truncated, infos = self.env.step(self._actions)
        done, rows = np.repeat(terminated | truncated, self.rows), self._row_infos(infos)
        late = np.repeat(truncated & ~terminated, self.rows).tolist()
        if done.any():
            finished, last = self._row_infos(infos["final_info"]), infos["final_obs"]
            for i in np.flatnonzero(done).tolist():
                self.reset_infos[i], rows[i] = rows[i], finished[i]
                rows[i]["terminal_observation"] = last[i // self.rows].reshape(self.rows, -1)[i % self.rows]
        for row, is_late in zip(rows, late, strict=True):
            row["TimeLimit.truncated"] = is_late
        return self._row_observations(obs), self._row_rewards(), done, rows

    def _row_infos(self, infos: Infos) -> list[dict[str, Any]]:
        """Return infos of environments as a dict for each row."""
        panels = [_split(infos, self.env.num_envs) for _ in range(self.rows)]
        return [panel[i] for i in range(self.env.num_envs) for panel in panels]

    def _row_observations(self, obs: np.ndarray) -> np.ndarray:
        """Return observations of environments as rows."""
        return obs.reshape(self.num_envs, -1)

    def _row_rewards(self) -> np.ndarray:
        """Return rewards of rows: the negative price of each panel, or of all panels of each environment."""
        prices = self.env.step_prices
        return -prices.reshape(self.num_envs, -1).sum(axis=1).astype(np.float32)

    def close(self) -> None:
        """Close the environments."""
        self.env.close()

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seed environment i with ``seed + i`` at the next reset; all rows of an environment have one seed."""
        self._seeds = [None if seed is None else seed + i // self.rows for i in range(self.num_envs)]
        return self._seeds

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of each row's environment; raises AttributeError as the batch's ``get_attr`` does."""
        values = (None,) * self.env.num_envs if attr_name == "render_mode" else self.env.get_attr(attr_name)
        return [values[i // self.rows] for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Raise NotImplementedError: the environments are one object."""
        raise NotImplementedError("the environments of a batch have no attributes of their own; make another batch")

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> list[Any]:
        """Return what a method of each row's environment gives; raises AttributeError as the batch's ``call`` does."""
        values = self.env.call(method_name, *args, **kwargs)
        return [values[i // self.rows] for i in self._get_indices(indices)]

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


def _split(infos: Infos, n: int) -> list[dict[str, Any]]:
    """Return infos of a batch as a dict for each environment, which shares nothing with another one."""
    found: list[dict[str, Any]] = [{} for _ in range(n)]
    for key, values in infos.items():
        if key.startswith(("_", "final_")):
            continue
        entries = values.tolist() if values.ndim == 1 else [row.copy() for row in values]
        for i in np.flatnonzero(infos[f"_{key}"]).tolist():
            found[i][key] = entries[i]
    return found
