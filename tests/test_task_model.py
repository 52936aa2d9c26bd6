"""Task models: which plant an episode has, and how its numbers lie in memory."""

import numpy as np
import pytest

from sffr_gym import ConfigError
from sffr_gym.compile.workspace import Integers
from sffr_gym.task.episode import draw, nominal
from sffr_gym.task.reference import flat_reference
from sffr_gym.task.scenario import load_scenario
from sffr_gym.task.task_model import make_task_model, nominal_plant, plant_of, task_shapes, task_sizes

ROBOTS = {
    "paper": [],
    "three elements, waypoints": ["panel.elements=3", "path.kind=waypoints"],
    "nothing": ["object=null", "arms=[]", "panel.mounts=[]", "initial.q=[0, 0, 0]", "initial.qd=[0.85, 0, 0]"],
    "patches": ["actuators.piezo.array=patches"],
}


def leaves(tree):
    """Return the leaves of a nested named tuple, those of arrays by their shape."""
    if isinstance(tree, tuple) and hasattr(tree, "_fields") and not isinstance(tree, Integers):
        return [leaf for part in tree for leaf in leaves(part)]
    return [tree]


@pytest.mark.parametrize("robot", ROBOTS)
def test_shapes_are_those_of_the_model(params, robot):
    """Every array has the described shape; whole numbers are described as such."""
    task = make_task_model(params.with_overrides(*ROBOTS[robot]))
    shapes, arrays = leaves(task_shapes(task_sizes(task))), leaves(task)
    assert len(shapes) == len(arrays) > 60
    for shape, array in zip(shapes, arrays, strict=True):
        whole = isinstance(shape, Integers)
        assert np.shape(array) == (shape.shape if whole else shape)
        assert not whole or np.asarray(array).dtype.kind in "biu"


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_reference_has_the_numbers_that_the_model_says(params, robot):
    given = params.with_overrides(*ROBOTS[robot])
    episode = draw(load_scenario("nominal"), nominal(given), np.random.default_rng(0))
    assert make_task_model(given).reference == len(flat_reference(episode.reference))


@pytest.mark.parametrize("settings", [[], ["panel.EI=15.0"]])
@pytest.mark.parametrize(
    ("changes", "rebuilt", "left"),
    [
        ({}, False, 1.0),
        ({"faults": [{"actuators": "thruster", "remaining": 0.5}]}, False, 0.5),
        ({"plant": {"object": [2.0, 2.0]}}, True, 1.0),
    ],
)
def test_a_plant_is_made_anew_only_if_something_of_it_was_drawn(params, settings, changes, rebuilt, left):
    """Else it is the scenario's; a fault leaves a part of the limits, and an action asks for what it always does."""
    plant = changes.get("plant", {}) | {"settings": settings}
    scenario = load_scenario("nominal").with_changes(**changes | {"plant": plant})
    known, prior = nominal(params, scenario), make_task_model(params)
    base = nominal_plant(prior, known)
    assert (base is prior) == (not settings)
    found = plant_of(base, known, draw(scenario, known, np.random.default_rng(0)))
    assert (found is base) == (not changes)
    assert (found.model is base.model) == (not rebuilt)
    assert found.model.object_mass == (2.0 if rebuilt else 1.0) * params.object.mass
    np.testing.assert_array_equal(found.scale, prior.scale)
    np.testing.assert_array_equal(found.bound, prior.bound)
    np.testing.assert_array_equal(found.actuators.limit[6:9], left * prior.actuators.limit[6:9])
    np.testing.assert_array_equal(found.actuators.limit[9:], prior.actuators.limit[9:])


@pytest.mark.parametrize("setting", ["control.period=0.001", "actuators.piezo.array=patches"])
def test_plants_that_controllers_cannot_act_on_are_refused(params, setting):
    scenario = load_scenario("nominal").with_changes(plant={"settings": [setting]})
    with pytest.raises(ConfigError, match="the control period that its controllers believe in"):
        nominal_plant(make_task_model(params), nominal(params, scenario))
