"""Robots as rows: a kernel sees in a row the robot that was put there, and a batch may hold different plants."""

import numpy as np
import pytest

from sffr_gym.compile.arguments import Block, Structures
from sffr_gym.config.params import load_params
from sffr_gym.envs import single
from sffr_gym.envs.batch import Stepper, group_shapes, make_batch, put_episode, step_range
from sffr_gym.envs.fleet import make_fleet, plant_at, plants_of, put_plant
from sffr_gym.task.episode import draw, nominal
from sffr_gym.task.scenario import load_scenario
from sffr_gym.task.task_model import make_task_model

ROBOTS = {
    "case study": [],
    "free": ["object=null"],
    "four elements, patches": ["panel.elements=4", "actuators.piezo.array=patches"],
    "no panels": ["panel.mounts=[]"],
    "no mode of its own": ["panel.axial_cut=1e-6", "panel.bending_cut=1e-6"],
    "staggered": ["simulation.coupling=staggered", "simulation.max_step=2.0e-4"],
    "classical integrator": ["simulation.integrator=rk4"],
}
ANOTHER = ["panel.EI=25", "object.mass=9", "arms.0.links.1.mass=3.5", "actuators.joint_torque=3.5"]


def leaves(value):
    return [leaf for field in value for leaf in leaves(field)] if isinstance(value, tuple) else [value]


def robot_of(*overrides):
    return make_task_model(load_params().with_overrides(*overrides))


@pytest.mark.parametrize("name", ROBOTS)
def test_a_row_gives_the_robot_back(name):
    robot = robot_of(*ROBOTS[name])
    fleet = make_fleet(robot, 3)
    seen = plant_at(fleet, 2)
    assert Block((seen,)).form == Block((robot,)).form
    for theirs, ours in zip(leaves(seen), leaves(robot), strict=True):
        np.testing.assert_array_equal(theirs, ours)


def test_a_single_row_serves_every_environment():
    fleet = make_fleet(robot_of())
    assert plant_at(fleet, 7).model.base_mass == 50.0


def run(robots, ticks=40):
    """Everything about the robots after some periods of a batch of different robots from the same start."""
    params, scenario = load_params(), load_scenario("excited")
    fleet, batch = make_fleet(robots[0], len(robots)), make_batch(robots[0], len(robots))
    for i, robot in enumerate(robots):
        put_plant(fleet, i, robot)
    stepper = Stepper(step_range, plants_of(fleet), batch, 15, group_shapes(robots[0]))
    for i in range(len(robots)):
        put_episode(batch, i, draw(scenario, nominal(params), np.random.default_rng(3)))
    stepper.observe()
    stepper.actions[:] = np.random.default_rng(4).uniform(-0.1, 0.1, 15)
    for _ in range(ticks):
        stepper.step()
    return np.hstack([batch.p, batch.v, batch.obs, batch.signals])


def test_a_batch_of_different_plants_is_each_of_them_alone():
    plants = [robot_of(), robot_of(*ANOTHER), robot_of("object.inertia=2")]
    together, alone = run(plants), [run([plant])[0] for plant in plants]
    np.testing.assert_array_equal(together, alone)
    assert len({row.tobytes() for row in together}) == len(plants)


@pytest.mark.parametrize("overrides", [["object=null"], ["panel.elements=4"], ["simulation.integrator=rk4"]])
def test_a_robot_of_another_structure_is_refused(overrides):
    fleet = make_fleet(robot_of(), 2)
    before = fleet.numbers.copy()
    with pytest.raises(ValueError, match="as many links, kept modes"):
        put_plant(fleet, 1, robot_of(*overrides))
    np.testing.assert_array_equal(fleet.numbers, before)


def test_a_robot_is_packed_again_only_where_it_changes(monkeypatch):
    """A reset draws faults and plants again and packs those alone; afterwards the environment is as if it never had."""
    packed = []
    put = Structures.__setitem__
    monkeypatch.setattr(Structures, "__setitem__", lambda self, i, item: packed.append(item) or put(self, i, item))
    env, fresh = single.SFFRFlexEnv("impulse"), single.SFFRFlexEnv("impulse")
    for scenario, builds in (("impulse", 0), ("noise", 0), ("mismatch", 1), ("degraded", 2), ("impulse", 3)):
        env.reset(seed=1, options={"scenario": scenario})
        assert len(packed) == builds, scenario
    assert env.reset(seed=2)[0].tolist() == fresh.reset(seed=2)[0].tolist()
    assert env.step(np.full(15, 0.1))[0].tolist() == fresh.step(np.full(15, 0.1))[0].tolist()
    assert len(packed) == 3
