"""The one ``kernel`` decorator: every numba setting of the project, and where compiled code is cached.

numba's own cache does not notice an edit in a kernel that another file defines, so compiled code lies in a folder that
is named by a hash of every source file that its kernels can see: an edit there compiles again, an unchanged tree starts
in seconds. The layers of ``sffr_gym`` import one way, so that a layer's kernels can see it and those before it.
"""

from __future__ import annotations

import functools
import hashlib
import os
import shutil
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numba
from numba.extending import register_jitable

LAYERS = ("types", "config", "compile", "physics", "task", "render", "envs")  # of sffr_gym, as import-linter checks
SETTINGS = ("BOUNDSCHECK", "OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "DEBUGINFO_DEFAULT")  # numba's that change code
MAX_CACHE_AGE = 30 * 24 * 3600.0  # s, compiled code of older sources is removed after this

_CHOSEN = os.environ.get("NUMBA_CACHE_DIR")  # by the user
CACHE_ROOT = (Path(_CHOSEN) if _CHOSEN else Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))) / "sffr-gym"

_sources: list[bytes] = []
_folders: dict[str, Path] = {}  # of each package with kernels


def cache_sources(package: str, files: Iterable[Path]) -> Path:
    """Name the cache folder of a package's kernels by a hash of its sources and of those hashed before.

    A package whose kernels call those of another one calls this after importing it and before it defines any.

    Args:
        package: its full name, such as ``sffr_baselines``; packages below it share the folder.
        files: its sources.

    Returns:
        The folder.
    """
    _sources.extend(file.read_bytes() for file in sorted(files))
    settings = repr([(name, getattr(numba.config, name)) for name in SETTINGS]).encode()
    digest = hashlib.sha256(b"\0".join([settings, *_sources])).hexdigest()[:16]
    folder = _folders[package] = CACHE_ROOT / digest
    if folder.is_dir():
        os.utime(folder)  # in use; see remove_stale_caches
    return folder


def kernel(function: Callable[..., Any] | None = None, *, inline: bool = False, nogil: bool = False) -> Any:
    """Compile a function of plain arrays and scalars, cached on disk.

    Strict IEEE arithmetic: no ``fastmath``, so that ``isfinite`` sees NaN and a kernel gives the same bits wherever it
    is inlined. Division by zero gives inf, as in NumPy. Kernels never raise.

    Kernels own no memory (see :mod:`sffr_gym.compile.workspace`), so numba's reference counting is off, which takes
    longer than their arithmetic: they neither make arrays nor return such that Python could see.

    Args:
        function: the function, when used as a plain decorator.
        inline: paste it into its callers; for the inner ones, whose calls would cost more than their arithmetic.
        nogil: release the interpreter's lock, for threads.
    """
    if function is None:
        return functools.partial(kernel, inline=inline, nogil=nogil)
    folder = _folder_of(function.__module__)
    others = numba.config.CACHE_DIR  # numba reads it while it decorates; a user's own kernels keep theirs
    if folder is not None:
        numba.config.CACHE_DIR = str(folder)
    try:
        return numba.njit(cache=True, error_model="numpy", forceinline=inline, _nrt=False, nogil=nogil)(function)
    finally:
        numba.config.CACHE_DIR = others


def inline(function: Callable[..., Any]) -> Callable[..., Any]:
    """Paste a function into the kernels that call it; Python calls it as it is written.

    For functions that return descriptions or arrays: a compiled kernel must not hand arrays to Python, see above.
    """
    pasted: Callable[..., Any] = register_jitable(forceinline=True, _nrt=False)(function)
    return pasted


def is_compiled() -> bool:
    """Say whether compiled kernels of these very sources lie in the cache (else it takes one to two minutes)."""
    last = {package.partition(".")[0]: folder for package, folder in _folders.items()}  # of each top-level package
    return all(folder.is_dir() and any(folder.rglob("*.nbi")) for folder in last.values())


def remove_stale_caches() -> None:
    """Remove the cache folders of sources that have not run for a while."""
    for folder in CACHE_ROOT.iterdir() if CACHE_ROOT.is_dir() else ():
        if folder not in _folders.values() and time.time() - folder.stat().st_mtime > MAX_CACHE_AGE:
            shutil.rmtree(folder, ignore_errors=True)


def _folder_of(module: str) -> Path | None:
    """The cache folder of the innermost registered package that holds a module."""
    while module not in _folders and module:
        module = module.rpartition(".")[0]
    return _folders.get(module)


def _cache_layers(root: Path) -> None:
    """Name the cache folders of the layers of ``sffr_gym``."""
    for layer in LAYERS:
        files = [root / f"{layer}.py"] if (root / f"{layer}.py").is_file() else (root / layer).rglob("*.py")
        cache_sources(f"sffr_gym.{layer}", files)


_cache_layers(Path(__file__).parents[1])
