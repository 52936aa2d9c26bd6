"""The page on mutants, ``docs/mutants.md``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

PACKAGES = ("sffr_gym", "sffr_baselines", "sffr_agents", "sffr_workbench")
HEAD = "mutants | tested | caught | survived with a reason | without |"
INTRODUCTION = """# Mutants

Single changes of operators, numbers and conditions of task, laws, learning, standings and the report's data, and
whether the tests notice them. The equations of motion, the integrators, the actuators and the laws' terms have
`python -m sffr_workbench.verify.flips` besides. Written by `make mutants`; `tests/mutants.toml` says what is changed,
which tests run, and why a survivor is accepted.
"""
SAMPLED = """
Of some modules only samples are tested (`--sample`; another one with `--draw`). Tests were written for those of them
that had survived: of the mutants outside, fewer will be caught.
"""


class Survivor(Protocol):
    """A mutant that no test notices."""

    line: int
    function: str
    operator: str
    text: str

    @property
    def changed(self) -> str:
        """Return what the change puts in the place of its line."""

    @property
    def reason(self) -> str:
        """Return why it is accepted; empty if it is not."""


class Tested(NamedTuple):
    """What is known of a module's mutants."""

    module: str  #: path from the root
    mutants: int  #: all there are
    tested: int
    survivors: Sequence[Survivor]

    @property
    def counts(self) -> tuple[int, ...]:
        """Return the numbers of a row of the table."""
        explained = sum(bool(mutant.reason) for mutant in self.survivors)
        alive = len(self.survivors)
        return self.mutants, self.tested, self.tested - alive, explained, alive - explained


def report(modules: Sequence[Tested]) -> str:
    """Return counts by package and by module, and all survivors, as Markdown."""
    missing = [each.module for each in modules if not each.tested]
    modules = [each for each in modules if each.tested]
    mutants, tested, caught, explained, _ = _total(modules)
    told = tested - explained
    lines = [INTRODUCTION + SAMPLED * (tested < mutants)]
    lines += [
        f"{caught} of {tested} tested mutants are caught, {_percent(caught, tested)}; of those without an accepted "
        f"reason {caught} of {told}, {_percent(caught, told)}.",
        *([f"Not tested: {', '.join(f'`{module}`' for module in missing)}."] if missing else []),
        "",
    ]
    parts = {name: [each for each in modules if f"{name}/" in each.module] for name in PACKAGES}
    rows = [_row(f"`{name}`", _total(own)) for name, own in parts.items() if own]
    lines += [f"| package | {HEAD}", "|---|" + "--:|" * 5, *rows, _row("all", _total(modules)), ""]
    lines += [f"| module | {HEAD}", "|---|" + "--:|" * 5, *(_row(f"`{each.module}`", each.counts) for each in modules)]
    lines += [
        "",
        "## Survivors",
        "",
        "| function | operator | line | changed to | why it stays |",
        "|---|" + "---|" * 4,
    ]
    for each in modules:
        for mutant in each.survivors:
            place = f"`{each.module}`" + (f", `{mutant.function}`" if mutant.function else "")
            cells = (place, mutant.operator, _code(mutant.text), _code(mutant.changed), mutant.reason or "**none**")
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([*lines, ""])


def _total(modules: Sequence[Tested]) -> tuple[int, ...]:
    return tuple(map(sum, zip(*(each.counts for each in modules), strict=True))) or (0,) * 5


def _row(name: str, counts: Sequence[int]) -> str:
    return f"| {name} | {' | '.join(map(str, counts))} |"


def _percent(part: int, whole: int) -> str:
    return f"{100.0 * part / max(whole, 1):.1f} %"


def _code(text: str) -> str:
    return "`" + text.replace("|", "\\|") + "`"
