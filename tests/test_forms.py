"""The forms in which entries are compiled: all robots and environments give arguments of these."""

import functools

import numpy as np
import pytest
from project import ROOT

import sffr_baselines.exemplars
import sffr_gym.envs.exemplars
from sffr_baselines import make_policy
from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv
from sffr_baselines.rollout import rollout, true_observations
from sffr_gym.compile.arguments import Block
from sffr_gym.compile.kernels import ENTRIES
from sffr_gym.compile.lanes import WIDTH
from sffr_gym.compile.library import load_library
from sffr_gym.config.params import load_params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.physics.simulator import Simulator
from sffr_gym.task.scenario import load_scenario

SHOWN = ("sffr_gym", "sffr_baselines")  # packages whose exemplars are imported here
ONE_PANEL = "panel.mounts=[{name: one, root: [0.3, -0.7], angle: 2.1}]"
NO_ARMS = ["arms=[]", "object=null", "initial.q=[0, 0, 0]", "initial.qd=[0.1, 0, 0]"]
ROBOTS = {
    "case study": [],
    "one panel": [ONE_PANEL],
    "no panels": ["panel.mounts=[]"],
    "no object": ["object=null"],
    "no arms": NO_ARMS,
    "nothing but a base": [*NO_ARMS, "panel.mounts=[]"],
    "several elements": ["panel.elements=3"],
    "staggered": ["simulation.coupling=staggered", "simulation.max_step=2.0e-4"],
    "staggered, one panel": ["simulation.coupling=staggered", "simulation.max_step=2.0e-4", ONE_PANEL],
    "patches": ["actuators.piezo.array=patches"],
    "tip": ["actuators.piezo.array=tip"],
    "no mode of its own": ["panel.axial_cut=1e-6", "panel.bending_cut=1e-6"],
    "classical integrator": ["simulation.integrator=rk4"],
}
SCENARIO = load_scenario("nominal").model_copy(update={"duration": 0.01})


def test_every_entry_has_exemplars_that_are_compiled(monkeypatch):
    for module in (sffr_gym.envs.exemplars, sffr_baselines.exemplars):
        monkeypatch.setattr(module, "load_params", functools.cache(module.load_params))
    compiled, own = load_library(), [entry for name, entry in ENTRIES.items() if name.partition(".")[0] in SHOWN]
    assert len(own) >= 9
    for entry in own:
        shown = list(entry.exemplars())
        assert shown, entry.name
        for _, arguments in shown:
            assert compiled.function(entry.name, Block(arguments).form)


def robots():
    for name, overrides in ROBOTS.items():
        yield pytest.param(lambda overrides=overrides: load_params().with_overrides(*overrides), id=name)


@pytest.fixture(scope="module", params=robots())
def robot(request):
    """A robot, and a library that is there for it."""
    assert load_library() is not None
    return request.param()


@pytest.mark.parametrize("n", [1, 2, WIDTH + 1])
def test_the_environments_of_a_robot_are_compiled(robot, n):
    """One, and many of them, one by one and in lanes."""
    env = SFFRFlexVectorEnv(n, params=robot)
    first = env.reset(seed=0)[0]
    obs, *_ = env.step(np.zeros(env.action_space.shape))
    assert np.isfinite(obs).all() and (obs != first).any()
    single = SFFRFlexEnv(params=robot)
    single.reset(seed=n - 1)
    assert single.step(np.zeros(single.action_space.shape))[0].tolist() == obs[-1].tolist()


def test_the_damping_environments_of_a_robot_are_compiled(robot):
    if not robot.n_panels:
        pytest.skip("nothing to damp")
    soft = robot.with_overrides("suppression.B0=[0, 0.01, 0.001]")  # which every sampled loop can run
    many = SFFRFlexDampingVectorEnv(WIDTH + 1, scenario="nominal", params=soft, agent_period=robot.control.period)
    single = SFFRFlexDampingEnv("nominal", soft, agent_period=robot.control.period)
    many.reset(seed=0)
    obs = many.step(np.zeros(many.action_space.shape))[0]
    for i in (0, WIDTH):
        single.reset(seed=i)
        assert single.step(np.zeros(single.action_space.shape))[0].tolist() == obs[i].tolist()


@pytest.mark.parametrize("law", ["none", "hsc", "ahsc", "lqr"])
def test_the_closed_loop_of_a_robot_is_compiled(robot, law):
    """And the same law through the interface."""
    env = SFFRFlexEnv(SCENARIO, params=robot)
    policy = make_policy(law, robot)
    trajectory = rollout(env, policy, seed=0)
    assert np.isfinite(trajectory.signals).all() and len(trajectory.signals) == env.ticks
    np.testing.assert_array_equal(true_observations(trajectory)[0], trajectory.obs[0])
    obs, _ = env.reset(seed=0)
    policy.reset(seed=0)
    assert np.isfinite(env.step(policy(obs))[0]).all()
    assert policy(np.tile(obs, (3, 1))[:1]).shape == (1, *env.action_space.shape)


def test_the_simulator_of_a_robot_is_compiled(robot):
    simulator = Simulator(robot)
    start = simulator.initial_state()
    state = simulator.step(start)
    assert state.t > 0.0 and (state.q != start.q).any()
    assert len(simulator.acceleration(state)[0]) == len(state.q)


@pytest.mark.parametrize("file", sorted((ROOT / "configs" / "scenarios").rglob("*.yaml")), ids=lambda file: file.stem)
def test_every_shipped_scenario_is_compiled(file):
    """Also where each environment has a plant of its own."""
    for n in (1, WIDTH + 1):
        env = SFFRFlexVectorEnv(n, scenario=str(file))
        env.reset(seed=0)
        assert np.isfinite(env.step(np.zeros(env.action_space.shape))[0]).all()
