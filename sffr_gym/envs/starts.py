"""Whether the episodes of a scenario can be drawn for a robot, and begin inside of its observation space.

Asked once, when an environment is built or gets another scenario, and not in the middle of a training.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sffr_gym.compile.arguments import Structures
from sffr_gym.compile.workspace import new_workspace
from sffr_gym.config.params import Params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.envs.batch import make_batch, observe_range, put_episode
from sffr_gym.task.control_period import period_shapes
from sffr_gym.task.episode import Episode, Nominal, draw
from sffr_gym.task.scenario import Scenario
from sffr_gym.task.task_model import TaskModel, plant_of
from sffr_gym.types import Array

DRAWS = 64  # episodes that stand for all of a scenario
SEED = 0  # of them
BOUNDED_BY = {  # key of the parameters that bounds a field of the observation, by the field's unit
    "m": "limits.position", "rad": "limits.angle", "m/s": "limits.velocity", "rad/s": "limits.rate",
    "m/s2": "limits.velocity", "m, m, rad": "panel.length", "m/s, m/s, rad/s": "limits.rate",
}  # fmt: skip


class Extremes(np.random.Generator):
    """Random numbers two thirds of which lie at the ends of their interval, to find the extremes of what is drawn."""

    def random(self, size: Any = None, dtype: Any = np.float64, out: Any = None) -> Any:
        """Return 0, 1 or a number between, each as often."""
        inside = super().random(size, dtype, out)
        return np.choose(self.integers(3, size=size), [0.0, 1.0, inside])

    def uniform(self, low: Any = 0.0, high: Any = 1.0, size: Any = None) -> Any:
        """Return an end of the interval or a number inside, each as often."""
        return low + (high - low) * self.random(size)


def check_starts(scenario: Scenario, known: Nominal, plant: TaskModel) -> None:
    """Make sure that a scenario's episodes can be drawn, and that a start's true observation lies within its bounds.

    Args:
        scenario: what episodes are drawn from.
        known: what the controllers believe, and the plant before anything is drawn.
        plant: the latter, packed.

    Raises:
        ConfigError: if the robot lacks what the scenario asks for, or a start lies outside of the observation space;
            the message names the field, what it reaches, and the key of its bound.
    """
    reached = _reached(_Question(scenario, known.params, known.plant, known, plant))
    for part in known.fields.values():
        if part.size and reached[part.slice].max() > part.bound:
            raise ConfigError(
                f"{BOUNDED_BY[part.unit]}: bounds {part.name} to {part.bound:g} [{part.unit}], which a start of "
                f"scenario '{scenario.name}' exceeds with {reached[part.slice].max():.4g}; widen it, or draw less"
            )


@dataclass(frozen=True)
class _Question:
    """What the extremes of the starts depend on, and what was made of it."""

    scenario: Scenario
    params: Params
    plant: Params
    known: Nominal = field(compare=False)
    packed: TaskModel = field(compare=False)


@functools.lru_cache(maxsize=64)
def _reached(asked: _Question) -> Array:
    """Return the largest true observation (n_o,) at the starts; once for all environments that are alike."""
    rng, reached = Extremes(np.random.PCG64(SEED)), np.zeros(len(asked.packed.bound))
    for _ in range(DRAWS):
        episode = draw(asked.scenario, asked.known, rng)
        np.maximum(reached, np.abs(_observed(episode, asked.known, asked.packed)), out=reached)
        if not episode.drawn:  # all are the same
            break
    return reached


def _observed(episode: Episode, known: Nominal, nominal: TaskModel) -> Array:
    """Return the true observation (n_o,) at the start of an episode, wherever it lies."""
    plant = plant_of(nominal, known, episode)
    unbounded, batch = plant._replace(bound=np.full_like(plant.bound, np.inf)), make_batch(nominal, 1)
    exact = episode._replace(sensing=episode.sensing._replace(key=0, delay=0, coarse=0))
    put_episode(batch, 0, exact)
    observe_range(
        Structures([unbounded]), batch, np.ones(1, dtype=np.bool_), new_workspace(period_shapes(nominal)), 0, 1
    )
    return batch.obs[0]
