"""From the representation of threads to PTX, or to an object file for this machine's processor.

Everything is pasted into the kernels, so that shapes and whole numbers are constants throughout: loops then unroll, and
a thread's arrays come apart into registers. Loops whose bodies are large, such as the stages of a step, stay loops.
Multiplications and additions are contracted, which the processor's code is not: a GPU does both at the price of one.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm

from sffr_gym.compile.builder.emission import SPEED, emit
from sffr_gym.compile.library import HOST

TRIPLE = "nvptx64-nvidia-cuda"
DECLARED = re.compile(r"^declare [^@]*double @((?:llvm\.)?(\w+?)(?:\.f64)?)\(double", re.MULTILINE)
INSTRUCTIONS = {"fabs", "floor", "ceil", "trunc", "sqrt", "minnum", "maxnum", "fma", "fmuladd", "copysign"}
OPTIONS = ("--unroll-threshold=2500", "--nvptx-fma-level=2")  # instructions of an unrolled loop; contract
PASSES = 2  # times that a module is optimised: arrays that the first comes apart free loops for the second


def to_object(module: Any) -> bytes:
    """Return the object file of a module for this machine."""
    return emit(module.as_bitcode(), HOST)


def to_ptx(module: Any, entries: set[str], capability: str, libdevice: Path) -> str:
    """Return the PTX of a module.

    Args:
        module: of :class:`thread.ThreadFrontend`.
        entries: the names of its threads.
        capability: of the device, such as ``sm_90``.
        libdevice: CUDA's library of functions, ``libdevice.10.bc``.
    """
    for option in OPTIONS:
        llvm.set_option("sffr", option)
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(TRIPLE).create_target_machine(cpu=capability, opt=SPEED)
    whole = llvm.parse_assembly(_retargeted(str(module), str(machine.target_data)))
    functions = llvm.parse_bitcode(libdevice.read_bytes())
    functions.triple, functions.data_layout = whole.triple, whole.data_layout
    whole.link_in(functions)
    for function in whole.functions:
        if not function.is_declaration and function.name not in entries:
            function.linkage = "internal"
            function.add_function_attribute("alwaysinline")
    for _ in range(PASSES):
        builder = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=SPEED))
        builder.getModulePassManager().run(whole, builder)
    return str(machine.emit_assembly(whole))


def _retargeted(text: str, layout: str) -> str:
    """Return the text of a module for a GPU, with libdevice's functions for those of the processor's library."""
    for name, plain in set(DECLARED.findall(text)):
        text = text.replace(f"@{name}(", f"@llvm.{plain}.f64(" if plain in INSTRUCTIONS else f"@__nv_{plain}(")
    text = re.sub(r"^target (datalayout|triple) = .*$", "", text, flags=re.MULTILINE)
    text = re.sub(r'"(target-cpu|target-features|probe-stack|frame-pointer)"(="[^"]*")?', "", text)
    text = re.sub(r"\bnoinline\b", "nounwind", text)  # a group of attributes must not be empty
    return f'target triple = "{TRIPLE}"\ntarget datalayout = "{layout}"\n{text}'
