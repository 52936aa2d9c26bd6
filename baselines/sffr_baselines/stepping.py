"""Episodes of any policy, many side by side: the environments' own steps, without what only agents need."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from sffr_baselines.closed_loop import Record, make_record
from sffr_gym.envs.fleet import plant_at
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.physics.kinematics import modal_tip_deflections
from sffr_gym.physics.model import mode_slice
from sffr_gym.task.episode import Episode
from sffr_gym.task.scenario import MOST_PERIODS
from sffr_gym.task.status import REASONS, RUNNING
from sffr_gym.types import Array

PIECE = 500  # control periods between two reports of progress


class Episodes(SFFRFlexVectorEnv):
    """Episodes of a scenario, one for each seed, at their start.

    Args:
        env: the environment that they are of.
        seeds: of the episodes.

    Attributes:
        begun: what was drawn for each.
    """

    ONE_BY_ONE = True

    def __init__(self, env: SFFRFlexEnv, seeds: Sequence[int]) -> None:
        super().__init__(
            len(seeds), scenario=env.scenario, params=env.params, autoreset_mode=AutoresetMode.DISABLED
        )  # fmt: skip
        self.begun: dict[int, Episode] = {}
        self.reset(seed=[int(seed) for seed in seeds])

    def _start(self, i: int, episode: Episode) -> None:
        self.begun[i] = episode
        super()._start(i, episode)

    def run(
        self, policy: Callable[[Array], Array], stride: int, progress: Callable[[int], Any]
    ) -> list[tuple[Episode, Record, int, str]]:
        """Run all episodes to their ends.

        Args:
            policy: turns observations (n, n_o) into actions (n, n_u).
            stride: control periods between recorded states.
            progress: called with control periods done since its last call, of all episodes together.

        Returns:
            For each episode what was drawn, its record, the control periods that it lasted, and why it ended early.
        """
        batch, stepper, n = self._batch, self._stepper, self.num_envs
        plants = [plant_at(self._fleet, i if len(self._fleet.numbers) > 1 else 0) for i in range(n)]
        ticks = self._ticks.copy()
        records = [make_record(plant, int(last), stride) for plant, last in zip(plants, ticks, strict=True)]
        modes = mode_slice(plants[0].model)
        amplitudes = np.zeros((PIECE, n, modes.stop - modes.start))
        signals = np.zeros((PIECE, *batch.signals.shape))
        done, failures = np.zeros(n, dtype=np.int64), [""] * n
        active = stepper.active
        active[:] = True
        first, running, next_end = 0, n, int(ticks.min())
        while running:
            count = 0
            while count < PIECE and running:
                tick = first + count
                if tick % stride == 0:
                    self._keep_state(records, active, tick // stride)
                stepper.actions[:] = policy(batch.obs.copy())  # which it may keep
                stepper.step()
                signals[count], amplitudes[count] = batch.signals, batch.p[:, modes]
                if tick % stride == 0:
                    for i in np.flatnonzero(active).tolist():
                        records[i].applied[tick // stride] = batch.applied[i]
                count += 1
                if tick + 1 >= next_end or np.count_nonzero(batch.status):
                    ended = active & ((batch.status != RUNNING) | (ticks <= tick + 1))
                    for i in np.flatnonzero(ended).tolist():
                        done[i], failures[i] = tick + 1, REASONS[float(batch.status[i])]
                    active &= ~ended
                    running = int(active.sum())
                    next_end = int(ticks[active].min(initial=MOST_PERIODS))
            for i in range(n):
                rows = slice(first, min(first + count, int(done[i]) or first + count))
                kept = rows.stop - rows.start
                if kept > 0:
                    own = amplitudes[:kept, i].reshape(kept, *plants[i].model.omega2.shape)
                    records[i].signals[rows] = signals[:kept, i]
                    records[i].tips[rows] = modal_tip_deflections(plants[i].model, own)
            progress(count * n)
            first += count
        return [(self.begun[i], records[i], int(done[i]), failures[i]) for i in range(n)]

    def _keep_state(self, records: Sequence[Record], active: np.ndarray, row: int) -> None:
        """Write the states at a period's start into a row of the records."""
        batch = self._batch
        for i in np.flatnonzero(active).tolist():
            record = records[i]
            record.p[row], record.v[row], record.obs[row] = batch.p[i], batch.v[i], batch.obs[i]
            record.B_hat[row] = record.q_flex[row] = record.lam[row] = np.nan  # not of a law with a virtual damping
