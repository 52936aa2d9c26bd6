"""What kernels are compiled to, kept on disk: which sources it belongs to, and how it is written and read.

numba's own cache does not notice an edit in a kernel that another file defines, so compiled code lies in a folder that
is named by a hash of every source file that its kernels can see: an edit there compiles again, an unchanged tree starts
in seconds. The layers of ``sffr_gym`` import one way, so that a layer's kernels can see it and those before it.

Each signature of a kernel is a file of its own, so that processes that compile at the same time share no index.
"""

from __future__ import annotations

import hashlib
import pickle
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from llvmlite.binding import get_host_cpu_name
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from sffr_gym.compile import folders

LAYERS = ("types", "config", "compile", "physics", "task", "render", "envs")  # of sffr_gym, as import-linter checks
SETTINGS = ("BOUNDSCHECK", "OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "DEBUGINFO_DEFAULT")  # numba's that change code
COMPILERS = (numba.__version__, llvmlite.__version__, np.__version__, sys.implementation.cache_tag)

_sources: list[bytes] = []
_folders: dict[str, Path | None] = {}  # of each package with kernels; None: nothing is kept


def cache_sources(package: str, files: Iterable[Path]) -> Path | None:
    """Name the cache folder of a package's kernels by a hash of its sources and of those hashed before.

    A package whose kernels call those of another one calls this after importing it and before it defines any.

    Args:
        package: its full name, such as ``sffr_baselines``; packages below it share the folder.
        files: its sources.

    Returns:
        The folder; None if there is no place where compiled code could be kept.
    """
    _sources.extend(file.read_bytes() for file in sorted(files))
    settings = [(name, getattr(numba.config, name)) for name in SETTINGS]
    machine = numba.config.CPU_NAME or get_host_cpu_name()
    compiler = repr((COMPILERS, machine, settings)).encode()
    digest = hashlib.sha256(b"\0".join([compiler, *_sources])).hexdigest()[:16]
    _folders[package] = folders.open_folder(digest)
    return _folders[package]


def folder_of(module: str) -> Path | None:
    """Return the cache folder of the innermost registered package that holds a module."""
    while module not in _folders and module:
        module = module.rpartition(".")[0]
    return _folders.get(module)


def is_compiled() -> bool:
    """Say whether compiled kernels of these very sources lie in the cache (else it takes one to two minutes)."""
    last = {package.partition(".")[0]: folder for package, folder in _folders.items()}  # of each top-level package
    return all(folder is not None and folders.holds_code(folder) for folder in last.values())


def remove_stale_caches() -> None:
    """Remove the cache folders of sources that have not run for a while."""
    folders.remove_stale({folder for folder in _folders.values() if folder is not None})


class KernelCache(NullCache):
    """What one kernel is compiled to, in a file for each signature; whatever is wrong with a file, it compiles again.

    Takes the place of numba's own cache in a dispatcher.

    Args:
        function: the kernel's, without a closure.
        folder: of :func:`cache_sources`.
    """

    cleaned = False  # whether this process has removed old folders

    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        self._folder = folder
        self._name = function.__name__.strip("<>")
        code = function.__code__
        self._function = (function.__module__, function.__qualname__, code.co_firstlineno, code.co_code)

    @property
    def cache_path(self) -> str:
        """The folder."""
        return str(self._folder)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what was compiled for a signature; None if that is not there, damaged, or others can have written."""
        target_context.refresh()
        try:
            key = self._key(sig, target_context.codegen())
            content = folders.read_sealed(self._file(key))
            found, parts = pickle.loads(content) if content is not None else (None, ())
            return CompileResult._rebuild(target_context, *parts) if found == key else None
        except Exception:  # pickle and LLVM raise whatever they like; what is missing is compiled, and written again
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled for a signature, if that is possible; the first time, remove what nobody uses."""
        if data.lifted or data.library.has_dynamic_globals:  # as numba: it refers to this process
            return
        key = self._key(sig, data.codegen)
        try:
            folders.write_sealed(self._file(key), dumps((key, data._reduce())))
        except OSError as error:
            folders.tell(self._folder, error, folders.NOT_KEPT)
        if not KernelCache.cleaned:
            KernelCache.cleaned = True
            remove_stale_caches()

    def _key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        """What code depends on that the folder does not say."""
        return sig, codegen.magic_tuple(), self._function

    def _file(self, key: tuple[Any, ...]) -> Path:
        digest = hashlib.sha256(repr(key).encode()).hexdigest()[:16]
        return self._folder / f"{self._name}.{digest}{folders.CODE}"


def _cache_layers(root: Path) -> None:
    """Name the cache folders of the layers of ``sffr_gym``."""
    for layer in LAYERS:
        files = [root / f"{layer}.py"] if (root / f"{layer}.py").is_file() else (root / layer).rglob("*.py")
        cache_sources(f"sffr_gym.{layer}", files)


_cache_layers(Path(__file__).parents[1])
