"""Plants whose numerical structure differs from the prior's: drawn and run in a batch as in single environments."""

import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv

from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.task.scenario import PlantFactors, Scenario, scenario_names

WIDE = Scenario(
    name="wide", description="far from what is believed", duration=0.1,
    plant=PlantFactors(EI=(0.05, 20.0), panel_mass=(0.1, 10.0), link_mass=(0.5, 2.0), object=(0.5, 2.0)),
)  # fmt: skip
SETTINGS = {
    "classical": ["simulation.integrator=rk4"],
    "many modes": ["panel.elements=8", "panel.bending_cut=120.0"],
    "undamped": ["panel.strain_rate_damping=0.0"],
    "undamped, many": ["panel.strain_rate_damping=0.0", "panel.elements=4", "panel.bending_cut=200.0"],
    "long steps": ["simulation.max_step=1.0e-2", "panel.elements=4", "control.period=0.006"],
}


@pytest.mark.parametrize("name", SETTINGS)
def test_a_batch_of_any_plants_is_each_of_them_alone(name):
    """Steps in a period and stiff modes are those of each plant, bit for bit those of the single environment."""
    n, arguments = 6, {"scenario": WIDE, "overrides": SETTINGS[name]}
    batch = SFFRFlexVectorEnv(n, **arguments)
    loop = SyncVectorEnv([lambda: SFFRFlexEnv(**arguments)] * n)
    kinds = set()
    for seed in (0, 100):
        np.testing.assert_array_equal(batch.reset(seed=seed)[0], loop.reset(seed=seed)[0])
        tasks = batch.get_attr("plant_task")
        kinds |= {(int(task.steps), len(task.model.stiff.omega)) for task in tasks}
        assert kinds >= {(task.steps, len(task.model.stiff.omega)) for task in loop.get_attr("plant_task")}
        for action in np.random.default_rng(seed).uniform(-0.05, 0.05, (3, n, 15)):
            for left, right in zip(batch.step(action)[:4], loop.step(action)[:4], strict=True):
                np.testing.assert_array_equal(left, right)
    assert len(kinds) > 1, "the plants should differ in structure"


def test_a_law_inside_runs_on_any_plants():
    """The same with a decision for many periods."""
    light = WIDE.model_copy(update={"plant": PlantFactors(panel_mass=(0.1, 2.0))})
    arguments = {"scenario": light, "overrides": SETTINGS["classical"], "duration": 0.2, "random_phase": False}
    batch = SFFRFlexDampingVectorEnv(4, **arguments)
    loop = SyncVectorEnv([lambda: SFFRFlexDampingEnv(**arguments)] * 4)
    np.testing.assert_array_equal(batch.reset(seed=3)[0], loop.reset(seed=3)[0])
    assert len({int(task.steps) for task in batch.get_attr("plant_task")}) > 1
    action = np.zeros((4, 4))
    for left, right in zip(batch.step(action)[:4], loop.step(action)[:4], strict=True):
        np.testing.assert_array_equal(left, right)


STARTS = [
    ("offset", "limits.position=0.02", "limits.position: bounds base_error to 0.02"),
    ("offset", "limits.position=0.15", "limits.position: bounds base_error to 0.15"),
    ("excited", "limits.rate=0.1", "limits.rate: bounds elastic_rate to 0.1"),
    ("fast", "limits.velocity=1.0", "limits.velocity: bounds reference_velocity to 1"),
]


@pytest.mark.parametrize("kind", [SFFRFlexEnv, SFFRFlexVectorEnv, SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv])
@pytest.mark.parametrize(("scenario", "limit", "message"), STARTS)
def test_starts_outside_of_the_space_are_refused_at_once(kind, scenario, limit, message):
    """At construction and at a reset into the scenario; the message names key, field and what is reached."""
    with pytest.raises(
        ConfigError, match=rf"{message} .*scenario '{scenario}' exceeds with 0|{message} .*exceeds with 1"
    ):
        kind(scenario=scenario, overrides=[limit])


def test_a_reset_into_a_scenario_that_does_not_fit_changes_nothing():
    """The environment goes on in its old one."""
    env = SFFRFlexVectorEnv(2, overrides=["limits.position=0.02"])
    before = env.reset(seed=0)[0]
    with pytest.raises(ConfigError, match=r"limits\.position: bounds"):
        env.reset(seed=1, options={"scenario": "offset"})
    assert env.scenario.name == "nominal" and env.np_random_seed == (0, 1)
    np.testing.assert_array_equal(env.reset(seed=0)[0], before)


@pytest.mark.parametrize("name", scenario_names())
@pytest.mark.parametrize("kind", [SFFRFlexVectorEnv, SFFRFlexDampingVectorEnv])
def test_every_start_lies_in_the_space(kind, name):
    """Of all shipped scenarios, many of them."""
    env = kind(50, scenario=name)
    for seed in (0, 1000):
        assert env.reset(seed=seed)[0] in env.observation_space


@pytest.mark.parametrize("kind", [SFFRFlexEnv, SFFRFlexVectorEnv])
def test_a_rare_start_outside_is_shown_on_its_bound_and_ends_the_episode(kind, monkeypatch):
    """A training does not die of what the looked-at draws did not reach."""
    monkeypatch.setattr("sffr_gym.envs.base.check_starts", lambda *_: None)
    env = kind(scenario="fast", overrides=["limits.velocity=1.0"])
    ends = set()
    for seed in range(6):
        obs = env.reset(seed=seed)[0]
        assert obs in env.observation_space
        ended = bool(np.all(env.step(np.zeros(env.action_space.shape))[2]))
        assert ended == bool((obs[..., env.fields["reference_velocity"].slice] == 1.0).any())
        ends.add(ended)
    assert ends == {True, False}


@pytest.mark.parametrize("kind", [SFFRFlexEnv, SFFRFlexVectorEnv])
def test_a_scenario_that_the_robot_cannot_have_is_refused_at_once(kind, user_scenario):
    """Modes, objects and panels that are not there."""
    mode = user_scenario(panel_modes=[{"mode": 9, "amplitude": [0.1, 0.2]}])
    for scenario, overrides, message in (
        (mode, [], "mode 9 is not there"),
        ("payload", ["object=null"], "carries no object"),
        ("degraded", ["panel.mounts=[]"], "no panel whose piezos"),
    ):
        with pytest.raises(ConfigError, match=message):
            kind(scenario=scenario, overrides=overrides)
