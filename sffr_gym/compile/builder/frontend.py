"""From kernels to the compiler's intermediate representation: numba's types and lowering, and nothing after that.

Numba compiles each function for itself: optimises it with all that it calls, and emits machine code. Here that is left
out, which took three quarters of the time. The representations of all functions are collected instead, put together
once, and optimised together by :mod:`sffr_gym.compile.builder.emission`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import llvmlite.binding as llvm
import numba
from numba.core import codegen, types
from numba.core.registry import cpu_target
from numba.extending import register_jitable

from sffr_gym.compile.arguments import Block
from sffr_gym.compile.builder.options import OPTIONS
from sffr_gym.compile.builder.views import TypeMaker, unpacker
from sffr_gym.compile.kernels import KERNELS, Entry

ADDRESS: Any = types.CPointer(types.int64)  # type: ignore[attr-defined]


class _Library(codegen.JITCodeLibrary):
    """The code of one function, neither optimised nor emitted."""

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0

    @property
    def module(self) -> Any:
        return self._final_module

    @property
    def called(self) -> list[Any]:
        return list(self._linking_libraries)


class _Codegen(codegen.JITCPUCodegen):
    _library_class = _Library

    def set_env(self, env_name: str, env: Any) -> None:
        """Nothing is run that would need it."""


def register_kernels() -> None:
    """Let numba compile kernels where other kernels call them."""
    cpu_target.target_context._internal_codegen = _Codegen("sffr")
    for function, inline in KERNELS.items():
        register_jitable(**OPTIONS | {"forceinline": inline})(function)


class Frontend:
    """Collects the representation of entries.

    Args:
        label: a part of their symbols.
        kinds: makes the types of their arguments; with the same one, kernels of another front end are found again.

    Attributes:
        symbols: of the entries, by name and form of the arguments.
    """

    def __init__(self, label: str, kinds: TypeMaker | None = None) -> None:
        self._label = label.replace(" ", "_")
        self.symbols: dict[str, dict[str, str]] = {}
        self._types, self._libraries = kinds or TypeMaker(), dict[Any, None]()
        self._wrappers: list[str] = []

    def add(self, entry: Entry, arguments: tuple[Any, ...]) -> None:
        """Compile an entry for arguments of a form, up to the representation."""
        own = self.symbols.setdefault(entry.name, {})
        symbol = f"{entry.name.replace('.', '_')}_{self._label}_{len(own)}"
        own[Block(arguments).form] = symbol
        library, name = _compiled(entry.function, [self._types.type_of(each) for each in arguments])
        self._collect(library)
        self._wrappers.append(
            f'declare i32 @"{name}"(ptr, ptr, ptr)\n'
            f"define i32 @{symbol}(ptr %words) {{\n  %result = alloca ptr\n  %exception = alloca ptr\n"
            f'  %status = call i32 @"{name}"(ptr %result, ptr %exception, ptr %words)\n  ret i32 %status\n}}\n'
        )

    def module(self) -> Any:
        """Return all of it as one module of LLVM, in which only the entries are visible from outside."""
        module = llvm.parse_assembly("".join(self._wrappers))
        module.triple = llvm.get_process_triple()
        module.data_layout = cpu_target.target_context._internal_codegen._data_layout
        entries = {symbol for forms in self.symbols.values() for symbol in forms.values()}
        for library in reversed(list(self._libraries)):
            own = library.module.clone()
            for function in own.functions:
                if not function.is_declaration and function.linkage == llvm.Linkage.external:
                    function.linkage = "linkonce_odr"
            module.link_in(own)
        outlined = [_mangled(function) for function, inline in KERNELS.items() if not inline]
        for function in module.functions:
            if not function.is_declaration and function.name not in entries:
                function.linkage = "internal"
                if any(name in function.name for name in outlined):
                    function.add_function_attribute("noinline")
        for variable in module.global_variables:  # numba's environments, which nothing reads
            if variable.name.startswith("_ZN08NumbaEnv"):
                variable.linkage = "internal"
        module.verify()
        return module

    def _collect(self, library: Any) -> None:
        """Take a library and all that it calls."""
        if library not in self._libraries:
            for called in library.called:
                self._collect(called)
            self._libraries[library] = None


def _compiled(function: Callable[..., Any], kinds: Iterable[tuple[Any, int]]) -> tuple[Any, str]:
    """Return library and name of a function that reads its arguments from words."""
    unpack = unpacker(list(kinds))
    kernel = register_jitable(**OPTIONS)(function)

    def read_and_call(words):
        kernel(*unpack(words))

    dispatcher = numba.njit(**OPTIONS | {"forceinline": False})(read_and_call)
    dispatcher.compile((ADDRESS,))
    result = dispatcher.overloads[(ADDRESS,)]
    return result.library, result.fndesc.llvm_func_name


def _mangled(function: Callable[..., Any]) -> str:
    """Part of the name that numba gives a function."""
    parts = [*function.__module__.split("."), function.__name__]
    return "".join(f"{len(part)}{part}" for part in parts) + "B"
