"""Print what the package needs, its building and some extras included: ``python .ci/needs.py [EXTRA ...]``.

Installed ahead of the package, while its kernels are compiled. Needs nothing but Python.
"""

import re
import shutil
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
COMPILERS = ("cc", "gcc", "clang")  # of C, one of which links


def requirements(extras: list[str]) -> list[str]:
    """Return the requirements of ``pyproject.toml``, those of extras that others are made of too."""
    read = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    own, linker = read["project"], [] if any(map(shutil.which, COMPILERS)) else ["ziglang"]
    found, waiting = [*read["build-system"]["requires"], *own["dependencies"], *linker], ["compile", *extras]
    for extra in waiting:  # which grows
        for requirement in own["optional-dependencies"][extra]:
            if nested := re.fullmatch(rf"{own['name']}\[(.*)\]", requirement):
                waiting += [name for name in nested[1].split(",") if name not in waiting]
            else:
                found.append(requirement)
    return list(dict.fromkeys(found))


if __name__ == "__main__":
    print(*requirements(sys.argv[1:]), sep="\n")
