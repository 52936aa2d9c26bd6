"""What environments with pictures share: how often they are drawn, and what draws them, imported when it is needed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

from sffr_gym.config.params import Params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.envs.batch import visible
from sffr_gym.task.plants import drawn_plant
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
    if not (isinstance(every, float | int) and 0.0 <= every <= MOST_BETWEEN):
        raise ConfigError(f"render_every = {every!r}: must be from 0, a picture of every step, to {MOST_BETWEEN:g} s")
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


def check_pictures(renderers: Sequence[EnvironmentRenderer], kept: dict[str, Any], params: Params) -> dict[int, Params]:
    """Make sure that the environments of a batch can be drawn in a state, and return their plants by number.

    Args:
        renderers: of the environments, none without pictures.
        kept: a state whose other parts are sound.
        params: what the controllers believe.

    Raises:
        ValueError: for a state of other robots, or a damaged one.
    """
    pasts, plants = kept["trace"], {}
    if renderers and pasts is not None and not (isinstance(pasts, list) and len(pasts) == len(renderers)):
        raise ValueError(f"state.trace: must be a list of {len(renderers)}, one of each environment")
    for i in np.flatnonzero(kept["ticks"][: len(renderers)]).tolist():
        if pasts is not None:
            renderers[i].check(pasts[i], visible(kept["batch"], i), f"state.trace.{i}")
        drawn = {name: float(values[i]) for name, (values, has) in kept["drawn"].items() if has[i]}
        plants[i] = drawn_plant(params, drawn)
    return plants


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
