"""The library of compiled code: finds the one for this machine, and builds it anew where sources changed.

It is built when the package is installed (see :mod:`sffr_gym.compile.builder`): for the machine at hand, or for several
levels of x86-64, of which the highest that the processor has is loaded. What it holds is said in a manifest beside it,
together with a hash of the sources. With ``SFFR_INTERPRETED=1`` kernels run as Python instead; ``SFFR_LIBRARY`` is the
folder of another library, ``SFFR_LEVEL`` the level to load.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import importlib.util
import os
import platform
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from filelock import FileLock

from sffr_gym.config.errors import ConfigError
from sffr_gym.config.reading import read_json

FOLDER = Path(os.environ.get("SFFR_LIBRARY") or Path(__file__).with_name("binaries"))
MANIFEST = "manifest.json"
HOST = "host"  # level of a machine that is no x86-64
LEVELS = {  # of x86-64, highest first: features as Linux names them
    "x86-64-v4": {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"},
    "x86-64-v3": {"avx2", "bmi1", "bmi2", "f16c", "fma", "movbe"},
    "x86-64-v2": set(),
}
INTERPRETED, LEVEL = "SFFR_INTERPRETED", "SFFR_LEVEL"  # environment variables


class Library:
    """A library that is loaded.

    Args:
        file: the shared object.
        functions: symbols by name and form of the arguments, see :mod:`sffr_gym.compile.arguments`.
    """

    def __init__(self, file: Path, functions: dict[str, dict[str, str]]) -> None:
        self.file, self._functions = file, functions
        self._shared = ctypes.CDLL(str(file))
        self._found: dict[tuple[str, str], Callable[[int], int]] = {}

    def function(self, name: str, form: str) -> Callable[[int], int]:
        """Return what takes the address of the words of arguments of a form, and returns 0.

        A library built with ``NUMBA_BOUNDSCHECK=1`` may return something else, for an index that is out of range.

        Raises:
            TypeError: if the entry is not compiled for that form.
        """
        if (name, form) not in self._found:
            symbol = next((own for known, own in self._functions[name].items() if _suits(form, known)), None)
            if symbol is None:
                known = ", ".join(self._functions[name])
                raise TypeError(f"{name} is not compiled for arguments of the form {form} (but for {known})")
            function = self._shared[symbol]
            function.argtypes, function.restype = [ctypes.c_void_p], ctypes.c_int
            self._found[name, form] = function
        return self._found[name, form]


def _suits(form: str, known: str) -> bool:
    """Say whether arguments of a form can be given to what is compiled for another: arrays in place of strided ones."""
    return len(form) == len(known) and all(a in (b, b.lower()) for a, b in zip(form, known, strict=True))


@functools.cache
def load_library() -> Library | None:
    """Return the library for this machine; None where kernels run as Python, with a warning if nobody asked for that.

    Builds it first, with a line on stderr, if it is missing or its sources have changed, as they do in a checkout.
    """
    if is_interpreted():
        return None
    try:
        manifest = _built_manifest()
        level = _level_to_load(manifest["files"])
        return Library(FOLDER / manifest["files"][level], manifest["functions"])
    except (ConfigError, OSError, KeyError, LookupError, subprocess.SubprocessError) as error:
        warnings.warn(
            f"no compiled code for this machine ({error}); kernels run as Python, some thousand times slower",
            stacklevel=2,
        )
        return None


def is_interpreted() -> bool:
    """Say whether ``SFFR_INTERPRETED`` asks for kernels that run as Python."""
    return os.environ.get(INTERPRETED, "0") != "0"


def _built_manifest() -> dict[str, Any]:
    """Return the manifest of a library of the present sources, built if there is none."""
    manifest = current_manifest(FOLDER)
    if manifest is not None:
        return manifest
    FOLDER.mkdir(exist_ok=True)
    with FileLock(FOLDER / ".lock"):
        manifest = current_manifest(FOLDER)  # another process may have built it
        if manifest is None:
            build_library("sffr-gym: compiling the kernels for this machine, since sources have changed (a minute) ...")
            manifest = read_json(FOLDER / MANIFEST)
    return dict(manifest)


def build_library(message: str, *arguments: str) -> None:
    """Build the library in a process of its own; see :mod:`sffr_gym.compile.builder`.

    Raises:
        LookupError: without the compiler.
        subprocess.CalledProcessError: if it fails.
    """
    if importlib.util.find_spec("numba") is None:
        raise LookupError("to compile them needs pip install 'sffr-gym[compile]'")
    print(message, file=sys.stderr, flush=True)
    paths = os.pathsep.join(path for path in sys.path if path)
    # -P: a json.py of the working directory is not the builder's
    command = [sys.executable, "-P", "-m", "sffr_gym.compile.builder", str(FOLDER), *arguments]
    subprocess.run(command, check=True, env=os.environ | {"PYTHONPATH": paths, INTERPRETED: "1"})


def current_manifest(folder: Path) -> dict[str, Any] | None:
    """Return the manifest in a folder if it is a whole one of the present sources, whose files are there."""
    try:
        manifest: dict[str, Any] = read_json(folder / MANIFEST)
        current = manifest["sources"] == hash_of(manifest["modules"])
        return manifest if current and all((folder / file).is_file() for file in manifest["files"].values()) else None
    except (ConfigError, KeyError, TypeError, AttributeError):  # none, or a damaged one
        return None


def hash_of(modules: Iterable[str]) -> str:
    """Return the hash of the sources of some modules."""
    total = hashlib.sha256()
    for name in modules:
        try:
            spec = importlib.util.find_spec(name)
        except ModuleNotFoundError:  # of its package
            spec = None
        if spec is None or spec.origin is None:
            return ""
        total.update(name.encode() + hashlib.sha256(Path(spec.origin).read_bytes()).digest())
    return total.hexdigest()


def _level_to_load(files: dict[str, str]) -> str:
    """Return the level to load: what ``SFFR_LEVEL`` says, or the highest that this processor has.

    Raises:
        LookupError: if the library has none for it.
    """
    own, asked = own_levels(), os.environ.get(LEVEL)
    level = asked or next((level for level in own if level in files), None)
    if level not in files or level not in own:
        raise LookupError(f"the library is for {', '.join(files)}, this machine a {platform.machine()} of {own[0]}")
    return level


def own_levels() -> list[str]:
    """Return the levels of this machine, the highest first."""
    if platform.machine() not in ("x86_64", "AMD64"):
        return [HOST]
    features = processor_features()
    return [level for level in LEVELS if _has(level, features)]


def _has(level: str, features: set[str]) -> bool:
    """Say whether a processor has all features up to a level."""
    names = list(LEVELS)
    return all(LEVELS[below] <= features for below in names[names.index(level) :])


def processor_features(file: Path = Path("/proc/cpuinfo")) -> set[str]:
    """Return the processor's features as Linux tells them; none elsewhere."""
    try:
        lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return set()
    return set(next((line.partition(":")[2] for line in lines if line.startswith("flags")), "").split())
