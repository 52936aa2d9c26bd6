"""Flip the sign of each term of the equations of motion in a copy of the sources, and see which check turns red.

A term is a summand, a single value that is added up, or an entry of a tuple or array of numbers, at any depth of an
expression, in the functions of ``EQUATIONS``. Run as a program it tries every flip and prints a table; one process is
enough, since the packages are imported anew from the copy after each flip and are not compiled.

    NUMBA_DISABLE_JIT=1 python tests/flips.py [--sample] [FILE ...]

Exit code 1 if a flip stays green.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import math
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PACKAGES = ("sffr_gym", "baselines", "verification")

EQUATIONS = {  # file: function: equations that it computes
    "panel.py": {"condense": "45, 48", "expand": "45"},
    "beam.py": {"shape_functions": "44", "beam": "45, 47"},
    "monolithic.py": {
        "panel_equations": "45, 48", "rigid_equations": "41", "root_jacobian": "49", "panel_angle": "46",
        "assemble": "52", "constraint_jacobian": "8",
    },
    "kinematics.py": {"base_point": "49", "arm_points": "41", "rotation": "41", "perpendicular": "41", "_beyond": "41"},
    "arms.py": {"link_directions": "41", "articulate": "41", "expand": "41", "tip_motion": "41"},
    "dynamics.py": {
        "_base_inertia": "52", "_attach": "41, 52", "_distribute": "41", "flexible_wrench": "52",
        "_root_acceleration": "49",
    },
    "grasp.py": {"couple_object": "8", "solve_object": "8"},
}  # fmt: skip
CONFIG = "sffr.yaml"
DERIVATION = "verification.panel_symbols"  # SymPy's, which takes a while and nothing from the flipped sources: kept
# Sections that see a file, the fastest first; all the others that need no long run come after them.
FIRST = {"beam.py": ("equations",), "kinematics.py": ("rigid",)}
SECTIONS = ("coupling", "rigid", "equations")
COUNTS = {"start", "at", "n", "n_a", "n_f", "n_m", "n_g", "n_modes", "N_BASE", "N_TIP", "elements", "element", "size"}
SQUARED = {"dU", "d2W"}  # arrays that enter the equations as squares: the sign of all entries at once is free
MAKERS = {"slice", "range", "zeros", "empty", "eye", "len", "base_point", "arm_points"}  # calls that give no numbers


class Flip(NamedTuple):
    """A term of the sources.

    Attributes:
        file, function: where it is; equation: what that computes.
        line: number; start, end: first and last character in the file.
        text: the term; flipped: what takes its place.
    """

    file: str
    function: str
    equation: str
    line: int
    start: int
    end: int
    text: str
    flipped: str

    def __str__(self) -> str:
        """Place and term."""
        return f"{self.file}:{self.line} {self.function}: {' '.join(self.text.split())}"


class Outcome(NamedTuple):
    """The first check that turned red with its error and allowance; empty if none did, NaN if all those broke down."""

    check: str
    error: float
    allowed: float


def all_flips() -> list[Flip]:
    """Every term of ``EQUATIONS``, and the panels' angles of Eq. 46, which are data."""
    return [flip for file, functions in EQUATIONS.items() for flip in _flips_of(file, functions)] + _panel_angles()


def sample(flips: list[Flip]) -> list[Flip]:
    """The last flip of each function."""
    return list({(flip.file, flip.function): flip for flip in flips}.values())


def outcomes(flips: list[Flip]) -> Iterator[tuple[Flip, Outcome]]:
    """Try flips one by one.

    Raises:
        RuntimeError: if a check is red without any flip.
    """
    with tempfile.TemporaryDirectory() as name:
        copy = Path(name)
        for package in (*PACKAGES, "configs"):
            shutil.copytree(ROOT / package, copy / package, ignore=shutil.ignore_patterns("__pycache__"))
        sys.path.insert(0, name)
        sys.dont_write_bytecode = True
        if red := _first_red(()).check:
            raise RuntimeError(f"red without any flip: {red}")
        for flip in flips:
            file = copy / _folder(flip.file) / flip.file
            source = file.read_text(encoding="utf-8")
            file.write_text(source[: flip.start] + flip.flipped + source[flip.end :], encoding="utf-8")
            yield flip, _first_red(FIRST.get(flip.file, ()))
            file.write_text(source, encoding="utf-8")


def _first_red(first: tuple[str, ...]) -> Outcome:
    """Import everything anew and run the checks until one fails with a number."""
    for name in [name for name in sys.modules if name.partition(".")[0] in PACKAGES and name != DERIVATION]:
        del sys.modules[name]
    importlib.invalidate_caches()
    suite = importlib.import_module("verification.suite")
    outcome = Outcome("", math.nan, math.nan)
    for section in dict.fromkeys((*first, *SECTIONS)):
        for check in suite.run_checks(quick=True, sections=[section]):
            if not check.passed:
                outcome = Outcome(check.name, check.error, check.allowed)
                if math.isfinite(check.error):
                    return outcome
    return outcome


def _flips_of(file: str, functions: dict[str, str]) -> Iterator[Flip]:
    source = (ROOT / _folder(file) / file).read_text(encoding="utf-8")
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    for node in ast.parse(source).body:
        if isinstance(node, ast.FunctionDef) and node.name in functions:
            for term in _terms_of(node):
                # Columns count bytes, which are characters: the sources are plain ASCII.
                start = starts[term.lineno - 1] + term.col_offset
                end = starts[term.end_lineno - 1] + term.end_col_offset
                text = source[start:end]
                yield Flip(file, node.name, functions[node.name], term.lineno, start, end, text, f"(-({text}))")


def _panel_angles() -> list[Flip]:
    source = (ROOT / "configs" / CONFIG).read_text(encoding="utf-8")
    found = re.finditer(r"(?<= root: )(\[.*?\], angle: )(\S+?)(?=})", source)
    return [
        Flip(CONFIG, "panel.mounts", "46", source.count("\n", 0, m.start()) + 1, *m.span(2), m[2], str(-float(m[2])))
        for m in found
    ]


def _folder(file: str) -> str:
    return "configs" if file == CONFIG else "sffr_gym"


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
        case ast.Call(function, arguments):
            name = ast.unparse(function).rpartition(".")[2]
            if name not in MAKERS:
                if alone or name in ("cos", "sin"):
                    yield node
                for argument in arguments:
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
    parser.add_argument("files", nargs="*", metavar="FILE", help="such as panel.py; all without")
    parser.add_argument("--sample", action="store_true", help="one flip of each function")
    arguments = parser.parse_args()
    if os.environ.get("NUMBA_DISABLE_JIT") != "1":
        parser.error("set NUMBA_DISABLE_JIT=1: to compile each flip takes a minute")
    if unknown := set(arguments.files) - {*EQUATIONS, CONFIG}:
        parser.error(f"no terms in {', '.join(unknown)}; there are {', '.join([*EQUATIONS, CONFIG])}")
    flips = [flip for flip in all_flips() if not arguments.files or flip.file in arguments.files]
    flips = sample(flips) if arguments.sample else flips
    green = 0
    for flip, outcome in outcomes(flips):
        green += not outcome.check
        verdict = f"{outcome.check} ({outcome.error:.1e}, allowed {outcome.allowed:.0e})" if outcome.check else "GREEN"
        print(f"{flip} | Eq. {flip.equation} | {verdict}", flush=True)
    print(f"{len(flips)} flips, {green} stay green")
    return green


if __name__ == "__main__":
    sys.exit(min(main(), 1))
