"""What draws an environment, imported when it is needed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import gymnasium as gym

from sffr_gym.task.task_model import TaskModel

if TYPE_CHECKING:
    from sffr_gym.render.environment import EnvironmentRenderer


def make_renderer(task: TaskModel, damped: bool = False) -> EnvironmentRenderer:
    """Return what draws an environment; raises gymnasium.error.DependencyNotInstalled without Pillow."""
    try:
        from sffr_gym.render.environment import EnvironmentRenderer
    except ModuleNotFoundError as error:
        if error.name != "PIL":
            raise
        raise gym.error.DependencyNotInstalled("pictures need Pillow: pip install 'sffr-gym[render]'") from None
    return EnvironmentRenderer(task.period, len(task.model.panel_root), damped)
