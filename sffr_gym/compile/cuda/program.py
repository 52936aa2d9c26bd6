"""Programs of threads: built once for a robot's layout and a kind of device, kept in a folder, loaded and called.

A program is looked up by a hash of what its threads are given and of all sources of the packages; building one takes a
minute, in a process of its own. ``SFFR_CACHE`` is the folder, by default ``sffr-gym`` in the user's cache;
``SFFR_LIBDEVICE`` is CUDA's library of functions, where it is not found.
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib.util
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from filelock import FileLock

from sffr_gym.compile.cuda.described import Thread, arrays_of, stripped
from sffr_gym.compile.kernels import KERNELS
from sffr_gym.compile.library import HOST, INTERPRETED
from sffr_gym.config.errors import ConfigError

BLOCK = 64  # threads that share a multiprocessor's memory: few, since each takes many registers
EXTRA = "to compile for a GPU needs pip install 'sffr-gym[gpu]'"

Launch = Callable[[], None]  # one call of a thread's kernel in every environment


class Device(Protocol):
    """Where threads run.

    Attributes:
        xp: the module of its arrays.
        target: see :mod:`sffr_gym.compile.cuda.__main__`.
    """

    xp: Any
    target: str

    def launches(self, n: int, threads: Sequence[Thread]) -> dict[str, Launch]:
        """Return a call for each thread, by its name, for ``n`` environments."""
        ...


class Gpu:
    """A CUDA device, by CuPy.

    Raises:
        ConfigError: without CuPy, or without a device; the message says what to do.
    """

    def __init__(self) -> None:
        if importlib.util.find_spec("cupy") is None:
            raise ConfigError(f"backend 'cuda': no CuPy: {EXTRA}, on a machine with an NVIDIA GPU")
        import cupy

        try:
            found = cupy.cuda.runtime.getDeviceCount()
        except cupy.cuda.runtime.CUDARuntimeError as error:
            raise ConfigError(
                f"backend 'cuda': no NVIDIA GPU can be used here ({error}); leave out `backend` for the processor"
            ) from None
        if found == 0:
            raise ConfigError("backend 'cuda': this machine has no NVIDIA GPU; leave out `backend` for the processor")
        self.xp = cupy
        self.target = f"sm_{cupy.cuda.Device().compute_capability}"

    def launches(self, n: int, threads: Sequence[Thread]) -> dict[str, Launch]:
        """Return a call for each thread; see :class:`Device`."""
        module = self.xp.RawModule(path=str(build(threads, self.target)))
        return {thread.name: self._launch(module.get_function(thread.name), n, thread) for thread in threads}

    def _launch(self, function: Any, n: int, thread: Thread) -> Launch:
        arguments = (np.int64(n), *arrays_of(thread.arguments))
        return lambda: function((-(-n // BLOCK),), (BLOCK,), arguments)


class Processor:
    """This machine's processor, one thread after the other: the same code, to see that it is right without a GPU."""

    xp = np
    target = HOST

    def launches(self, n: int, threads: Sequence[Thread]) -> dict[str, Launch]:
        """Return a call for each thread; see :class:`Device`."""
        library = ctypes.CDLL(str(build(threads, self.target)))
        return {thread.name: self._launch(library[thread.name], n, thread) for thread in threads}

    def _launch(self, function: Any, n: int, thread: Thread) -> Launch:
        arrays = [ctypes.c_void_p(array.ctypes.data) for array in arrays_of(thread.arguments)]

        def launch() -> None:
            for i in range(n):
                function(ctypes.c_int64(n), ctypes.c_int64(i), *arrays)

        return launch


def build(threads: Sequence[Thread], target: str) -> Path:
    """Return the file of a program, built if there is none.

    Raises:
        ConfigError: without the compiler.
        subprocess.CalledProcessError: if it fails.
    """
    asked = [Thread(thread.name, thread.function, tuple(map(stripped, thread.arguments))) for thread in threads]
    request = pickle.dumps(asked)
    file = cache_folder() / f"{hashlib.sha256(request + _sources()).hexdigest()[:24]}-{target}.{_ending(target)}"
    file.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(file.with_suffix(".lock")):
        if not file.exists():
            _build(request, target, file)
    return file


def cache_folder() -> Path:
    """Return where programs are kept."""
    own = os.environ.get("SFFR_CACHE")
    return Path(own) if own else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "sffr-gym"


def find_libdevice() -> Path:
    """Return CUDA's library of functions.

    Raises:
        ConfigError: if it is not found.
    """
    if own := os.environ.get("SFFR_LIBDEVICE"):
        return Path(own)
    if importlib.util.find_spec("cuda") and importlib.util.find_spec("cuda.pathfinder"):
        from cuda.pathfinder import find_bitcode_lib

        return Path(find_bitcode_lib("device"))
    raise ConfigError(f"CUDA's libdevice.10.bc is not found: {EXTRA}, or name it in SFFR_LIBDEVICE")


def _build(request: bytes, target: str, file: Path) -> None:
    if importlib.util.find_spec("numba") is None:
        raise ConfigError(EXTRA)
    print(f"sffr-gym: compiling for {target} (a minute) ...", file=sys.stderr, flush=True)
    paths = os.pathsep.join(path for path in sys.path if path)
    with tempfile.TemporaryDirectory(dir=file.parent) as folder:
        (asked := Path(folder) / "request").write_bytes(request)
        made = Path(folder) / file.name
        command = [sys.executable, "-P", "-m", "sffr_gym.compile.cuda", str(asked), target, str(made)]
        subprocess.run(command, check=True, env=os.environ | {"PYTHONPATH": paths, INTERPRETED: "1"})
        os.replace(made, file)


def _ending(target: str) -> str:
    return "so" if target == HOST else "ptx"


def _sources() -> bytes:
    """Return a hash of all sources of the packages that have kernels."""
    total = hashlib.sha256()
    for name in sorted({function.__module__.partition(".")[0] for function in KERNELS}):
        spec = importlib.util.find_spec(name)
        for folder in (spec and spec.submodule_search_locations) or ():
            for file in sorted(Path(folder).rglob("*.py")):
                total.update(file.read_bytes())
    return total.digest()
