"""Build the library of compiled code: ``python -m sffr_gym.compile.builder FOLDER [LEVEL ...]``.

LEVEL is a level of x86-64 such as ``x86-64-v3``, by default the highest of this machine, or ``host`` on another one.
FOLDER gets a shared object for each and the manifest of :mod:`sffr_gym.compile.library`, put into place last. Nothing
is done if they are there and of the present sources.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from itertools import chain
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from sffr_gym.compile.builder.emission import emit, link
from sffr_gym.compile.builder.parts import Symbols, groups, represent, sources
from sffr_gym.compile.library import HOST, LEVELS, MANIFEST, current_manifest, hash_of, own_levels
from sffr_gym.compile.threads import available_cores
from sffr_gym.config.files import to_json


def build(folder: Path, levels: Sequence[str]) -> None:
    """Build the library into a folder."""
    functions, objects = compiled(groups(), levels)
    modules = sources()
    manifest: dict[str, Any] = {"sources": hash_of(modules), "modules": modules, "functions": functions, "files": {}}
    with tempfile.TemporaryDirectory(dir=folder) as place:
        for level in levels:
            name = f"kernels-{level}.so"
            link(objects[level], Path(place) / name)
            os.replace(Path(place) / name, folder / name)
            manifest["files"][level] = name
        (Path(place) / MANIFEST).write_text(to_json(manifest))
        os.replace(Path(place) / MANIFEST, folder / MANIFEST)
    for file in folder.glob("kernels-*.so"):  # of earlier builds
        if file.name not in manifest["files"].values():
            file.unlink()


def compiled(labels: Sequence[Sequence[str]], levels: Sequence[str]) -> tuple[Symbols, dict[str, list[bytes]]]:
    """Return the entries' symbols and, by level, object files; all processors work."""
    functions, emitted = defaultdict[str, dict[str, str]](dict), dict[tuple[str, str], Future[bytes]]()
    with ProcessPoolExecutor(available_cores(), mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        for done in as_completed([pool.submit(represent, group) for group in labels]):
            symbols, bitcode = done.result()
            for part in symbols.values():
                for name, forms in part.items():
                    functions[name] |= forms
            emitted |= {(a, label): pool.submit(emit, bitcode[label], a) for label in bitcode for a in levels}
        return functions, {a: [emitted[a, label].result() for label in chain(*labels)] for a in levels}


def main(arguments: Sequence[str] | None = None) -> int:
    """Build what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("levels", nargs="*", metavar="LEVEL", help=f"{HOST}, {', '.join(LEVELS)}")
    asked = parser.parse_args(arguments)
    levels = asked.levels or own_levels()[:1]
    asked.folder.mkdir(parents=True, exist_ok=True)
    manifest = current_manifest(asked.folder)
    if manifest is None or not manifest["files"].keys() >= {*levels}:
        build(asked.folder, levels)
    return 0


if __name__ == "__main__":
    sys.exit(main())
