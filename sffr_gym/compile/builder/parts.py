"""The parts of the library that are compiled one beside the other."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec

from sffr_gym.compile.builder.emission import emit
from sffr_gym.compile.builder.frontend import Frontend, register_kernels
from sffr_gym.compile.kernels import ENTRIES

# What has entries, of all packages that are installed; the layers above sffr_gym are named here alone.
MODULES = ("sffr_gym.envs.exemplars", "sffr_baselines.exemplars", "sffr_workbench.speed.kernels.exemplars")
SOURCES = (*MODULES, "sffr_gym.compile.lanes", "sffr_gym.compile.arguments", *(
    f"sffr_gym.compile.builder.{name}" for name in ("emission", "frontend", "lanes", "options", "parts", "views")
))  # fmt: skip

Symbols = dict[str, dict[str, str]]


def import_modules() -> None:
    """Import what has entries."""
    for name in MODULES:
        if find_spec(name.partition(".")[0]) is not None:
            import_module(name)


def parts() -> list[str]:
    """Return the labels of what is compiled together, one part beside the other."""
    import_modules()
    return sorted({label for entry in ENTRIES.values() for label, _ in entry.exemplars()})


def build_part(label: str, levels: Sequence[str]) -> tuple[Symbols, dict[str, bytes]]:
    """Return symbols and object files, by level, of a part."""
    import_modules()
    register_kernels()
    frontend = Frontend(label)
    for entry in ENTRIES.values():
        for own, arguments in entry.exemplars():
            if own == label:
                frontend.add(entry, arguments)
    bitcode = frontend.module().as_bitcode()
    return frontend.symbols, {level: emit(bitcode, level) for level in levels}
