"""Change single operators, numbers and conditions in a copy of the sources, and see whether the tests notice.

The operators are cosmic-ray's; ``mutants.toml`` names those in use, the modules with their tests, and the mutants that
are accepted with a reason. Every outcome is written at once to a folder, from which an interrupted run goes on; a
module whose source has changed begins again. Modules of ``sffr_gym`` and ``sffr_baselines``, whose edits would compile
the kernels again, run as Python; for all others these two packages come from the checkout, compiled.

    python tests/mutants.py [--sample N] [--draw K] [--again] [--known] [--report FILE] [MODULE ...]

Exit code 1 if a mutant survives without a reason.
"""

from __future__ import annotations

import argparse
import ast
import functools
import hashlib
import json
import os
import random
import resource
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from queue import Queue
from typing import Any, NamedTuple

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator
from mutants_report import Tested, report

from sffr_gym.config.files import to_json, write_whole

ROOT = Path(__file__).parents[1]
CONFIG = tomllib.loads((ROOT / "tests" / "mutants.toml").read_text(encoding="utf-8"))
MODULES: dict[str, list[str]] = CONFIG["modules"]
OUT = ROOT / "runs" / "mutants"
COPIED = ("sffr_gym", "baselines", "agents", "workbench", "configs", "docs", "tests", "pyproject.toml", "Makefile")
INTERPRETED = ("sffr_gym/", "baselines/")
KILLED, TIMEOUT, SURVIVED = "killed", "timeout", "survived"


class Mutant(NamedTuple):
    """One change of a module.

    Attributes:
        module: path from the root; function: innermost one around it, with its class; empty at a module's top.
        operator: cosmic-ray's name; occurrence: which of its places in the module.
        line: number; text: that line as it is.
    """

    module: str
    function: str
    operator: str
    occurrence: int
    line: int
    text: str

    @property
    def key(self) -> str:
        """Name of its outcome."""
        return f"{self.operator} {self.occurrence}"

    @property
    def reason(self) -> str:
        """Why it is accepted that no test notices it; empty if it is not."""
        return next((str(entry["reason"]) for entry in CONFIG.get("accepted", ()) if matches(entry, self)), "")

    @property
    def changed(self) -> str:
        """What the change puts in the place of its line."""
        before = (ROOT / self.module).read_text(encoding="utf-8").splitlines()
        after = self.source().splitlines()
        return " ".join(" ".join(new.split()) for old, new in zip(before, after, strict=False) if old != new)

    def source(self) -> str:
        """The module with the change."""
        return _changed_source(self.module, self.operator, self.occurrence)


@functools.lru_cache(maxsize=64)
def _changed_source(module: str, operator: str, occurrence: int) -> str:
    """A module with a change; who asks for one asks again and again."""
    before = (ROOT / module).read_text(encoding="utf-8")
    return str(mutate_code(before, get_operator(f"core/{operator}")(), occurrence))


def matches(entry: dict[str, Any], mutant: Mutant) -> bool:
    """Say whether an accepted entry is about a mutant, wherever its line stands in the file by now.

    An entry about some of the changes of its line says which: what it is ``changed`` to, a text or several.
    """
    own = {"module": mutant.module, "function": mutant.function, "operator": mutant.operator, "line": mutant.text}
    if any(entry[name] != value for name, value in own.items()):
        return False
    changed = entry.get("changed", mutant.changed)
    return mutant.changed in ([changed] if isinstance(changed, str) else changed)


def mutants_of(module: str) -> list[Mutant]:
    """All mutants of a module, in a fixed order."""
    source = (ROOT / module).read_text(encoding="utf-8")
    tree, lines = ast.parse(source), source.splitlines()
    skipped, functions = list(_skipped(tree)), list(_functions(tree))
    nodes, found = list(ast_nodes(get_ast(source))), []
    for operator in CONFIG["operators"]:
        instance = get_operator(f"core/{operator}")()
        places = [start for node in nodes for start, _ in instance.mutation_positions(node)]
        for occurrence, start in enumerate(places):
            if not any(first <= start < last for first, last in skipped):
                around = max((entry for entry in functions if entry[0] <= start[0] <= entry[1]), default=(0, 0, ""))
                text = " ".join(lines[start[0] - 1].split())
                found.append(Mutant(module, around[2], operator, occurrence, start[0], text))
    return found


