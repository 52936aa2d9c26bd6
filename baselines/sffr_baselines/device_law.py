"""Laws on a GPU: one thread for the law of each environment, on the observations where they are."""

from __future__ import annotations

from typing import Any

import numpy as np

from sffr_baselines.closed_loop import act
from sffr_baselines.control_law import Law, LawState, law_shapes, make_states, state_shapes
from sffr_gym.compile.cuda.described import Fixed, Memory, Row, Thread, rows
from sffr_gym.envs.device import DeviceVectorEnv


class DeviceLaw:
    """A law for ``SFFRFlex-v0`` on a device, which acts on what its environments observe now.

    Args:
        law: what it does and believes; the numbers of a learned schedule are a part of it.
        envs: the environments.

    Raises:
        ValueError: for a law of a robot with other observations or actuators.
    """

    def __init__(self, law: Law, envs: DeviceVectorEnv) -> None:
        prior = envs.host.prior_task
        if law.at != prior.at or len(law.scale) != len(prior.scale):
            raise ValueError("the law was made for a robot with other observations or actuators than this one's")
        xp, n = envs.device.xp, envs.num_envs
        self._law, self._tick = law, xp.zeros(1, dtype=np.int64)
        self._states = LawState(*(rows(xp, n, shape, "f") for shape in state_shapes(law)))
        self._actions: Any = rows(xp, n, law.scale.shape, "f")
        states: Any = map(Row, self._states)
        thread = Thread("act", act, (
            law, Fixed(self._tick), Row(envs.batch.obs), LawState(*states), Row(self._actions),
            Memory(law_shapes(law)),
        ))  # fmt: skip
        self._xp, self._launch = xp, envs.device.launches(n, [thread])["act"]
        self.reset()

    def reset(self) -> None:
        """Put the law of every environment to the start of an episode."""
        self._tick[...] = 0
        for array, start in zip(self._states, make_states(self._law, 1), strict=True):
            array[...] = self._xp.asarray(start)

    def __call__(self) -> Any:
        """Return the actions (n, n_u), written anew by the next call."""
        self._launch()
        self._tick += 1
        return self._actions
