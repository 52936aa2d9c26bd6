"""Where a result comes from: versions, machine, and the commit of the code."""

from __future__ import annotations

import os
import platform
import shlex
import subprocess
from collections.abc import Sequence
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

MANIFEST = "manifest.json"  # the file of a run folder that says where it comes from
PACKAGES = ("numpy", "numba", "gymnasium", "scipy", "sffr-gym")


def origin(command: Sequence[str], started: datetime, elapsed: float, packages: Sequence[str] = ()) -> dict[str, Any]:
    """Return command, start, duration [s], versions (of more packages, if named), machine and code of a result."""
    return {
        "command": shlex.join(command),
        "started": started.isoformat(timespec="seconds"),
        "duration_s": elapsed,
        "versions": {"python": platform.python_version()}
        | {name: package_version(name) for name in (*PACKAGES, *packages)},
        "platform": platform.platform(),
        "machine": platform.machine(),
        "cpus": os.cpu_count(),
        "git": git_state(Path(__file__).parents[1]),
    }


def package_version(name: str) -> str | None:
    """Return the version of an installed distribution; None if it is not installed as one."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def git_state(source: Path) -> dict[str, Any] | None:
    """Return the commit of the checkout that tracks a folder of sources, and whether anything differs; else None."""

    def git(*arguments: str) -> str:
        done = subprocess.run(["git", "-C", str(source), *arguments], capture_output=True, text=True, check=True)
        return done.stdout.strip()

    try:
        git("ls-files", "--error-unmatch", "__init__.py")  # an environment inside of some checkout is no part of it
        return {"commit": git("rev-parse", "HEAD"), "dirty": bool(git("status", "--porcelain"))}
    except (OSError, subprocess.CalledProcessError):
        return None