def sample(mutants: list[Mutant], count: int | None, draw: int = 0) -> list[Mutant]:
    """So many mutants of a module, the same ones for the same draw; all for None."""
    if count is None or count >= len(mutants):
        return mutants
    chosen = set(random.Random(f"{mutants[0].module}{draw or ''}").sample(range(len(mutants)), count))
    return [mutant for k, mutant in enumerate(mutants) if k in chosen]


def _skipped(tree: ast.AST) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
    """First and last position of what is not mutated: annotations, decorators, messages, assertions for mypy."""
    for node in ast.walk(tree):
        parts: list[ast.AST | None] = []
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            parts += node.decorator_list
        if isinstance(node, ast.FunctionDef):
            parts.append(node.returns)
        if isinstance(node, ast.arg | ast.AnnAssign):
            parts.append(node.annotation)
        if isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr):
            parts.append(node)
        if isinstance(node, ast.Call) and ast.unparse(node.func) in CONFIG["calls"]:
            parts.append(node)
        if isinstance(node, ast.keyword) and node.arg in CONFIG["keywords"]:
            parts.append(node.value)
        for part in parts:
            if part is not None:
                yield (part.lineno, part.col_offset), (part.end_lineno, part.end_col_offset)


def _functions(tree: ast.AST, around: str = "") -> Iterator[tuple[int, int, str]]:
    """First and last line of all functions and classes, with their names."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            name = f"{around}.{node.name}".lstrip(".")
            yield node.lineno, node.end_lineno or node.lineno, name
            yield from _functions(node, name)
        else:
            yield from _functions(node, around)


class Limits(NamedTuple):
    """How long one call of pytest may take before its mutant counts as one that never ends."""

    cpu: int = 600  #: seconds of processor time of a process, which a machine that is busy elsewhere does not use up
    wall: float = 3600.0  #: seconds by the clock, for what waits for ever and computes nothing


class Copy:
    """A copy of the checkout in which one mutant at a time is tested.

    Args:
        folder: empty, for the copy.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name in COPIED:
            if (ROOT / name).is_dir():
                shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy2(ROOT / name, folder)
        subprocess.run([sys.executable, "-m", "compileall", "-q", *COPIED[:4]], cwd=folder, check=True)

    def outcome(self, mutant: Mutant, limits: Limits) -> str:
        """Change the module and run its tests."""
        file = self.folder / mutant.module
        original = file.read_text(encoding="utf-8")
        file.write_text(mutant.source(), encoding="utf-8")
        try:
            return self.run_tests(mutant.module, limits)
        finally:
            file.write_text(original, encoding="utf-8")

    def run_tests(self, module: str, limits: Limits) -> str:
        """Run the tests of a module, up to the first that fails."""
        interpreted = module.startswith(INTERPRETED)
        homes = [self.folder if interpreted or name in ("agents", "workbench") else ROOT for name in COPIED[:4]]
        path = [home / name if name != "sffr_gym" else home for home, name in zip(homes, COPIED[:4], strict=True)]
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join(map(str, path)),
            "PYTHONDONTWRITEBYTECODE": "1",
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",  # half of the time that a short test takes
            "SFFR_INTERPRETED": str(int(interpreted)),
        }
        command = [sys.executable, "-P", "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-m", "not slow"]
        for test in MODULES[module]:  # one by one, since pytest's -k holds for all files of a call
            running = subprocess.Popen(
                [*command, *shlex.split(f"tests/{test}")], cwd=self.folder, env=environment, stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL, start_new_session=True,
            )  # fmt: skip
            resource.prlimit(running.pid, resource.RLIMIT_CPU, (limits.cpu, limits.cpu + 5))
            try:
                if code := running.wait(limits.wall):
                    return TIMEOUT if code == -signal.SIGXCPU else KILLED
            except subprocess.TimeoutExpired:
                os.killpg(running.pid, signal.SIGKILL)
                running.wait()
                return TIMEOUT
        return SURVIVED


class Outcomes:
    """What is known of a module's mutants, kept in a file.

    Args:
        module: path from the root.
    """

    def __init__(self, module: str) -> None:
        self._file = OUT / (module.removesuffix(".py").replace("/", ".") + ".json")
        source = hashlib.sha256((ROOT / module).read_bytes()).hexdigest()[:16]
        kept = json.loads(self._file.read_text(encoding="utf-8")) if self._file.exists() else {}
        self._kept: dict[str, Any] = kept if kept.get("source") == source else {"source": source, "outcomes": {}}

    def __getitem__(self, mutant: Mutant) -> str | None:
        return self._kept["outcomes"].get(mutant.key)

    def __setitem__(self, mutant: Mutant, outcome: str) -> None:
        self._kept["outcomes"][mutant.key] = outcome
        OUT.mkdir(parents=True, exist_ok=True)
        write_whole(self._file, to_json(self._kept).encode())


