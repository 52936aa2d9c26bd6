"""Flip the sign of each term of the equations in a copy of the sources, and see which check turns red.

A term is a summand, a single value that is added up, or an entry of a tuple or array of numbers, at any depth of an
expression, in the functions of ``TERMS``. The equations of motion are checked by sections of ``sffr verify``;
integrators, actuators, task and control laws by those of the project's tests that know their answer from elsewhere:
SciPy's integrators, the paper's formulas in NumPy, inverse dynamics. Run as a program it tries every flip and prints a
table; one process is enough, since the packages are imported again from the copy after each flip and are not compiled.
A checkout is needed.

    SFFR_INTERPRETED=1 python -m sffr_workbench.verify.flips [--sample] [FILE ...]

Exit code 1 if a flip stays green.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import importlib
import io
import math
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from sffr_workbench.verify.flip_terms import (
    CONFIG,
    COUNTS,
    DERIVATION,
    FIRST,
    FREE,
    LOOP,
    MAKERS,
    SECTIONS,
    SQUARED,
    TERMS,
    TESTS,
    ZERO,
)

ROOT = Path(__file__).parents[3]
PACKAGES = {"sffr_gym": ".", "sffr_baselines": "baselines", "sffr_workbench": "workbench"}  # and their folders


class Flip(NamedTuple):
    """A term of the sources."""

    file: str  #: where it is
    function: str
    equation: str  #: what that computes
    line: int  #: number
    start: int  #: first and last character in the file
    end: int
    text: str  #: the term
    flipped: str  #: what takes its place

    def __str__(self) -> str:
        """Place and term."""
        return f"{self.file}:{self.line} {self.function}: {' '.join(self.text.split())}"


class Outcome(NamedTuple):
    """The first check that turned red with its error and allowance; empty if none did, NaN if all those broke down."""

    check: str
    error: float
    allowed: float


def all_flips() -> list[Flip]:
    """Return every term of ``TERMS``, and the panels' angles of Eq. 46, which are data."""
    return [flip for file, functions in TERMS.items() for flip in _flips_of(file, functions)] + _panel_angles()


def sample(flips: list[Flip]) -> list[Flip]:
    """Return the last flip of each function."""
    return list({(flip.file, flip.function): flip for flip in flips}.values())


def outcomes(flips: list[Flip]) -> Iterator[tuple[Flip, Outcome]]:
    """Try flips one by one.

    Raises:
        RuntimeError: if a check is red without any flip.
    """
    with tempfile.TemporaryDirectory() as name:
        copy = Path(name)
        for package, folder in (PACKAGES | {"configs": "."}).items():
            shutil.copytree(ROOT / folder / package, copy / package, ignore=shutil.ignore_patterns("__pycache__"))
        sys.path.insert(0, name)
        sys.dont_write_bytecode = True
        for file in dict.fromkeys(flip.file for flip in flips):
            if red := _first_red(file).check:
                raise RuntimeError(f"{file}: red without any flip: {red}")
        for flip in flips:
            place = copy / _without_home(flip.file)
            source = place.read_text(encoding="utf-8")
            place.write_text(source[: flip.start] + flip.flipped + source[flip.end :], encoding="utf-8")
            yield flip, _first_red(flip.file)
            place.write_text(source, encoding="utf-8")


def _first_red(file: str) -> Outcome:
    """Import everything again and run the checks of a file until one fails."""
    for name, module in list(sys.modules.items()):
        ours = name.partition(".")[0] in PACKAGES and name != DERIVATION
        if ours or str(getattr(module, "__file__", "")).startswith(str(ROOT / "tests")):
            del sys.modules[name]
    importlib.invalidate_caches()
    outcome = Outcome("", math.nan, math.nan) if file in LOOP else _first_failed_check(FIRST.get(file, ()))
    return outcome if outcome.check or file not in TESTS else _first_failed_test(TESTS[file])


def _first_failed_test(arguments: list[str]) -> Outcome:
    """Run tests, in this process and from the checkout, up to the first that fails."""
    import pytest

    class Failures:
        names: list[str] = []

        def pytest_runtest_logreport(self, report: Any) -> None:
            self.names += [report.nodeid] if report.failed else []

        pytest_collectreport = pytest_runtest_logreport

    options = ["-x", "-q", "-p", "no:cacheprovider", "-m", "not slow", "--rootdir", str(ROOT)]
    names = [str(ROOT / "tests" / word) if word.endswith(".py") else word for word in arguments]
    Failures.names = []
    with contextlib.redirect_stdout(io.StringIO()):
        status = pytest.main([*options, *names], plugins=[Failures()])
    if status == pytest.ExitCode.OK:
        return Outcome("", math.nan, math.nan)
    return Outcome((Failures.names or [str(status)])[0], math.nan, math.nan)


def _first_failed_check(first: tuple[str, ...]) -> Outcome:
    """Run sections of ``sffr verify`` until one fails with a number."""
    suite = importlib.import_module("sffr_workbench.verify.suite")
    outcome = Outcome("", math.nan, math.nan)
    for section in dict.fromkeys((*first, *SECTIONS)):
        for check in suite.run_checks(quick=True, sections=[section]):
            if not check.passed:
                outcome = Outcome(check.name, check.error, check.allowed)
                if math.isfinite(check.error):
                    return outcome
    return outcome


