"""The paper's modelling claims against independent codes, by the checks of ``sffr verify``."""

from __future__ import annotations

from typing import NamedTuple

from sffr_gym.config.params import load_params
from sffr_workbench.verify import Check, coupling, missing_libraries, staggered

FREE_MOTION = 0.5  # s, over which the staggered coupling is compared with the exact one
STATES = 20  # random states of the comparison with the monolithic equations
ELEMENTS = (1, 4)  # of each panel, in the comparison with the multibody code


class CrossChecks(NamedTuple):
    """Outcomes of the comparisons.

    Attributes:
        equations: partitioned equations against one linear system.
        staggered: convergence of Fig. 1, Q_flex taken from the step before, to the exact solution.
        tips: rms relative difference of the panels' tips from Exudyn's for each number of elements; empty without it.
        proof: the search for the Lyapunov matrix of the printed law's proof; None without SymPy.
        missing: libraries that are not installed.
    """

    equations: Check
    staggered: Check
    tips: dict[int, float]
    proof: Check | None
    missing: tuple[str, ...]


def run_cross_checks() -> CrossChecks:
    """Run the checks whose libraries are installed."""
    equations = coupling.solution("case study", load_params().with_overrides(*coupling.ALL_MODES), STATES)
    missing = missing_libraries(("fig5", "control_law"))
    return CrossChecks(
        equations,
        staggered.convergence(FREE_MOTION),
        {} if "fig5" in missing else _tips(),
        None if "control_law" in missing else _proof(),
        tuple(dict.fromkeys(missing.values())),
    )


def _tips() -> dict[int, float]:
    """Return the difference from Exudyn for each number of elements."""
    from sffr_workbench.verify import fig5  # its engines are optional

    reference = fig5.exudyn(fig5.SMALL)
    return {elements: fig5.tip_difference(fig5.ours(fig5.SMALL, elements), reference) for elements in ELEMENTS}


def _proof() -> Check:
    """Search for the Lyapunov matrix."""
    from sffr_workbench.verify import control_law  # SymPy is optional

    return control_law.printed_output()
