"""A window on the screen that shows pictures in real time, by pygame, which is imported when the first one is shown.

Nothing of pygame is kept in the object, so that environments with a window can be copied and pickled.
"""

from __future__ import annotations

import os
import time
from typing import Any

import gymnasium as gym
import numpy as np

SLICE = 0.04  # s, as long as the window may leave a click without an answer
INSTEAD = (
    "take render_mode='rgb_array', which needs no display, or set SDL_VIDEODRIVER=dummy to run without seeing anything"
)


class Window:
    """Shows pictures, each no sooner after the one before than in real time.

    Closing it on the screen leaves the program running without pictures. A copy of an environment, such as a planner
    makes to look ahead, shows nothing before its own next episode or call of ``render``.
    """

    def __init__(self) -> None:
        self._open = False  # whether the window on the screen is this one's
        self._shut = False  # by a click, for good
        self._awake = True
        self._last: tuple[float, float] | None = None  # simulated and real time of the picture before [s]

    def begin(self) -> None:
        """Measure time anew, since an episode begins or another state is shown."""
        self._last = None

    def wake(self) -> None:
        """Show pictures from now on, also as a copy."""
        self._awake = True

    def is_awake(self, tick: int) -> bool:
        """Return whether pictures are shown in this control period."""
        self._awake = self._awake or tick == 0
        return self._awake and not self._shut

    def show(self, picture: np.ndarray, t: float) -> None:
        """Show a picture (height, width, 3), uint8, of a simulated time [s], when as much real time has passed.

        Raises:
            gymnasium.error.DependencyNotInstalled: without pygame, or if that cannot be loaded.
            gymnasium.error.Error: if no window can be opened.
        """
        if self._shut:
            return
        pygame = _pygame()
        screen = self._screen(pygame, picture.shape[1::-1])
        try:
            self._wait(pygame, t)
            pygame.surfarray.blit_array(screen, picture.swapaxes(0, 1))
            pygame.display.flip()
            closed = bool(pygame.event.get(pygame.QUIT))  # other events are left to who asks for them
        except pygame.error as error:
            gym.logger.warn(f"the window is gone, the simulation goes on without pictures: {error}")
            closed = True
        if closed:
            self.close()
            self._shut = True

    def close(self) -> None:
        """Close the window; a second time does nothing."""
        if self._open:
            _pygame().display.quit()
            self._open = False

    def __getstate__(self) -> dict[str, object]:
        return self.__dict__ | {"_open": False, "_awake": False, "_last": None}

    def _screen(self, pygame: Any, size: tuple[int, int]) -> Any:
        """Return the window's surface, opened anew if another environment has closed or changed it."""
        surface = pygame.display.get_surface() if pygame.display.get_init() else None
        if surface is None or surface.get_size() != size:
            try:
                pygame.display.init()
                if pygame.display.get_driver() == "offscreen" and not os.environ.get("SDL_VIDEODRIVER"):
                    raise pygame.error("no display found")  # what SDL takes then shows nothing to anybody
                pygame.display.set_caption("sffr-gym")
                surface = pygame.display.set_mode(size)
            except pygame.error as error:
                pygame.display.quit()
                raise gym.error.Error(f"render_mode='human' cannot open a window: {error}; {INSTEAD}") from None
        self._open = True
        return surface

    def _wait(self, pygame: Any, t: float) -> None:
        """Wait until as much real time has passed since the picture before as simulated time; late ones do not wait."""
        now = time.perf_counter()
        before, then = self._last or (t, now)
        due = max(then + t - before, now)
        while (left := due - time.perf_counter()) > 0.0 and not pygame.event.peek(pygame.QUIT):
            time.sleep(min(left, SLICE))
        self._last = t, due


def _pygame() -> Any:
    """Import pygame.

    Raises:
        gymnasium.error.DependencyNotInstalled: if it is not there or cannot be loaded.
    """
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # it greets on import otherwise
    try:
        import pygame
        import pygame.display
        import pygame.event
        import pygame.surfarray
    except ModuleNotFoundError:
        raise gym.error.DependencyNotInstalled(
            "render_mode='human' needs pygame: pip install 'sffr-gym[render]'"
        ) from None
    except ImportError as error:
        raise gym.error.DependencyNotInstalled(
            f"render_mode='human' needs pygame, which is installed but cannot be loaded: {error}; "
            "pip install --force-reinstall pygame-ce"
        ) from None
    return pygame