def _flips_of(file: str, functions: dict[str, str]) -> Iterator[Flip]:
    source = (ROOT / file).read_text(encoding="utf-8")
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    for node in ast.parse(source).body:
        if isinstance(node, ast.FunctionDef) and node.name in functions:
            for term in _terms_of(node):
                # Columns count bytes, which are characters: the sources are plain ASCII.
                start = starts[term.lineno - 1] + term.col_offset
                end = starts[(term.end_lineno or 0) - 1] + (term.end_col_offset or 0)
                text = source[start:end]
                if (node.name, text) not in FREE and not text.startswith(ZERO):
                    yield Flip(file, node.name, functions[node.name], term.lineno, start, end, text, f"(-({text}))")


def _panel_angles() -> list[Flip]:
    source = (ROOT / CONFIG).read_text(encoding="utf-8")
    found = re.finditer(r"(?<= root: )(\[.*?\], angle: )([^,}\s]+)(?=[,}])", source)
    return [
        Flip(CONFIG, "panel.mounts", "46", source.count("\n", 0, m.start()) + 1, *m.span(2), m[2], str(-float(m[2])))
        for m in found
    ]


def _without_home(file: str) -> str:
    """Return the place of a file in the copy, where the packages lie side by side."""
    return file.removeprefix("baselines/")


def _terms_of(function: ast.FunctionDef) -> Iterator[ast.expr]:
    nodes = list(ast.walk(function))
    sums = {ast.unparse(node.target) for node in nodes if isinstance(node, ast.AugAssign)}
    for node in nodes:
        if isinstance(node, ast.AugAssign):
            yield from _terms(node.value, alone=True)
        elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) in SQUARED:
            for factor in _factors(node.value):
                yield from _terms(factor, alone=False)
        elif isinstance(node, ast.Assign) and not any(_counts(target) for target in node.targets):
            several = any(isinstance(target, ast.Tuple) for target in node.targets)
            targets = {ast.unparse(part) for target in node.targets for part in _parts(target)}
            yield from _terms(node.value, alone=bool(targets & sums) and isinstance(node.value, ast.Tuple) >= several)
        elif isinstance(node, ast.Return) and node.value is not None:
            yield from _terms(node.value, alone=False)


def _terms(node: ast.expr, alone: bool) -> Iterator[ast.expr]:
    """Terms of an expression; ``alone``: whether it is one itself if it is a bare name, number or call."""
    match node:
        case ast.BinOp(left, ast.Add() | ast.Sub(), right):
            if not _counts(node):
                yield from _terms(left, alone=True)
                yield from _terms(right, alone=True)
        case ast.UnaryOp(ast.USub(), operand):
            yield from _terms(operand, alone=True)
        case ast.BinOp(_, ast.Mult() | ast.Div() | ast.MatMult(), _):
            yield node
            for factor in _factors(node):
                yield from _terms(factor, alone=False)
        case ast.Tuple(entries) | ast.List(entries):
            for entry in entries:
                yield from _terms(entry, alone or isinstance(node, ast.List))
        case ast.Call(function, arguments, keywords):
            name = ast.unparse(function).rpartition(".")[2]
            if name not in MAKERS:
                if alone or name in ("cos", "sin"):
                    yield node
                for argument in (*arguments, *(keyword.value for keyword in keywords)):
                    yield from _terms(argument, alone=False)
        case ast.Constant(value):
            if alone and value:
                yield node
        case ast.Name() | ast.Attribute() | ast.Subscript() | ast.BinOp():
            if alone:
                yield node


def _factors(node: ast.expr) -> list[ast.expr]:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div | ast.MatMult):
        return [*_factors(node.left), *_factors(node.right)]
    return [node]


def _parts(target: ast.expr) -> list[ast.expr]:
    return target.elts if isinstance(target, ast.Tuple) else [target]


def _counts(node: ast.AST) -> bool:
    """Whether an expression counts or points at something, outside of the brackets that it may have."""
    if isinstance(node, ast.Subscript):
        return False
    if isinstance(node, ast.Name):
        return node.id in COUNTS
    return any(_counts(part) for part in ast.iter_child_nodes(node))


def main() -> int:
    """Try flips, print what turned red, and return how many stay green."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", metavar="FILE", help="such as sffr_gym/physics/panel.py; all without")
    parser.add_argument("--sample", action="store_true", help="one flip of each function")
    arguments = parser.parse_args()
    if os.environ.get("SFFR_INTERPRETED", "0") == "0":
        parser.error("set SFFR_INTERPRETED=1: to compile each flip takes a minute")
    if unknown := set(arguments.files) - {*TERMS, CONFIG}:
        parser.error(f"no terms in {', '.join(unknown)}; there are {', '.join([*TERMS, CONFIG])}")
    flips = [flip for flip in all_flips() if not arguments.files or flip.file in arguments.files]
    flips = sample(flips) if arguments.sample else flips
    green = 0
    for flip, outcome in outcomes(flips):
        green += not outcome.check
        size = f" ({outcome.error:.1e}, allowed {outcome.allowed:.0e})" if math.isfinite(outcome.error) else ""
        print(f"{flip} | {flip.equation} | {outcome.check + size or 'GREEN'}", flush=True)
    print(f"{len(flips)} flips, {green} stay green")
    return green


if __name__ == "__main__":
    sys.exit(min(main(), 1))
