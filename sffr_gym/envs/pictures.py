"""What environments with pictures share: how often they are drawn, and what draws them, imported when it is needed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import gymnasium as gym

from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.task.task_model import TaskModel

if TYPE_CHECKING:
    from sffr_gym.render.environment import EnvironmentRenderer

RENDER_EVERY = 0.04  # s between two pictures
MOST_BETWEEN = 60.0  # s; whoever wants fewer pictures calls render() less often


def make_renderer(
    task: TaskModel, render_mode: str | None, every: float, damped: bool = False
) -> EnvironmentRenderer | None:
    """Return what draws an environment, or None without a render mode.

    Args:
        task: the robot.
        render_mode: ``rgb_array`` or ``human``.
        every: time between two pictures [s].
        damped: whether the virtual damping is drawn.

    Raises:
        ConfigError: for a time that is not from 0 to ``MOST_BETWEEN``.
        gymnasium.error.DependencyNotInstalled: see :func:`require_pillow`.
    """
    if not 0.0 <= every <= MOST_BETWEEN:
        raise ConfigError(f"render_every = {every}: must be from 0, a picture of every step, to {MOST_BETWEEN:g} s")
    if render_mode is None:
        return None
    require_pillow()
    from sffr_gym.render.environment import EnvironmentRenderer

    return EnvironmentRenderer(task.period, len(task.model.panel_root), every, render_mode == "human", damped)


def make_renderers(
    n: int, task: TaskModel, render_mode: str | None, every: float, damped: bool = False
) -> list[EnvironmentRenderer]:
    """Return what draws each of ``n`` environments, none without a render mode; see :func:`make_renderer`."""
    made = (make_renderer(task, render_mode, every, damped) for _ in range(n if render_mode else 1))
    return [renderer for renderer in made if renderer is not None]


def require_pillow() -> None:
    """Make sure that texts can be written into pictures.

    Raises:
        gymnasium.error.DependencyNotInstalled: if not, with what to install.
    """
    try:
        from PIL import ImageFont

        ImageFont.load_default(12.0)
    except ModuleNotFoundError:
        raise gym.error.DependencyNotInstalled("pictures need Pillow: pip install 'sffr-gym[render]'") from None
    except (ImportError, TypeError) as error:  # cannot be loaded, was built without FreeType, or is too old
        raise gym.error.DependencyNotInstalled(
            f"pictures need Pillow 10.1 or later with FreeType: {error}; pip install --upgrade 'sffr-gym[render]'"
        ) from None


def frame_rate(period: float) -> float:
    """Return how many steps of a length [s] there are in a second, a whole number if it is one."""
    rate = 1.0 / period
    return round(rate) if abs(rate - round(rate)) < 1e-9 * rate else rate
