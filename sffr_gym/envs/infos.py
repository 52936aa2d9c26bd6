"""Infos of a batch as Gymnasium's loop over single environments gives them: an array and a mask for each key."""

from __future__ import annotations

from typing import Any

import numpy as np

from sffr_gym.envs.batch import Batch
from sffr_gym.task.reward import REWARDS
from sffr_gym.task.signals import SIGNALS
from sffr_gym.task.status import failure_text
from sffr_gym.types import Array

Mask = np.ndarray
Infos = dict[str, Any]
Drawn = dict[str, tuple[Array, Mask]]  # values, and which environments drew one, by name


def batch_infos(batch: Batch, period: float, drawn: Drawn, mask: Mask, texts: bool = False) -> Infos:
    """Return the single environment's info of every environment, all arrays new.

    Args:
        batch: the environments.
        period: control period [s].
        drawn: what their scenarios drew.
        mask: (n,) environments that have an info.
        texts: also give the reason of each failure in words.
    """
    infos: Infos = dict(zip(SIGNALS, batch.signals.T.copy(), strict=True))
    infos |= {f"reward_{name}": column for name, column in zip(REWARDS, batch.terms.T.copy(), strict=True)}
    infos |= {"time": batch.tick * period, "clipped": batch.clipped.copy(), "failure": batch.status.copy()}
    infos |= {"cost": batch.cost.copy(), "applied": batch.applied.copy()}
    if texts:
        infos["failure_text"] = np.array([failure_text(number) for number in batch.status.tolist()], dtype=object)
    if mask.any():
        infos |= {f"_{key}": mask.copy() for key in infos}
    else:
        infos = {}
    for name, (values, has) in drawn.items():
        if (has & mask).any():
            infos |= {f"drawn_{name}": values.copy(), f"_drawn_{name}": has & mask}
    return infos


def masked(infos: Infos, mask: Mask) -> Infos:
    """Return infos with a mask beside each key, which leaves no more than it did."""
    found: Infos = {}
    for key, value in infos.items():
        if not key.startswith("_") and (has := infos.get(f"_{key}", mask) & mask).any():
            found |= {key: value, f"_{key}": has}
    return found


def objects(obs: np.ndarray, mask: Mask) -> np.ndarray:
    """Return the observations of masked environments as objects, which wrappers replace by those of another form."""
    rows = np.full(len(obs), None, dtype=object)
    for i in np.flatnonzero(mask):
        rows[i] = obs[i]
    return rows
