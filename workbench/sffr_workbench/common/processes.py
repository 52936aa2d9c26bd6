"""Worker processes: an interrupt does not reach them, and they end with the process that started them."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

INTERVAL = 0.25  # s between two looks


@contextmanager
def interrupts_ignored() -> Iterator[None]:
    """Start processes that an interrupt from the keyboard does not reach: who starts them ends them.

    They inherit that it is ignored, as nothing else; one that comes in the milliseconds of starting them is lost.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


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