def run(mutants: list[Mutant], outcomes: dict[str, Outcomes], workers: int) -> None:
    """Test mutants side by side, module by module, and keep every outcome.

    Raises:
        SystemExit: if a module's tests fail without any change.
    """
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(workers) as pool:
        copies: Queue[Copy] = Queue()
        for k in range(workers):
            copies.put(Copy(Path(name) / str(k)))

        def test(mutant: Mutant, limits: Limits) -> tuple[Mutant, str]:
            copy = copies.get()
            try:
                return mutant, copy.outcome(mutant, limits)
            finally:
                copies.put(copy)

        for module in dict.fromkeys(mutant.module for mutant in mutants):
            limits = _limits(module, copies)
            own = [pool.submit(test, mutant, limits) for mutant in mutants if mutant.module == module]
            for done in as_completed(own):
                mutant, outcome = done.result()
                outcomes[mutant.module][mutant] = outcome
                if outcome == SURVIVED and not mutant.reason:
                    print(f"{mutant.module}:{mutant.line} {mutant.function}: {mutant.changed}", flush=True)


def _limits(module: str, copies: Queue[Copy]) -> Limits:
    """Run a module's tests without any change, and derive how long they may take with one."""
    copy, wall, cpu = copies.get(), time.perf_counter(), _cpu()
    outcome = copy.run_tests(module, Limits())
    copies.put(copy)
    if outcome != SURVIVED:
        raise SystemExit(f"{module}: {' '.join(MODULES[module])} fail or hang without any change")
    wall, cpu = time.perf_counter() - wall, _cpu() - cpu
    print(f"{module}: {wall:.0f} s for its tests, {cpu:.0f} s of processor time", flush=True)
    return Limits(round(20.0 + 4.0 * cpu), 120.0 + 20.0 * wall)


def _cpu() -> float:
    """Processor time in s of all processes that were started and have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _tested(module: str, mutants: list[Mutant], outcomes: Outcomes) -> Tested:
    """What is known of a module's chosen mutants."""
    known = [mutant for mutant in mutants if outcomes[mutant]]
    return Tested(module, len(mutants_of(module)), len(known), [each for each in known if outcomes[each] == SURVIVED])


def main() -> int:
    """Test what is missing, write the report, and return how many mutants survive without a reason."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("modules", nargs="*", metavar="MODULE", help="such as sffr_gym/task/score.py; all without")
    parser.add_argument("--sample", type=int, metavar="N", help="so many mutants of each module; all without")
    parser.add_argument("--draw", type=int, default=0, metavar="K", help="another sample for another number")
    parser.add_argument("--again", action="store_true", help="test those again that survived without a reason")
    parser.add_argument("--known", action="store_true", help="test none that was not tested before")
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="tests side by side")
    parser.add_argument("--report", type=Path, metavar="FILE", help="write the counts and survivors, as Markdown")
    arguments = parser.parse_args()
    if unknown := set(arguments.modules) - MODULES.keys():
        parser.error(f"not in mutants.toml: {', '.join(sorted(unknown))}")
    chosen = {
        module: sample(mutants_of(module), arguments.sample, arguments.draw) for module in arguments.modules or MODULES
    }
    outcomes = {module: Outcomes(module) for module in chosen}

    def is_due(mutant: Mutant) -> bool:
        known = outcomes[mutant.module][mutant]
        return (not arguments.known and known is None) or (arguments.again and known == SURVIVED and not mutant.reason)

    if due := [mutant for mutants in chosen.values() for mutant in mutants if is_due(mutant)]:
        run(due, outcomes, arguments.workers)
    text = report([_tested(module, mutants, outcomes[module]) for module, mutants in chosen.items()])
    if arguments.report:
        write_whole(arguments.report, text.encode())
    print(text)
    return sum(
        outcomes[module][mutant] == SURVIVED and not mutant.reason
        for module, mutants in chosen.items()
        for mutant in mutants
    )


if __name__ == "__main__":
    sys.exit(min(main(), 1))
