"""From kernels to the representation of threads, by the processor's way; see ``builder.frontend``."""

from __future__ import annotations

from typing import Any

import numba
from numba.extending import register_jitable

from sffr_gym.compile.builder.frontend import ADDRESS, Frontend
from sffr_gym.compile.builder.options import OPTIONS
from sffr_gym.compile.cuda.described import Thread
from sffr_gym.compile.cuda.views import POINTERS, Describer, unpacker
from sffr_gym.compile.kernels import Entry

REGISTERS = {
    "t": "tid",
    "d": "ntid",
    "b": "ctaid",
}  # special ones: of a thread in its block, the block's size, the block
INDEX = ["  %s = mul i32 %b, %d", "  %j = add i32 %s, %t", "  %i = zext i32 %j to i64"]


class ThreadFrontend(Frontend):
    """Collects the representation of threads.

    Args:
        on_device: a GPU's kernels, of which a thread finds its environment; else functions that are told it.
    """

    def __init__(self, on_device: bool) -> None:
        super().__init__("thread")
        self._on_device = on_device

    def add_thread(self, thread: Thread) -> None:
        """Compile a thread up to the representation; its symbol is its name."""
        describer = Describer()
        sources = [describer.describe(each) for each in thread.arguments]
        unpack = unpacker(sources)
        function = thread.function.function if isinstance(thread.function, Entry) else thread.function
        kernel = register_jitable(**OPTIONS)(function)

        def read_and_call(frame):
            kernel(*unpack(frame))

        dispatcher = numba.njit(**OPTIONS)(read_and_call)
        dispatcher.compile((ADDRESS,))
        result = dispatcher.overloads[(ADDRESS,)]
        self._collect(result.library)
        self.symbols[thread.name] = {"": thread.name}
        self._wrappers.append(self._wrapper(thread.name, result.fndesc.llvm_func_name, describer))

    def _wrapper(self, symbol: str, name: str, describer: Describer) -> str:
        """What is called: it makes the frame of a thread, if that has an environment."""
        arrays = [f"%a{k}" for k in range(len(describer.arrays))]
        memory = [f"%m{k}" for k in range(len(describer.memory))]
        own = [] if self._on_device else ["i64 %i"]
        taken = ", ".join(["i64 %n", *own, *(f"ptr noalias {array}" for array in arrays)])
        lines = [
            f'declare i32 @"{name}"(ptr, ptr, ptr)',
            f"define {'ptx_kernel ' if self._on_device else ''}void @{symbol}({taken}) {{", "start:",
            *(self._index() if self._on_device else []), "  %inside = icmp slt i64 %i, %n",
            f"  %frame = alloca [{POINTERS + len(arrays) + len(memory)} x i64]",
            "  %result = alloca ptr", "  %exception = alloca ptr",
            *(f"  {own} = alloca [{max(n, 1)} x double]" for own, n in zip(memory, describer.memory, strict=True)),
            "  br i1 %inside, label %go, label %end", "go:", "  store i64 %n, ptr %frame",
            "  %place = getelementptr i64, ptr %frame, i64 1", "  store i64 %i, ptr %place",
        ]  # fmt: skip
        for k, value in enumerate([*arrays, *memory]):
            lines += [
                f"  %w{k} = ptrtoint ptr {value} to i64",
                f"  %p{k} = getelementptr i64, ptr %frame, i64 {POINTERS + k}", f"  store i64 %w{k}, ptr %p{k}",
            ]  # fmt: skip
        call = f'  %status = call i32 @"{name}"(ptr %result, ptr %exception, ptr %frame)'
        return "\n".join([*lines, call, "  br label %end", "end:", "  ret void", "}", ""])

    @staticmethod
    def _index() -> list[str]:
        """Instructions that find the thread's environment."""
        found = [f"  %{own} = call i32 @llvm.nvvm.read.ptx.sreg.{name}.x()" for own, name in REGISTERS.items()]
        return [*found, *INDEX]

    def module(self) -> Any:
        """Return all of it as one module of LLVM, see the base class."""
        if self._on_device:
            self._wrappers[:0] = [f"declare i32 @llvm.nvvm.read.ptx.sreg.{each}.x()\n" for each in REGISTERS.values()]
        return super().module()
