"""The command ``sffr`` as a process: an interrupt ends it without a traceback from its first moment on."""

from __future__ import annotations

import os
import sys
import warnings
from typing import Any

INTERRUPTED = 130  # exit code after SIGINT, as shells have it


def _one_line(message: Warning | str, *_: Any, **__: Any) -> str:
    """Return a warning as users read it, without the code that gave it."""
    return f"warning: {message}\n"


def main() -> None:
    """Run a command; what it was doing when an interrupt came is left as a killed process leaves it."""
    warnings.formatwarning = _one_line
    _check_folder()
    try:
        from sffr_workbench.cli.app import app  # takes half a second, in which somebody may change their mind

        app()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr, flush=True)
        os._exit(INTERRUPTED)  # threads that still work would print tracebacks of their own


def _check_folder() -> None:
    """End with a sentence if the working directory has been deleted: libraries fail there in ways of their own."""
    try:
        os.getcwd()
    except OSError as error:
        print(
            f"error: the working directory cannot be used ({error.strerror}); change to one that exists",
            file=sys.stderr,
        )
        sys.exit(2)


if __name__ == "__main__":
    main()
