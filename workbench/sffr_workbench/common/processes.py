"""Worker processes that end with the process that started them."""

from __future__ import annotations

import os
import threading
import time

INTERVAL = 0.25  # s between two looks


def end_with_parent(parent: int) -> None:
    """Let this process end soon after its parent, whatever ended that; an unfinished file of it is then a part of one.

    On Windows, where a process keeps the number of a parent that is gone, it ends when it has nothing more to do.

    Args:
        parent: number of the process that started this one.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(INTERVAL)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
