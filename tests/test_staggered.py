"""Staggered coupling: order, limits, agreement with exact, the guard on the step, and the environment."""

import warnings

import numpy as np
import pytest
from numpy.typing import NDArray

from sffr_baselines import make_policy
from sffr_gym import ConfigError, Simulator, load_params
from sffr_gym.compile.workspace import new_workspace
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.physics.dynamics import accelerations, flexible_wrench, work_shapes
from sffr_gym.physics.each_panel import panel_beams, panel_modes
from sffr_gym.physics.initial import initial_positions
from sffr_gym.physics.model import pack
from sffr_gym.physics.staggered import base_answer, growth_rate, longest_stable_step
from sffr_workbench.evaluation import evaluate

Array = NDArray[np.float64]

STAGGERED = ("simulation.coupling=staggered", "simulation.max_step=2.5e-4")
BENDING = "panel.axial_cut=1"  # leaves the axial modes out


def end(coupling: str, step: float, *overrides: str, integrator: str = "etdrk4") -> Array:
    """Return positions of base, joints and tips after 0.1 s of a moving start."""
    params = load_params().with_overrides("initial.qd=[0.85, 0, 0.02, 0, 0, 0, 0, 0.3, -0.3]", *overrides)
    sim = Simulator(params, coupling=coupling, integrator=integrator, max_step=step)
    state = sim.step(sim.initial_state(), joints=0.1 * np.ones(6), dt=0.1)
    return np.concatenate([state.q, state.qf[:, -2:].ravel()])


@pytest.mark.parametrize("integrator", ["etdrk4", "rk4"])
@pytest.mark.parametrize("overrides", [(), ("object=null", "panel.elements=2"), (BENDING,)])
def test_distance_from_exact_shrinks_with_the_step(overrides: tuple[str, ...], integrator: str) -> None:
    """First order, and the constant is not small: half the step, half the distance."""
    exact = end("exact", 5e-5, *overrides)
    steps = [2.0e-4, 1.0e-4, 5.0e-5]
    distances = [np.abs(end("staggered", h, *overrides, integrator=integrator) - exact).max() for h in steps]
    slope = np.polyfit(np.log(steps), np.log(distances), 1)[0]
    assert slope == pytest.approx(1.0, abs=0.02)
    assert distances[-1] > 1e-8


def test_without_panels_both_couplings_are_one() -> None:
    """There is nothing to hold."""
    alone = ("panel.mounts=[]", "simulation.max_step=2.0e-3")
    np.testing.assert_array_equal(end("staggered", 2e-3, *alone), end("exact", 2e-3, *alone))


def test_the_base_feels_what_it_is_given() -> None:
    """Holding the Q_flex of this very state changes nothing; another one moves the base by the arms' inertia alone."""
    params = load_params()
    model = pack(params)
    p, v = initial_positions(params, model)
    p[2], v[2] = 0.4, 0.1
    work, tau = new_workspace(work_shapes(model)), np.random.default_rng(0).normal(size=model.at.end)
    exact, held, more = np.empty((3, len(p)))
    accelerations(model, p, v, tau, work, exact, False, True)
    work.held[:] = flexible_wrench(model, v, work)
    accelerations(model, p, v, tau, work, held, True, True)
    np.testing.assert_allclose(held, exact, rtol=0.0, atol=1e-10 * np.abs(exact).max())
    work.held[:] += 1.0, 2.0, 3.0
    accelerations(model, p, v, tau, work, more, True, True)
    push = np.zeros_like(tau)
    c, s = np.cos(0.4), np.sin(0.4)
    push[:3] = c + 2 * s, 2 * c - s, 3.0
    accelerations(model, p, v, tau + push, work, exact, False, True)
    work.held[:] -= 1.0, 2.0, 3.0
    accelerations(model, p, v, tau + push, work, held, True, True)
    np.testing.assert_allclose(more, held, rtol=0.0, atol=1e-10 * np.abs(held).max())


def test_step_beyond_the_limit_is_cut_and_named() -> None:
    with pytest.warns(UserWarning, match=r"simulation.max_step = 0.002 s is too long .* at most 0.000297 s are taken"):
        sim = Simulator(coupling="staggered")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        allowed = Simulator(coupling="staggered", max_step=2.97e-4)
    assert sim.model.longest_step == pytest.approx(2.973e-4, rel=1e-3)
    assert allowed.model.longest_step == 2.97e-4
    state = sim.step(sim.initial_state(), dt=2.0)
    assert np.abs(state.qf[:, 0]).max() < 1e-7


def test_panels_without_damping_have_no_stable_step() -> None:
    with pytest.raises(
        ConfigError, match=r"simulation.coupling = staggered: .* more panel.strain_rate_damping \(now 0"
    ):
        pack(load_params().with_overrides(*STAGGERED, "panel.strain_rate_damping=0"))
    assert pack(load_params().with_overrides(STAGGERED[0], "panel.strain_rate_damping=0", BENDING)).longest_step == 2e-3


def test_longest_step_follows_the_damping() -> None:
    """h = 2 eta (1 + a) / a for the axial modes, a = 0.28 for the base alone, up to the next step that is tried."""
    longest = []
    for eta in (1.0e-5, 2.0e-5, 4.0e-5):
        params = load_params().with_overrides(f"panel.strain_rate_damping={eta}", "simulation.max_step=1.0e-3")
        beams = panel_beams(params)
        modes = panel_modes(params)
        longest.append(longest_stable_step(params, beams, modes))
        omega2, C = np.concatenate([each.omega**2 for each in modes]), base_answer(params, beams, modes)
        a = np.linalg.eigvalsh(C[[0, 3]][:, [0, 3]]).max()
        assert 0.8 < longest[-1] / (2.0 * eta * (1.0 + a) / a) < 1.2
        assert growth_rate(omega2, eta, C, longest[-1]) < 0.01 < growth_rate(omega2, eta, C, 1.25 * longest[-1])
    np.testing.assert_allclose(np.diff(np.log2(longest)), 1.0, atol=0.26)


def test_controllers_run_in_environment_batch_and_evaluation(user_scenario) -> None:
    file = user_scenario(duration=0.1)
    env = SFFRFlexEnv(file, overrides=STAGGERED)
    batch = SFFRFlexVectorEnv(2, scenario=file, overrides=STAGGERED)
    single, many = make_policy("hsc", env), make_policy("hsc", batch)
    (obs, _), (all_obs, _) = env.reset(seed=0), batch.reset(seed=0)
    for _ in range(10):
        obs, *_ = env.step(single(obs))
        all_obs, *_ = batch.step(many(all_obs))
        np.testing.assert_array_equal(all_obs[0], obs)
    both = [
        evaluate(["hsc"], file, episodes=1, seed=1_000_000, overrides=overrides).results["hsc"][0].measures
        for overrides in ((), STAGGERED)
    ]
    assert both[1]["vibration"] == pytest.approx(both[0]["vibration"], rel=1e-3)
    assert both[1]["vibration"] != both[0]["vibration"] and both[1]["failed"] == 0.0
