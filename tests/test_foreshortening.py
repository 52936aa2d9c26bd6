"""Panels that keep their length: Lagrange's equations of their energy, another derivation, lanes, what sensors see."""

import numpy as np
import pytest

from sffr_gym.config.params import load_params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.physics.energy import energy_of, momentum_of
from sffr_gym.physics.integrator import INTEGRATORS
from sffr_gym.physics.model import first_mode, mode_slice, pack
from sffr_gym.physics.plant import Plant
from sffr_gym.physics.simulator import Simulator
from sffr_workbench.verify import foreshortening, motion

ON = "panel.foreshortening=true"
FREE = ["object=null", "panel.strain_rate_damping=0"]
SLANTED = "panel.mounts=[{name: a, root: [0.3, -0.7], angle: 2.1}, {name: b, root: [0.1, 0.5], angle: 0.7}]"
SWINGING = "initial.qd=[0.85, 0, 0.05, 0.1, -0.2, -0.1, 0.15, 0.3, -0.3]"


def moving(elements, seed=0, changes=()):
    """A free robot with bent panels, turning joints and a fast yaw, and its positions and velocities."""
    simulator = Simulator(load_params().with_overrides(*FREE, ON, f"panel.elements={elements}", *changes))
    p, v = simulator._flat(simulator.initial_state())
    rng, at = np.random.default_rng(seed), mode_slice(simulator.model)
    p[at] = 0.8 * rng.uniform(-1.0, 1.0, p[at].shape) / np.sqrt(simulator.model.omega2.ravel())
    v[: at.start] = rng.uniform(-1.0, 1.0, at.start)
    v[at] = rng.uniform(-1.0, 1.0, v[at].shape)
    return simulator, p, v


def momenta(model, p, v):
    """Derivatives (n,) of the kinetic energy by the velocities: it is quadratic in them, so differences are exact."""
    steps = np.eye(len(v))
    return np.array([(energy_of(model, p, v + step) - energy_of(model, p, v - step)) / 2.0 for step in steps])


@pytest.mark.parametrize(("elements", "changes"), [(1, []), (4, []), (1, [SLANTED])])
def test_lagranges_equations_of_the_energy(elements, changes):
    """The momenta change as the Lagrangian does with the coordinates, and by the forces, where every term counts."""
    simulator, p, v = moving(elements, changes=changes)
    model, h, force = simulator.model._replace(damping=0.3 * simulator.model.omega2), 1.0e-4, np.zeros_like(p)
    force[mode_slice(model)] = np.random.default_rng(1).uniform(-1.0, 1.0, force[mode_slice(model)].shape)
    a = Plant(model, INTEGRATORS["etdrk4"]).accelerations(p, v, force)
    force[mode_slice(model)] -= model.damping.ravel() * v[mode_slice(model)]
    rate = (momenta(model, p + h * v, v + h * a) - momenta(model, p - h * v, v - h * a)) / (2.0 * h)

    def lagrangian(q):
        return energy_of(model, q, v) - 2.0 * energy_of(model, q, 0.0 * v)

    slope = np.array([(lagrangian(p + h * step) - lagrangian(p - h * step)) / (2.0 * h) for step in np.eye(len(p))])
    np.testing.assert_allclose(rate, slope + force, rtol=0, atol=2e-6 * np.abs(rate).max())


@pytest.mark.parametrize(("changes", "seconds"), [(["object=null"], 10.0), (["panel.elements=4"], 2.0)])
def test_energy_and_momentum_are_conserved(changes, seconds):
    """In free motion with tips that swing by 0.3 m, to 1e-8 and far below."""
    start = [SWINGING] if "object=null" in changes else []
    params = load_params().with_overrides(
        "panel.strain_rate_damping=0", ON, "initial.qf=[0, 0.3, 0.1]", *start, *changes
    )
    simulator = Simulator(params)
    state = simulator.initial_state()
    energy, momentum = simulator.energy(state), simulator.momentum(state)
    for _ in range(10):
        state = simulator.step(state, dt=seconds / 10.0)
        assert simulator.energy(state) == pytest.approx(energy, rel=1e-9)
        np.testing.assert_allclose(simulator.momentum(state), momentum, rtol=0, atol=1e-10 * np.abs(momentum).max())


def test_energy_of_linear_panels_is_that_of_the_mass_matrix():
    """The modal form of the energy against Eqs. 41 and 45, assembled in nodal coordinates."""
    simulator = Simulator(load_params().with_overrides("panel.elements=3"))
    state = simulator.initial_state()
    for _ in range(5):
        state = simulator.step(state, piezo_tau=[[20.0, 3.0, 1.0], [-30.0, -2.0, 2.0]], dt=0.1)
    rates = np.concatenate([state.qd, state.qfd.ravel()])
    energy = 0.5 * rates @ simulator.mass_matrix(state) @ rates
    energy += 0.5 * np.einsum("pf,fg,pg->", state.qf, simulator._beams[0].K, state.qf)
    energy += 0.5 * np.array([3.0, 3.0, 0.5]) @ state.objd**2
    assert simulator.energy(state) == pytest.approx(energy, rel=1e-12)


