"""The one ``kernel`` decorator: every numba setting of the project, and where compiled code is cached.

numba's own cache does not notice an edit in a kernel that another file defines, so the cache lies in a folder that is
named by a hash of the sources that speak of kernels: an edit there compiles anew, an unchanged tree starts in seconds.
"""

from __future__ import annotations

import functools
import hashlib
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

CACHE_ROOT = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "sffr-gym"
MAX_CACHE_AGE = 30 * 24 * 3600.0  # s, compiled code of older sources is removed after this

_USER_CHOSE_CACHE = "NUMBA_CACHE_DIR" in os.environ
_sources: list[bytes] = []
_folders: dict[str, Path] = {}


def cache_sources(package: str, sources: Path) -> Path:
    """Name the cache folder of a package's kernels by a hash of its sources and of those hashed before.

    A package whose kernels call those of another one calls this after importing it and before it defines any.

    Args:
        package: its full name, such as ``baselines``; packages below it are named apart.
        sources: folder that holds its ``.py`` files.

    Returns:
        The folder; the user's own, if ``NUMBA_CACHE_DIR`` is set.
    """
    if _USER_CHOSE_CACHE:
        return Path(numba.config.CACHE_DIR)
    _sources.extend(text for path in sorted(sources.glob("*.py")) if b"kernel" in (text := path.read_bytes()))
    digest = hashlib.sha256(b"".join(_sources)).hexdigest()[:16]
    folder = _folders[package] = CACHE_ROOT / digest
    if folder.is_dir():
        os.utime(folder)  # in use; see remove_stale_caches
    return folder


def kernel(
    function: Callable[..., Any] | None = None,
    *,
    inline: bool = False,
    allocates: bool = False,
    nogil: bool = False,
) -> Any:
    """Compile a function of plain arrays and scalars, cached on disk.

    Strict IEEE arithmetic: no ``fastmath``, so that ``isfinite`` sees NaN and a kernel gives the same bits wherever it
    is inlined. Division by zero gives inf, as in NumPy. Kernels never raise.

    Args:
        function: the function, when used as a plain decorator.
        inline: paste it into its callers; for the small inner ones, whose calls would cost more than their arithmetic.
        allocates: it makes or returns arrays. All others own no memory, so that numba's reference counting, which takes
            longer than their arithmetic, is switched off for them.
        nogil: release the interpreter's lock, for threads.
    """
    if function is None:
        return functools.partial(kernel, inline=inline, allocates=allocates, nogil=nogil)
    options = {"forceinline": inline, "_nrt": allocates, "nogil": nogil}
    folder = _folders.get(function.__module__.rpartition(".")[0])
    others = numba.config.CACHE_DIR  # numba reads it while it decorates; a user's own kernels keep theirs
    if folder is not None:
        numba.config.CACHE_DIR = str(folder)
    try:
        return numba.njit(cache=True, error_model="numpy", **options)(function)
    finally:
        numba.config.CACHE_DIR = others


def is_compiled() -> bool:
    """Say whether compiled kernels of these very sources lie in the cache (a first run takes about a minute)."""
    folders = _folders.values() if _folders else [Path(numba.config.CACHE_DIR)]
    return all(folder.is_dir() and any(folder.rglob("*.nbi")) for folder in folders)


def remove_stale_caches() -> None:
    """Remove the cache folders of sources that have not run for a while."""
    for folder in CACHE_ROOT.iterdir() if CACHE_ROOT.is_dir() else ():
        if folder not in _folders.values() and time.time() - folder.stat().st_mtime > MAX_CACHE_AGE:
            shutil.rmtree(folder, ignore_errors=True)


cache_sources(__package__, Path(__file__).parent)


@kernel(inline=True)
def assign(target, source):
    """Copy one array into another; kernels that own no memory cannot use ``target[:] = source``."""
    for k in range(len(source)):
        target[k] = source[k]
