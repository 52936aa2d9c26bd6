"""Checks of the staggered coupling (Fig. 1): its order, its price, and the step at which it becomes unstable."""

from __future__ import annotations

from functools import partial
from time import perf_counter

import numpy as np

from sffr_gym.compile.workspace import new_workspace
from sffr_gym.config.params import Params, load_params
from sffr_gym.physics.each_panel import panel_beams, panel_modes
from sffr_gym.physics.integrator import INTEGRATORS, step_shapes
from sffr_gym.physics.model import pack
from sffr_gym.physics.plant import advance_plant
from sffr_gym.physics.simulator import Simulator
from sffr_gym.physics.staggered import base_answer, growth_rate, longest_stable_step
from sffr_gym.types import Array
from sffr_workbench.verify import figures
from sffr_workbench.verify.check import Check, CheckFigure, make_check

MOVING = ("object=null", "initial.qd=[0.85, 0, 0.05, 0.1, -0.2, -0.1, 0.15, 0.3, -0.3]")  # joints turn, panels vibrate
BENDING = "panel.axial_cut=1"  # leaves the axial modes out, which limit the step
ALONE = ("object=null", "arms=[]", "initial.q=[0, 0, 0]", "initial.qd=[0, 0, 0]")
UNSTABLE = (4.0e-4, 6.0e-4, 1.0e-3)  # s


def checks(quick: bool) -> list[partial[Check]]:
    """List the checks of this module."""
    return [partial(convergence, seconds=0.5 if quick else 2.0), partial(growth)]


def convergence(seconds: float) -> Check:
    """Check the slope of the tips' distance from the exact coupling over the step, and what a step costs."""
    whole, bending = (load_params().with_overrides(*MOVING, *more) for more in ((), (BENDING,)))
    short, long = [2.5e-4 / 2**k for k in range(4)], [2.0e-3 / 2**k for k in range(5)]
    reference, cut = (_tips(params, "exact", 5.0e-5, seconds) for params in (whole, bending))
    errors = {
        "staggered": (short, [_distance(whole, "staggered", step, reference, seconds) for step in short]),
        "staggered, bending modes alone": (long, [_distance(bending, "staggered", h, cut, seconds) for h in long]),
        "exact": (long[:3], [_distance(whole, "exact", step, reference, seconds) for step in long[:3]]),
    }
    slopes = [
        float(np.polyfit(np.log(steps), np.log(differences), 1)[0]) for steps, differences in list(errors.values())[:2]
    ]
    ratio = _cost(whole, "staggered") / _cost(whole, "exact")
    finer = errors["staggered"][1][0] / short[0] * long[0] / errors["exact"][1][0]
    beams = panel_beams(whole)
    limit = longest_stable_step(whole, beams, panel_modes(whole))
    picture = CheckFigure(
        "Staggered coupling: Fig. 1 converges to the exact solution, in first order",
        f"Largest distance of the tips from the exact coupling at 0.05 ms, in {seconds:g} s of free motion. The axial "
        "modes end the first line; without them steps of 2 ms hold.",
        partial(figures.steps, errors),
    )
    return make_check(
        "Staggered coupling converges to exact", "order 1, fitted slope", max(abs(s - 1.0) for s in slopes), 0.02, "",
        f"Slopes {slopes[0]:.3f} with all modes, stable up to {1e3 * limit:.2g} ms, and {slopes[1]:.3f} with bending "
        f"modes alone, up to 2 ms. A step takes {ratio:.2f} of the time of an exact one; to be as close as exact is "
        f"with steps of 2 ms, it would need steps {finer:.0e} times shorter.",
        picture,
    )  # fmt: skip


def growth() -> Check:
    """Check the growth of vibration beyond the longest stable step, against the rate that its limit is derived from."""
    params = load_params().with_overrides(*ALONE)
    beams = panel_beams(params)
    modes = panel_modes(params)
    omega2, C = np.concatenate([each.omega**2 for each in modes]), base_answer(params, beams, modes)
    expected = [growth_rate(omega2, params.panel.strain_rate_damping, C, step) for step in UNSTABLE]
    found = [_measured_growth(params, step) for step in UNSTABLE]
    worst = max(abs(a / b - 1.0) for a, b in zip(found, expected, strict=True))
    listed = ", ".join(f"{a:.4g}/s at {1e3 * step:g} ms" for a, step in zip(found, UNSTABLE, strict=True))
    return make_check(
        "Staggered coupling, growth with long steps", "spectral radius of the linear map of a step", worst, 1.0e-3, "",
        f"Base and panels alone, the compiled step differentiated at rest: {listed}. The simulator takes shorter ones.",
    )  # fmt: skip


def _measured_growth(params: Params, step: float) -> float:
    """Measure the rate [1/s] at which small vibration grows in a step, even one that the simulator shortens."""
    model = pack(params.with_overrides("simulation.coupling=staggered", "simulation.max_step=1.0e-4"))
    n, work, small = model.at.end, new_workspace(step_shapes(model)), 1.0e-6
    columns = []
    for state in small * np.eye(2 * n):
        p, v = state[:n].copy(), state[n:].copy()
        advance_plant(model, p, v, np.zeros(n), step, 1, INTEGRATORS[params.simulation.integrator], work)
        columns.append(np.concatenate([p, v]) / small)
    return float(np.log(np.abs(np.linalg.eigvals(np.array(columns))).max()) / step)


def _distance(params: Params, coupling: str, step: float, reference: Array, seconds: float) -> float:
    """Return the largest distance of the tips from the reference's [m]."""
    return float(np.abs(_tips(params, coupling, step, seconds) - reference).max())


def _tips(params: Params, coupling: str, step: float, seconds: float) -> Array:
    """Simulate axial and transverse tip displacements (20, n_p, 2) over a free motion [m]."""
    sim = Simulator(params, coupling=coupling, max_step=step)
    state, tips = sim.initial_state(), []
    for _ in range(20):
        state = sim.step(state, dt=seconds / 20)
        tips.append(state.qf[:, -3:-1])
    return np.array(tips)


def _cost(params: Params, coupling: str, step: float = 2.0e-4, rounds: int = 20) -> float:
    """Measure the time of a step [s]: the least of some rounds, against disturbances."""
    sim = Simulator(params, coupling=coupling, max_step=step)
    start, times = sim.initial_state(), []
    for _ in range(rounds):
        begin = perf_counter()
        sim.step(start, dt=0.1)
        times.append(perf_counter() - begin)
    return min(times) * step / 0.1