@pytest.mark.parametrize(("scale", "allowed"), [(1.0, 1e-3), (2.5, 1e-3)])
def test_another_derivation_moves_alike(scale, allowed):
    """Points of mass with full Jacobians and all modes; the linear beam differs by a hundred times as much."""
    params, pieces = motion.at_rest("object=null", "panel.elements=4"), motion.pulse(scale, 10.0)
    known = foreshortening.simulate(params, pieces).tips[:, :, 1]
    found = motion.simulate(params.with_overrides(ON), pieces).tips[:, :, 1]
    linear = motion.simulate(params, pieces).tips[:, :, 1]
    size = np.sqrt(np.mean(known**2))
    assert np.sqrt(np.mean((found - known) ** 2)) < allowed * size
    assert np.sqrt(np.mean((linear - known) ** 2)) > 10.0 * allowed * size


@pytest.mark.parametrize("elements", [1, 8])
def test_sensors_see_the_tip_drawn_in(elements):
    """By half the integral of the squared slope, from the nodal slopes alone."""
    env = SFFRFlexEnv(overrides=[ON, f"panel.elements={elements}", "initial.qf=[0, 0.4, 0.13]"])
    obs, _ = env.reset(seed=0)
    model, state = env.plant_task.model, env.get_state()
    assert model.n_axial == 0
    before = obs[env.fields["elastic"].slice].reshape(2, 3)[:, 0]
    simulator = Simulator(env.params)
    nodal = simulator.initial_state().qf[0].reshape(elements, 3)
    size, start, total = 4.0 / elements, np.zeros(3), 0.0
    for node in nodal:
        x = np.linspace(0.0, 1.0, 2001)
        shapes = np.array([6 * (x**2 - x) / size, 1 - 4 * x + 3 * x**2, 6 * (x - x**2) / size, 3 * x**2 - 2 * x])
        slope = start[1:] @ shapes[:2] + node[1:] @ shapes[2:]
        total += 0.5 * size * np.trapezoid(slope**2, x)
        start = node
    np.testing.assert_allclose(before, -total, rtol=1e-5 if elements == 1 else 1e-2)  # of its slowest modes alone
    obs = env.step(np.zeros(env.action_space.shape))[0]
    rate = (obs[env.fields["elastic"].slice].reshape(2, 3)[:, 0] - before) / env.params.control.period
    env.set_state(state)
    np.testing.assert_allclose(obs[env.fields["elastic_rate"].slice].reshape(2, 3)[:, 0], rate, rtol=0.02)


def test_a_batch_gives_the_same_bits():
    """Eight in lanes and three more, each as it is alone."""
    changes, actions = [ON, "panel.elements=4"], np.random.default_rng(0).uniform(-0.3, 0.3, (20, 11, 15))
    batch = SFFRFlexVectorEnv(11, scenario="excited", overrides=changes)
    batch.reset(seed=3)
    together = [batch.step(each)[0] for each in actions]
    for i in (0, 7, 10):
        env = SFFRFlexEnv("excited", overrides=changes)
        env.reset(seed=3 + i)
        for each, observed in zip(actions, together, strict=True):
            np.testing.assert_array_equal(env.step(each[i])[0], observed[i])


@pytest.mark.parametrize(("on", "stiffens"), [("true", True), ("false", False)])
def test_a_spinning_panel_stiffens(on, stiffens):
    """Spin makes the first mode of a foreshortened panel stiffer, that of a linear one softer."""
    simulator = Simulator(load_params().with_overrides(f"panel.foreshortening={on}", *FREE, "panel.elements=4"))
    model, (p, v) = simulator.model, simulator._flat(simulator.initial_state())
    mode, stiffness = first_mode(model, 0) + model.n_axial, []
    for rate in 0.0, 0.5:
        v[:], v[2] = 0.0, rate
        pushes = []
        for amplitude in 1.0e-6, 0.0:
            p[mode_slice(model)], p[mode] = 0.0, amplitude
            pushes.append(simulator._plant.accelerations(p, v, np.zeros_like(p))[mode])
        stiffness.append((pushes[1] - pushes[0]) / 1.0e-6)
    assert (stiffness[1] > stiffness[0] + 0.1) == stiffens
    assert (stiffness[1] < stiffness[0] - 0.1) != stiffens


def test_what_does_not_fit_is_refused():
    """Fast bending modes, and the matrices of the linear panel."""
    with pytest.raises(ConfigError, match=r"panel\.bending_cut = 1000: with panel\.foreshortening no mode may turn"):
        pack(load_params().with_overrides(ON, "panel.elements=8", "panel.bending_cut=1000"))
    simulator = Simulator(load_params().with_overrides(ON))
    for method in simulator.mass_matrix, simulator.bias:
        with pytest.raises(ValueError, match=r"panel\.foreshortening: Eqs\. 45 and 48"):
            method(simulator.initial_state())


def test_momentum_is_that_of_the_simulator():
    simulator, p, v = moving(4)
    np.testing.assert_allclose(simulator.momentum(simulator.unflatten(0.0, p, v)), momentum_of(simulator.model, p, v))
