"""From the compiler's intermediate representation to a shared object: LLVM's optimisation and code for a processor."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import llvmlite.binding as llvm

from sffr_gym.compile.library import HOST

SPEED = 3  # LLVM's level of optimisation
COMPILERS = ("cc", "gcc", "clang")


def emit(bitcode: bytes, level: str) -> bytes:
    """Return the object file of a module for a level: one of x86-64, or ``host``, another machine's own."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    own = {"cpu": level, "features": "-prefer-256-bit"}  # a register for all lanes
    if level == HOST:
        own = {"cpu": llvm.get_host_cpu_name(), "features": llvm.get_host_cpu_features().flatten()}
    target = llvm.Target.from_triple(llvm.get_process_triple())
    machine = target.create_target_machine(opt=SPEED, reloc="pic", **own)
    module = llvm.parse_bitcode(bitcode)
    tuning = llvm.create_pipeline_tuning_options(speed_level=SPEED)
    tuning.loop_unrolling = False  # loops over links, panels and modes are short: it costs a tenth of the loop's speed
    builder = llvm.create_pass_builder(machine, tuning)
    builder.getModulePassManager().run(module, builder)
    return machine.emit_object(module)


def link(objects: list[bytes], file: Path) -> None:
    """Link object files into a shared object.

    Raises:
        FileNotFoundError: if there is no linker.
        subprocess.CalledProcessError: if it fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        names = []
        for k, content in enumerate(objects):
            (name := Path(folder) / f"{k}.o").write_bytes(content)
            names.append(str(name))
        subprocess.run([*linker(), "-shared", "-o", str(file), *names, "-lm"], check=True)


def linker() -> list[str]:
    """Return the command that links: a C compiler, or the one that the package ``ziglang`` brings."""
    if found := next(filter(None, map(shutil.which, COMPILERS)), None):
        return [found]
    try:
        import ziglang  # noqa: F401
    except ModuleNotFoundError:
        raise FileNotFoundError(f"no C compiler to link with ({', '.join(COMPILERS)}): install one") from None
    return [sys.executable, "-m", "ziglang", "cc"]
