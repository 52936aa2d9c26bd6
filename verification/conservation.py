"""Checks of what a motion must keep: energy, momentum, closed grasps; and of the integrator's order.

All panels are undamped here. The default integrator, ETDRK4, solves the stiff modes by the exponential of their matrix:
it takes no energy out of them at any step.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from baselines import make_policy
from baselines.rollout import rollout
from sffr_gym.env import SFFRFlexEnv
from sffr_gym.params import Params, load_params
from sffr_gym.simulator import Simulator, State
from verification.check import Array, Check, judge
from verification.motion import random_torques

UNDAMPED = "panel.strain_rate_damping=0"
SWINGING = "initial.qd=[0.85, 0, 0.05, 0.1, -0.2, -0.1, 0.15, 0.3, -0.3]"  # base and joints turn, panels vibrate
GENTLE = "initial.qd=[0.85, 0, 0.005, 0.01, -0.02, -0.01, 0.015, 0.3, -0.3]"  # what the closed arms can do for 10 s
SOFT = "panel.E=1.0e+7"  # Pa: axial modes that an explicit method can follow


def checks(quick: bool) -> list[partial[Check]]:
    """The checks of this module."""
    robots = [
        ("free robot", (SWINGING, "object=null")),
        ("four elements", (SWINGING, "object=null", "panel.elements=4")),
        ("with object", (GENTLE,)),
    ]
    listed = [partial(kept, name, load_params().with_overrides(UNDAMPED, *changes)) for name, changes in robots]
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


def kept(name: str, params: Params, seconds: float = 10.0) -> Check:
    """Energy and momentum of a free motion."""
    sim = Simulator(params)
    state = sim.initial_state()
    energy, momentum = sim.energy(state), sim.momentum(state)
    lost = moved = 0.0
    for k in range(round(seconds / params.control.period)):
        state = sim.step(state)
        if k % 25 == 24:
            lost = max(lost, abs(sim.energy(state) / energy - 1.0))
            moved = max(moved, np.abs(sim.momentum(state) - momentum).max() / np.abs(momentum).max())
    return judge(
        f"Energy and momentum, {name}", f"their start, {seconds:g} s of free motion", max(lost, moved), 1.0e-10, "",
        f"Relative drift: energy {lost:.1e}, linear and angular momentum {moved:.1e}; default integrator and step.",
    )  # fmt: skip


def axial_energy(seconds: float = 10.0) -> Check:
    """Energy of a motion that is axial vibration alone, by the default integrator."""
    start = ("initial.qd=[0, 0, 0, 0, 0, 0, 0, 0, 0]", "initial.qfd=[0, 0, 0]", "initial.qf=[1.0e-6, 0, 0]")
    sim = Simulator(load_params().with_overrides(UNDAMPED, "object=null", *start))
    state = sim.initial_state()
    energy, worst = sim.energy(state), 0.0
    for _ in range(round(seconds / 0.1)):
        state = sim.step(state, dt=0.1)
        worst = max(worst, abs(sim.energy(state) / energy - 1.0))
    return judge(
        "Axial vibration at 2828 and 3200 rad/s", f"its energy at the start, {seconds:g} s", worst, 1.0e-10, "",
        "Panels stretched by 1 micrometre and let go; ETDRK4 at 2 ms, six radians a step, keeps their energy.",
    )  # fmt: skip


def closed_grasps(seconds: float, amplitude: float = 0.2) -> Check:
    """Gaps of the grasps under random joint torques."""
    sim = Simulator(load_params())
    state, worst = sim.initial_state(), 0.0
    for piece in random_torques(amplitude, seconds):
        state = sim.step(state, joints=piece.joints, dt=piece.duration)
        worst = max(worst, sim.constraint_drift(state))
    return judge(
        "Gaps of the grasps, random torques", f"closed; {seconds:g} s of torques up to {amplitude} N m", worst, 1.0e-9,
        "m", "Largest distance of a gripper from its grasp point.",
    )  # fmt: skip


def closed_grasps_on_circle() -> Check:
    """Gaps of the grasps over the whole circle under HSC."""
    env = SFFRFlexEnv(scenario="nominal")
    trajectory = rollout(env, make_policy("hsc", env), seed=0)
    sim, still = Simulator(load_params()), np.zeros(trajectory.p.shape[1])
    worst = max(sim.constraint_drift(sim.unflatten(0.0, p, still)) for p in trajectory.p)
    return judge(
        "Gaps of the grasps, full circle", f"closed; {trajectory.t[-1]:.1f} s under HSC", worst, 1.0e-9, "m",
        "Largest distance of a gripper from its grasp point.",
    )  # fmt: skip


def order(integrator: str, changes: tuple[str, ...], steps: list[float]) -> Check:
    """Slope of the state's error over the step, in a motion of fast joints."""
    fast = "initial.qd=[0.85, 0, 0.3, 1, -2, -1, 1.5, 2, -2]"
    params = load_params().with_overrides(UNDAMPED, "object=null", fast, *changes)
    reference = _final(params, "rk4", 1.0e-4)
    errors = [float(np.linalg.norm(_final(params, integrator, step) - reference)) for step in steps]
    slope = float(np.polyfit(np.log(steps), np.log(errors), 1)[0])
    return judge(
        f"Order of {integrator}", "4, fitted slope", abs(slope - 4.0), 0.2, "",
        f"Slope {slope:.2f}; steps {steps[0] * 1e3:.3g} to {steps[-1] * 1e3:.3g} ms, errors {errors[0]:.1e} to "
        f"{errors[-1]:.1e}. Panels of 10 MPa, whose axial mode a fine explicit step can follow.",
    )  # fmt: skip


def step_error(elements: int) -> Check:
    """Error of the default integrator at its default step with the real panel."""
    fast = "initial.qd=[0.85, 0, 0.3, 1, -2, -1, 1.5, 2, -2]"
    params = load_params().with_overrides("object=null", fast, f"panel.elements={elements}")
    reference = _final(params, "rk4", 2.5e-5)
    simulation = params.simulation
    error = float(np.abs(_final(params, simulation.integrator, simulation.max_step) - reference).max())
    return judge(
        f"Default integrator and step, {elements} element{'s' * (elements > 1)}", "RK4 at 0.025 ms, after 1 s", error,
        5.0e-7, "SI", f"{simulation.integrator} at {simulation.max_step * 1e3:g} ms; joints turn at 2 rad/s. Largest "
        "entry of the state.",
    )  # fmt: skip


def _final(params: Params, integrator: str, step: float) -> Array:
    """The state after 1 s as one vector."""
    sim = Simulator(params, integrator=integrator, max_step=step)
    state = sim.step(sim.initial_state(), dt=1.0)
    return _vector(state)


def _vector(state: State) -> Array:
    return np.concatenate([state.q, state.qd, state.qf.ravel(), state.qfd.ravel()])
