"""Checks of what a motion must keep: energy, momentum, closed grasps; and of the integrator's order.

All panels are undamped here. The default integrator, ETDRK4, solves the stiff modes by the exponential of their matrix:
it takes no energy out of them at any step.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from sffr_baselines import make_policy
from sffr_baselines.rollout import rollout
from sffr_gym.config.params import Params, load_params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.simulator import Simulator
from sffr_gym.types import Array
from sffr_workbench.common import plural
from sffr_workbench.verify.check import Check, make_check
from sffr_workbench.verify.motion import UNLIKE, random_torques

UNDAMPED = "panel.strain_rate_damping=0"
SWINGING = "initial.qd=[0.85, 0, 0.05, 0.1, -0.2, -0.1, 0.15, 0.3, -0.3]"  # base and joints turn, panels vibrate
GENTLE = "initial.qd=[0.85, 0, 0.005, 0.01, -0.02, -0.01, 0.015, 0.3, -0.3]"  # what the closed arms can do for 10 s
FAST = "initial.qd=[0.85, 0, 0.3, 1, -2, -1, 1.5, 2, -2]"  # joints turn at 2 rad/s
SOFT = "panel.E=1.0e+7"  # Pa: axial modes that an explicit method can follow


def checks(quick: bool) -> list[partial[Check]]:
    """List the checks of this module."""
    robots = [
        ("free robot", (SWINGING, "object=null")),
        ("four elements", (SWINGING, "object=null", "panel.elements=4")),
        ("panels that differ", (SWINGING, "object=null", "panel.elements=4", *UNLIKE)),
        ("with object", (GENTLE,)),
    ]
    listed = [partial(conserved, name, load_params().with_overrides(UNDAMPED, *changes)) for name, changes in robots]
    listed += [partial(axial_energy), partial(closed_grasps, seconds=5.0 if quick else 20.0)]
    if not quick:
        listed.append(partial(closed_grasps_on_circle))
    # Slow enough for the series, fast enough for the error to stand above rounding; the split of modes stays the same.
    listed += [
        partial(order, "rk4", (SOFT,), [2.0e-3, 1.0e-3, 5.0e-4]),
        partial(order, "etdrk4", (SOFT,), [2.0e-2, 1.4285714285714286e-2, 1.0e-2, 7.142857142857143e-3]),
        partial(step_error, 1),
        partial(step_error, 8),
    ]
    return listed


def conserved(name: str, params: Params, seconds: float = 10.0) -> Check:
    """Check the energy and momentum of a free motion."""
    sim = Simulator(params)
    state = sim.initial_state()
    energy, momentum = sim.energy(state), sim.momentum(state)
    energy_error = momentum_error = 0.0
    for k in range(round(seconds / params.control.period)):
        state = sim.step(state)
        if k % 25 == 24:
            energy_error = max(energy_error, abs(sim.energy(state) / energy - 1.0))
            momentum_error = max(momentum_error, np.abs(sim.momentum(state) - momentum).max() / np.abs(momentum).max())
    return make_check(
        f"Energy and momentum, {name}", f"their start, {seconds:g} s of free motion",
        max(energy_error, momentum_error), 1.0e-10, "",
        f"Relative drift: energy {energy_error:.1e}, linear and angular momentum {momentum_error:.1e}; default "
        "integrator and step.",
    )  # fmt: skip


def axial_energy(seconds: float = 10.0) -> Check:
    """Check the energy of a motion that is axial vibration alone, by the default integrator."""
    start = ("initial.qd=[0, 0, 0, 0, 0, 0, 0, 0, 0]", "initial.qfd=[0, 0, 0]", "initial.qf=[1.0e-6, 0, 0]")
    sim = Simulator(load_params().with_overrides(UNDAMPED, "object=null", *start))
    state = sim.initial_state()
    energy, worst = sim.energy(state), 0.0
    for _ in range(round(seconds / 0.1)):
        state = sim.step(state, dt=0.1)
        worst = max(worst, abs(sim.energy(state) / energy - 1.0))
    return make_check(
        "Axial vibration at 2828 and 3200 rad/s", f"its energy at the start, {seconds:g} s", worst, 1.0e-10, "",
        "Panels stretched by 1 micrometre and let go; ETDRK4 at 2 ms, six radians a step, keeps their energy.",
    )  # fmt: skip


def closed_grasps(seconds: float, amplitude: float = 0.2) -> Check:
    """Check the gaps of the grasps under random joint torques."""
    sim = Simulator(load_params())
    state, worst = sim.initial_state(), 0.0
    for piece in random_torques(amplitude, seconds):
        state = sim.step(state, joints=piece.joints, dt=piece.duration)
        worst = max(worst, sim.constraint_drift(state))
    return make_check(
        "Gaps of the grasps, random torques", f"closed; {seconds:g} s of torques up to {amplitude} N m", worst, 1.0e-9,
        "m", "Largest distance of a gripper from its grasp point.",
    )  # fmt: skip


def closed_grasps_on_circle() -> Check:
    """Check the gaps of the grasps over the whole circle under HSC."""
    env = SFFRFlexEnv(scenario="nominal")
    trajectory = rollout(env, make_policy("hsc", env), seed=0)
    sim, still = Simulator(load_params()), np.zeros(trajectory.p.shape[1])
    worst = max(sim.constraint_drift(sim.unflatten(0.0, p, still)) for p in trajectory.p)
    return make_check(
        "Gaps of the grasps, full circle", f"closed; {trajectory.t[-1]:.1f} s under HSC", worst, 1.0e-9, "m",
        "Largest distance of a gripper from its grasp point.",
    )  # fmt: skip


def order(integrator: str, changes: tuple[str, ...], steps: list[float]) -> Check:
    """Check the slope of the state's error over the step, in a motion of fast joints."""
    params = load_params().with_overrides(UNDAMPED, "object=null", FAST, *changes)
    reference = _final(params, "rk4", 1.0e-4)
    errors = [float(np.linalg.norm(_final(params, integrator, step) - reference)) for step in steps]
    slope = float(np.polyfit(np.log(steps), np.log(errors), 1)[0])
    return make_check(
        f"Order of {integrator}", "4, fitted slope", abs(slope - 4.0), 0.2, "",
        f"Slope {slope:.2f}; steps {steps[0] * 1e3:.3g} to {steps[-1] * 1e3:.3g} ms, errors {errors[0]:.1e} to "
        f"{errors[-1]:.1e}. Panels of 10 MPa, whose axial mode a fine explicit step can follow.",
    )  # fmt: skip


def step_error(elements: int) -> Check:
    """Check the error of the default integrator at its default step with the real panel."""
    params = load_params().with_overrides("object=null", FAST, f"panel.elements={elements}")
    reference = _final(params, "rk4", 2.5e-5)
    simulation = params.simulation
    error = float(np.abs(_final(params, simulation.integrator, simulation.max_step) - reference).max())
    return make_check(
        f"Default integrator and step, {plural(elements, 'element')}", "RK4 at 0.025 ms, after 1 s", error,
        5.0e-7, "SI", f"{simulation.integrator} at {simulation.max_step * 1e3:g} ms; joints turn at 2 rad/s. Largest "
        "entry of the state.",
    )  # fmt: skip


def _final(params: Params, integrator: str, step: float) -> Array:
    """Return the state after 1 s as one vector."""
    sim = Simulator(params, integrator=integrator, max_step=step)
    state = sim.step(sim.initial_state(), dt=1.0)
    return np.concatenate([state.q, state.qd, state.qf.ravel(), state.qfd.ravel()])
