"""Compiles the kernels when a wheel is built or a checkout is installed; see ``sffr_gym/compile/builder``.

Also makes the text that a package index shows of the README. Run as a program it compiles them ahead, while pip fetches
what else is installed.
"""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

FOLDER = Path("sffr_gym", "compile", "binaries")
COMPILERS = ("cc", "gcc", "clang")  # of C, one of which links


class CompiledKernels(BuildHookInterface[Any]):
    """Builds the library of compiled code: for the levels in ``SFFR_LEVELS``, or for that of this machine."""

    def dependencies(self) -> list[str]:
        """Return what building needs: what the package needs itself, and the compiler."""
        core = self.metadata.core
        linker = [] if any(map(shutil.which, COMPILERS)) else ["ziglang"]
        return [*core.dependencies, *core.optional_dependencies["compile"], *linker]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the library, and tag the wheel with the platform that it is for."""
        compile_kernels(Path(self.root))
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{sysconfig.get_platform().replace('-', '_').replace('.', '_')}"


def compile_kernels(root: Path) -> None:
    """Build the library of a checkout, unless it is there and of the present sources."""
    places = [str(root / place) for place in (".", "baselines", "workbench")]
    paths = os.pathsep.join([*places, os.environ.get("PYTHONPATH", "")])
    levels = os.environ.get("SFFR_LEVELS", "").split()
    command = [sys.executable, "-m", "sffr_gym.compile.builder", str(root / FOLDER), *levels]
    subprocess.run(command, check=True, cwd=root, env=os.environ | {"PYTHONPATH": paths, "SFFR_INTERPRETED": "1"})


class IndexReadme(MetadataHookInterface):
    """Gives the project's description, of which the README is the source."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Put it into the metadata."""
        text = Path(self.root, "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {"content-type": "text/markdown", "text": index_text(text)}


def index_text(readme: str) -> str:
    """Return a README without pictures and links of files beside it, which an index does not have.

    A paragraph in italics below a picture is its caption, and goes with it.
    """
    without_pictures = re.sub(r"!\[[^\]]*\]\((?!https?:)[^)]*\)\n+(\*[^*].*?\n\n)?", "", readme, flags=re.DOTALL)
    return re.sub(r"\[([^\]]*)\]\((?!https?:|#)[^)]*\)", r"\1", without_pictures)


if __name__ == "__main__":
    compile_kernels(Path(__file__).parent.resolve())
