"""All checks, section by section, each with its time; a check that breaks down is a failed check."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from importlib import import_module
from time import perf_counter

from sffr_gym.simulator import Simulator
from verification.check import Check

SECTIONS = (
    ("The panel's equations", "equations"),
    ("The suppression law", "control_law"),
    ("Rigid part", "rigid"),
    ("Coupled solution", "coupling"),
    ("Staggered coupling (Fig. 1)", "staggered"),
    ("Conservation and order", "conservation"),
    ("Closed chain with the object", "grasp"),
    ("Fig. 5: a known force on the base", "fig5"),
)


def run_checks(quick: bool = False) -> Iterator[Check]:
    """Run the checks and yield each as it finishes.

    A check that raises, or whose library is missing, is yielded as failed with the reason in its note.

    Args:
        quick: fewer random states, shorter runs, and without what only explains.
    """
    compile_kernels()
    for section, name in SECTIONS:
        try:
            listed = import_module(f"verification.{name}").checks(quick)
        except ImportError as error:  # not installed, or installed without what it needs itself
            note = f'{error}; pip install "sffr-gym[verify]"'
            yield _broken(section, note)._replace(section=section)
            continue
        for function in listed:
            start = perf_counter()
            check = _run(function)
            yield check._replace(seconds=perf_counter() - start, section=section)


def compile_kernels() -> None:
    """Compile the simulator's kernels, or load them, so that no check is charged for it."""
    sim = Simulator()
    state = sim.step(sim.initial_state())
    sim.acceleration(state)
    sim.q_flex(state)


def _run(function: Callable[[], Check]) -> Check:
    try:
        return function()
    except Exception as error:  # an engine that gives up, an array of the wrong shape: red, and the next check goes on
        name = getattr(function, "func", function).__name__.replace("_", " ")
        return _broken(name, f"{type(error).__name__}: {error}")


def _broken(name: str, note: str) -> Check:
    return Check(name, "", math.nan, math.nan, "", False, 0.0, note)
