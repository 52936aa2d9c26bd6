"""The parts of the library: what is compiled together, and in which processes."""

from __future__ import annotations

import ast
import inspect
import itertools
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import Any

import numpy as np

from sffr_gym.compile.arguments import Structures
from sffr_gym.compile.builder.frontend import Frontend, register_kernels
from sffr_gym.compile.builder.views import TypeMaker
from sffr_gym.compile.kernels import ENTRIES, KERNELS

# What has entries, of all packages that are installed; the layers above sffr_gym are named here alone.
MODULES = ("sffr_gym.envs.exemplars", "sffr_baselines.exemplars", "sffr_workbench.speed.kernels.exemplars")
PACKAGES = {name.partition(".")[0] for name in MODULES}
COMPILING = (
    "sffr_gym.compile.arguments", "sffr_gym.compile.workspace", "sffr_gym.envs.lane_plants",
    *(f"sffr_gym.compile.builder.{name}" for name in ("emission", "frontend", "lanes", "options", "parts", "views")),
)  # fmt: skip

Symbols = dict[str, dict[str, str]]


def import_modules() -> None:
    """Import what has entries."""
    for name in MODULES:
        if find_spec(name.partition(".")[0]) is not None:
            import_module(name)


def groups() -> list[list[str]]:
    """Return the labels of the library's parts, those together that begin with the same word.

    These go through the front end in one process, where each finds the kernels that the ones before it brought: lanes
    of plants take half of the time after lanes.
    """
    import_modules()
    labels = sorted({label for entry in ENTRIES.values() for label, _ in entry.exemplars()})
    return [list(group) for _, group in itertools.groupby(labels, lambda label: label.split()[0])]


def sources() -> list[str]:
    """Return the modules that what is compiled depends on.

    Those of kernels, of the constants that these import, of the named tuples that they are given, whose fields have
    their places by their order, and of what compiles them.
    """
    found = {function.__module__ for function in KERNELS}
    for name in list(found):
        found |= _imported_constants(sys.modules[name])
    for entry in ENTRIES.values():
        for _, arguments in entry.exemplars():
            found |= _types(arguments)
    return sorted(found | {*MODULES, *COMPILING})


def _imported_constants(module: ModuleType) -> set[str]:
    """Return the modules of ours from which a module imports numbers, or tuples of them."""
    found = set()
    for node in ast.walk(ast.parse(inspect.getsource(module))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.partition(".")[0] in PACKAGES:
            values = [getattr(module, alias.asname or alias.name, None) for alias in node.names]
            if any(isinstance(value, int | float | tuple | np.generic) for value in values):
                found.add(node.module)
    return found


def _types(value: Any) -> set[str]:
    """Return the modules of the named tuples in a value."""
    if isinstance(value, Structures):
        return _types(value[0])
    if not isinstance(value, tuple):
        return set()
    own = {type(value).__module__} if hasattr(value, "_fields") else set()
    return own.union(*map(_types, value))


def represent(labels: Sequence[str]) -> tuple[dict[str, Symbols], dict[str, bytes]]:
    """Return symbols and bitcode of parts, by their labels; once in a process."""
    import_modules()
    register_kernels()
    symbols, bitcode, kinds = {}, {}, TypeMaker()
    for label in labels:
        frontend = Frontend(label, kinds)
        for entry in ENTRIES.values():
            for own, arguments in entry.exemplars():
                if own == label:
                    frontend.add(entry, arguments)
        symbols[label], bitcode[label] = frontend.symbols, frontend.module().as_bitcode()
    return symbols, bitcode
