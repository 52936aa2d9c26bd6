"""The environments of a batch one by one, for who asks it for attributes as one asks Gymnasium's ``SyncVectorEnv``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sffr_gym.envs.batch import Batch
from sffr_gym.envs.fleet import plant_at
from sffr_gym.physics.simulator import State, unflatten
from sffr_gym.task.reference import N_REFERENCE, Reference
from sffr_gym.task.task_model import TaskModel
from sffr_gym.types import Array

if TYPE_CHECKING:
    from sffr_gym.envs.vector import SFFRFlexVectorEnv


class Present:
    """The present state of an environment of a batch, in the plant's coordinates."""

    prior_task: TaskModel  #: the robot as the controllers believe it to be
    _batch: Batch
    _row = 0  # of the batch

    @property
    def plant_task(self) -> TaskModel:
        """The robot of this episode as it is, packed; ``prior_task`` is what the controllers believe."""
        raise NotImplementedError

    @property
    def time(self) -> float:
        """Time since the start of the episode [s]."""
        return float(self._batch.tick[self._row] * self.prior_task.period)

    @property
    def positions(self) -> Array:
        """A copy of the plant's positions ``p`` (n,), laid out as ``sffr_gym.physics.model`` says."""
        return self._batch.p[self._row].copy()

    @property
    def velocities(self) -> Array:
        """A copy of the plant's velocities ``v`` (n,)."""
        return self._batch.v[self._row].copy()

    def state(self) -> State:
        """The plant's state in the paper's coordinates, for :class:`Simulator` and plots."""
        return unflatten(self.plant_task.model, self.time, self._batch.p[self._row], self._batch.v[self._row])


class Member(Present):
    """Environment ``row`` of a vector environment, as far as it can be read.

    Attributes are those of the single environment: what it has of its own, and what the batch says of all.

    Args:
        env: the batch.
        row: which of its environments.
    """

    def __init__(self, env: SFFRFlexVectorEnv, row: int) -> None:
        self.prior_task, self._batch, self._env, self._row = env.prior_task, env._batch, env, row

    @property
    def plant_task(self) -> TaskModel:
        """The robot of this episode as it is, packed."""
        plant: TaskModel = plant_at(self._env._fleet, self._row)
        return plant

    @property
    def ticks(self) -> int:
        """Length of this episode in control periods."""
        return int(self._env._ticks[self._row])

    @property
    def reference(self) -> Reference:
        """The desired motion of this episode."""
        numbers, arrays = np.split(self._batch.reference[self._row], [N_REFERENCE])
        joints, pieces = np.split(arrays, [len(self.prior_task.model.link_mass)])
        return Reference._make([*numbers.tolist(), joints.copy(), pieces.copy()])

    @property
    def np_random(self) -> np.random.Generator:
        """What this environment's episodes are drawn with."""
        return self._env.np_random[self._row]

    @property
    def np_random_seed(self) -> int:
        """The seed of it; -1 if that is not known."""
        return self._env.np_random_seed[self._row]

    def read(self, name: str) -> Any:
        """Return an attribute; raises AttributeError, which says what to use instead, for what cannot be read."""
        return self.__getattr__(name) if name.startswith("_") else getattr(self, name)

    def __getattr__(self, name: str) -> Any:
        """Return what is the same for all environments, or a row of what the batch has of each."""
        batched = {"action_space": "single_action_space", "observation_space": "single_observation_space"}
        if name in self._env.OF_ALL or name in batched:
            return getattr(self._env, batched.get(name, name))
        if name in self._env.OF_EACH:
            return getattr(self._env, name)[self._row]
        raise AttributeError(
            f"the environments of a batch have no {name!r} of their own that could be read or called; reset some with "
            "reset(options={'reset_mask': mask}), keep and restore all with get_state() and set_state(), or make a "
            "vector environment of single ones with vectorization_mode='sync'"
        )
