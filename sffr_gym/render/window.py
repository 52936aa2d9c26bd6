"""A window on the screen that shows pictures in real time, by pygame, which is imported when the first one is shown."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled


class Window:
    """Shows pictures, ``FPS`` for a second of simulated time and no faster than that in real time.

    Closing it on the screen leaves the program running without pictures.

    Args:
        period: control period [s].
    """

    FPS = 25

    def __init__(self, period: float) -> None:
        self._stride = max(round(1.0 / (self.FPS * period)), 1)
        self._screen: Any = None
        self._clock: Any = None
        self._shut = False

    def is_due(self, tick: int) -> bool:
        """Return whether a picture of this control period is to be shown."""
        return tick % self._stride == 0 and not self._shut

    def show(self, picture: np.ndarray) -> None:
        """Show a picture (height, width, 3), uint8.

        Raises:
            gymnasium.error.DependencyNotInstalled: without pygame.
        """
        if self._shut:
            return
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # it greets on import otherwise
        try:
            import pygame
        except ModuleNotFoundError:
            raise DependencyNotInstalled("a window needs pygame: pip install 'sffr-gym[render]'") from None
        if self._screen is None:
            pygame.display.init()
            pygame.display.set_caption("sffr-gym")
            self._screen = pygame.display.set_mode(picture.shape[1::-1])
            self._clock = pygame.time.Clock()
        pygame.surfarray.blit_array(self._screen, picture.swapaxes(0, 1))
        pygame.display.flip()
        self._clock.tick(self.FPS)
        if any(event.type == pygame.QUIT for event in pygame.event.get()):
            self.close()
            self._shut = True

    def close(self) -> None:
        """Close the window; a second time does nothing."""
        if self._screen is not None:
            import pygame

            pygame.display.quit()
            self._screen = None
