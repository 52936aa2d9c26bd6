"""What would run for ever or eat the machine is refused at the start, with what it would cost and what to change."""

import time

import numpy as np
import pytest

from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv
from sffr_baselines.policies import make_policy
from sffr_baselines.rollout import rollout
from sffr_gym import ConfigError, load_params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.model import MOST_STEPS, pack, steps_in
from sffr_gym.task.scenario import load_scenario
from sffr_workbench.benchmark import Plan
from sffr_workbench.benchmark.tuning import tune_law
from sffr_workbench.evaluation import evaluate
from sffr_workbench.figures.animation import MovieOptions, animate

ENVIRONMENTS = {
    "single": SFFRFlexDampingEnv,
    "batched": lambda **arguments: SFFRFlexDampingVectorEnv(2, **arguments),
}


@pytest.fixture(autouse=True)
def at_once():
    """Each of these is refused in no time, and nothing has run then."""
    begun = time.perf_counter()
    yield
    assert time.perf_counter() - begun < 10.0


@pytest.mark.parametrize("kind", ENVIRONMENTS)
@pytest.mark.parametrize(
    ("argument", "value"),
    [
        *(("duration", value) for value in (-1.0, 0.0, 1e-300, np.nan, np.inf, 1e15, True, "30")),
        *(("rho", value) for value in (0.5, 0.0, -10.0, np.nan, np.inf, 1e300, True)),
        *(("agent_period", value) for value in (0.0, -0.1, 0.003, 100.0, 1e300, np.nan, np.inf, "0.1")),
        *(("base_tolerance", value) for value in (0.0, -1.0, 1e-300, np.nan, np.inf)),
        ("law", "ppf"),
    ],
)
def test_arguments_of_the_damping_environment_have_ranges(kind, argument, value):
    """They are refused by name at the construction."""
    with pytest.raises(ConfigError, match=rf"\b{argument} = "):
        ENVIRONMENTS[kind](**{argument: value})


@pytest.mark.parametrize("value", [np.float64(2.0), np.float32(2.0), 2, np.int64(2)])
def test_numbers_of_numpy_are_durations(value):
    """As Python's are."""
    env = SFFRFlexDampingEnv(duration=value)
    env.reset(seed=0)
    assert env.ticks == 1000


def test_an_episode_without_an_end_is_refused_at_the_construction():
    """Once around a circle as large as an orbit takes for ever."""
    with pytest.raises(
        ConfigError, match=r"^nominal: duration: an episode of 7.39e\+06 s, once along a circle, .* 4e\+09 control"
    ):
        SFFRFlexDampingEnv("nominal", overrides=["path.radius=1.0e6"], duration=None)
    SFFRFlexDampingEnv("nominal", overrides=["path.radius=1.0e6"])


@pytest.mark.parametrize("radius", [1.0e5, 1.0e6])
def test_a_straight_line_needs_a_duration(radius, user_scenario):
    """The memory or the time that it would take is said; with a duration it works."""
    overrides = [f"path.radius={radius}"]
    with pytest.raises(
        ConfigError, match=r"^nominal: duration: an episode of .*(GiB of memory|control periods), at most"
    ):
        evaluate(["hsc"], overrides=overrides)
    env = SFFRFlexEnv(user_scenario(duration=0.01), overrides=overrides)
    assert len(rollout(env, make_policy("random", env), 0).signals) == 5


def test_memory_of_an_episode_has_an_end(user_scenario):
    """However the length comes about."""
    env = SFFRFlexEnv(user_scenario(duration=1.0e5))
    with pytest.raises(ConfigError, match=r"5e\+07 control periods, would take .* GiB of memory, at most 2"):
        rollout(env, make_policy("none", env), 0)


@pytest.mark.parametrize(
    "changes",
    [
        ["simulation.max_step=1.0e-6", "control.period=5.0e-3", "simulation.integrator=rk4", "panel.elements=64",
         "panel.axial_cut=1.0e9", "panel.EI=1.0e12", "panel.bending_cut=1.0e9"],
        ["panel.strain_rate_damping=0", "panel.elements=64", "panel.axial_cut=1.0e9", "panel.E=1.0e13", "panel.area=1",
         "panel.mass=1.0e-4"],
    ],
)  # fmt: skip
def test_steps_of_a_control_period_have_an_end(params, changes):
    """Stiff panels of many elements take so many steps that nothing would move."""
    with pytest.raises(ConfigError, match=r"control.period = .*: would take about .* integration steps of .* at most"):
        pack(params.with_overrides(*changes))


def test_the_shortest_step_is_within_reach(params):
    """A thousand times shorter than the shipped one is slow, and not refused."""
    model = pack(params.with_overrides("simulation.max_step=2.0e-6"))
    assert steps_in(model, params.control.period) == 1000 < MOST_STEPS


def test_the_search_for_a_stable_staggered_step_has_an_end(params):
    """It grows with the third power of the modes."""
    fine = ["simulation.coupling=staggered", "panel.elements=64", "panel.axial_cut=1.0e9", "panel.bending_cut=1.0e9"]
    with pytest.raises(ConfigError, match=r"staggered: the panels have 384 modes, .* at most 100; take exact"):
        pack(params.with_overrides(*fine))


@pytest.mark.parametrize("episodes", [0, -1, 10**12, True, 2.0, "2"])
def test_numbers_of_episodes_have_ranges(episodes):
    """In every function that takes one."""
    params = load_params()
    for run in (
        lambda: evaluate(["hsc"], episodes=episodes),
        lambda: Plan(("ahsc",), ("nominal",), episodes, 1_000_000, params),
        lambda: tune_law("hsc-tuned", params, episodes=episodes),
    ):
        with pytest.raises(ConfigError, match=r"^argument: episodes = .*: must be "):
            run()


@pytest.mark.parametrize("seed", [-1, 2**32, True, 1.0, None])
def test_seeds_have_a_range(seed, tmp_path):
    """What every generator takes."""
    for run in (
        lambda: evaluate(["hsc"], seed=seed),
        lambda: animate(["hsc"], tmp_path / "a.gif", seed=seed),
        lambda: Plan(("ahsc",), ("nominal",), 1, seed, load_params()),
    ):
        with pytest.raises(ConfigError, match=r"^argument: seed = "):
            run()


def test_a_benchmark_has_an_end():
    """Every episode leaves a file."""
    policies = ("none", "hsc", "ahsc", "lqr")
    with pytest.raises(ConfigError, match=r"of 4 policies in 3 scenarios make 1.2e\+06 episodes, at most 1e\+06"):
        Plan(policies, ("nominal", "excited", "fast"), 100_000, 1_000_000, load_params())


def test_a_moving_picture_has_an_end(tmp_path):
    """Hours of drawing are refused before the episode runs."""
    with pytest.raises(ConfigError, match=r"duration = 110.88 s: makes 2.2e\+05 pictures, at most 11111"):
        animate(["hsc"], tmp_path / "a.gif", options=MovieOptions(speed=0.01))


def test_the_length_of_a_scenario_has_an_end(params, user_scenario):
    """A day at the shortest control period is refused, a second is not."""
    fast = params.with_overrides("control.period=1.0e-6")
    assert load_scenario(user_scenario(duration=1.0)).ticks(fast) == 1_000_000
    assert load_scenario(user_scenario(duration=1.0e-6)).ticks(params) == 1
    with pytest.raises(ConfigError, match=r"mine: duration: .* 9e\+10 control periods, at most 1e\+09"):
        load_scenario(user_scenario(duration=86_400.0)).ticks(fast)
