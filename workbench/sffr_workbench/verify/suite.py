"""All checks, section by section, each with its time; a check that raises is a failed check."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib import import_module
from inspect import getdoc
from time import perf_counter

from sffr_gym.compile.library import is_interpreted, load_library
from sffr_gym.physics.simulator import Simulator
from sffr_workbench.common import Progress, ignore
from sffr_workbench.verify.check import Check

SECTIONS = (
    ("The panel's equations", "equations"),
    ("The suppression law", "control_law"),
    ("Rigid part", "rigid"),
    ("Coupled solution", "coupling"),
    ("Staggered coupling (Fig. 1)", "staggered"),
    ("Conservation and order", "conservation"),
    ("Closed chain with the object", "grasp"),
    ("Fig. 5: a known force on the base", "fig5"),
    ("Large motions: panels that keep their length", "large_motion"),
)
NAMES = tuple(name for _, name in SECTIONS)


def run_checks(
    quick: bool = False, sections: Sequence[str] | None = None, progress: Progress = ignore
) -> Iterator[Check]:
    """Run the checks and yield each as it finishes.

    A check that raises, or whose library is missing, is yielded as failed with the reason in its note.

    Args:
        quick: fewer random states, shorter runs, and without what only explains.
        sections: names of the sections to run, of ``NAMES``; None for all.
        progress: called as each check begins with what it does, how many are done, and how many there are.
    """
    chosen = [(title, name) for title, name in SECTIONS if sections is None or name in sections]
    listed = [(title, function) for title, name in chosen for function in _listed(name, quick)]
    progress(_purpose(start_simulator), 0, len(listed))
    started = _run(start_simulator, "The simulator")
    if not started.passed:
        yield started
    for done, (title, function) in enumerate(listed):
        progress(_purpose(function), done, len(listed))
        yield _run(function, title)


def missing_libraries(sections: Sequence[str]) -> dict[str, str]:
    """Return the sections that lack a library, and the name of that library."""
    missing = {}
    for name in sections:
        try:
            import_module(f"{__package__}.{name}")
        except ModuleNotFoundError as error:
            missing[name] = str(error.name)
    return missing


def start_simulator() -> Check:
    """Load the compiled simulator and let it run.

    The other checks are then of the code that users run, and none is charged for loading it.
    """
    if load_library() is None and not is_interpreted():
        raise RuntimeError("there is no compiled code for this machine; what is checked runs as Python")
    sim = Simulator()
    sim.step(sim.initial_state())
    return Check("The simulator runs", "", 0.0, 0.0, "", True, 0.0, "")


def _listed(name: str, quick: bool) -> list[Callable[[], Check]]:
    """Return the checks of a section; a single failed one if its module cannot be loaded."""
    try:
        return list(import_module(f"{__package__}.{name}").checks(quick))
    except ImportError as error:  # not installed, or installed without what it needs itself
        return [partial(_failed, name, f'{error}; pip install "sffr-gym[verify]"')]


def _purpose(function: Callable[[], Check]) -> str:
    """Return the first line of the docstring of a check, for people who wait for it."""
    return (getdoc(_function(function)) or "").partition("\n")[0].rstrip(".")


def _run(function: Callable[[], Check], section: str) -> Check:
    """Run a check of a section and time it; one that raises has failed."""
    start = perf_counter()
    try:
        check = function()
    except Exception as error:  # an engine that gives up, an array of the wrong shape: red, and the next check goes on
        check = _failed(_function(function).__name__.replace("_", " "), f"{type(error).__name__}: {error}")
    return check._replace(seconds=perf_counter() - start, section=section)


def _function(function: Callable[[], Check]) -> Callable[..., Check]:
    """Return the function below a ``partial``."""
    return getattr(function, "func", function)


def _failed(name: str, note: str) -> Check:
    """Fail a section whose library is missing, or a check that raised."""
    return Check(name, "", math.nan, math.nan, "", False, 0.0, note)
