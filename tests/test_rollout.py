"""Rollouts one by one and many at once, what they record, and what they would take."""

import numpy as np
import pytest

from sffr_baselines import make_policy
from sffr_baselines.rollout import result_of, rollout, rollouts, true_observations
from sffr_gym import ConfigError, SFFRFlexEnv
from sffr_gym.task.scenario import load_scenario


@pytest.mark.parametrize("name", ["ahsc", "random", "ahsc-oracle"])
def test_rollouts_are_those_of_each_seed(user_scenario, name):
    """To the last bit, in order; each tells of every control period once."""
    scenario = user_scenario(duration=0.014, panel_modes=[{"mode": 1, "amplitude": [0.1, 0.2]}])
    env, done = SFFRFlexEnv(scenario), []
    policy = make_policy(name, env)
    found = list(rollouts(env, policy, [3, 5], done.append, stride=2))
    assert sum(done) == 2 * 7 and [each.seed for each in found] == [3, 5]
    for each in found:
        alone = rollout(env, policy, each.seed, stride=2)
        for field in ("t", "p", "v", "obs", "applied", "signals", "tips"):
            np.testing.assert_array_equal(getattr(each, field), getattr(alone, field))
    assert not np.array_equal(found[0].p, found[1].p)


def test_states_are_recorded_every_so_many_periods(user_scenario):
    """The first row is the first control period's start; signals and tips are of every period."""
    env = SFFRFlexEnv(user_scenario(duration=0.014))
    trajectory = rollout(env, make_policy("ahsc", env), 0, stride=3)
    np.testing.assert_allclose(trajectory.t, [0.0, 0.006, 0.012], rtol=1e-12)
    assert len(trajectory.signals) == len(trajectory.tips) == 7 and len(trajectory.p) == len(trajectory.obs) == 3
    assert (trajectory.policy, trajectory.period, trajectory.failure) == ("ahsc", 0.002, "")
    np.testing.assert_allclose(true_observations(trajectory), trajectory.obs, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("duration", "there"), [(0.02, False), (0.022, True), (0.018, False)])
def test_there_is_a_residual_swing_only_after_an_arrival(duration, there):
    """Not of an episode that ends with it."""
    line = ["path.kind=line", "path.time=0.02", "path.displacement=[1.0e-6, 0.0]"]
    env = SFFRFlexEnv(load_scenario("nominal").with_changes(duration=duration, robot=line))
    measures = result_of(rollout(env, make_policy("none", env), 0)).measures
    assert ("residual_tip" in measures) == there and measures["duration"] == pytest.approx(duration)


def test_memory_is_that_of_the_arrays(user_scenario):
    """14 numbers of 8 bytes a control period and 116 every 25: 149 bytes, 6.9 GiB in a hundred thousand seconds."""
    env = SFFRFlexEnv(user_scenario(duration=1.0e5))
    with pytest.raises(
        ConfigError, match=r"an episode of 1e\+05 s, 5e\+07 control periods, would take 6\.9\d GiB .* at most 2: "
    ):
        rollout(env, make_policy("none", env), 0)


@pytest.mark.parametrize("stride", [0, -1, 1.5, True, "2"])
def test_a_stride_is_a_number_of_control_periods(stride):
    env = SFFRFlexEnv()
    with pytest.raises(ValueError, match="stride must be a whole number of control periods, at least 1, got"):
        rollout(env, make_policy("none", env), 0, stride=stride)


OWN = """
from sffr_baselines import ControlLaw

class Law(ControlLaw):
    def reset(self, params, simulator, seed):
        self.seed = seed

    def __call__(self, obs):
        if self.seed > 1000:
            raise ArithmeticError("it ran")
        return 1e-3 * (self.seed % 7) * obs[:15]
"""


@pytest.fixture
def own(tmp_path):
    """The name of a law of one's own that is another one for each seed, and fails above 1000."""
    (tmp_path / "mine.py").write_text(OWN, encoding="utf-8")
    return f"{tmp_path / 'mine.py'}:Law"


def test_laws_of_ones_own_run_in_groups_as_alone(own, user_scenario):
    """Any number of episodes, in their order; periods are told once, of all together."""
    env, done = SFFRFlexEnv(user_scenario(duration=0.004, panel_modes=[{"mode": 1, "amplitude": [0.1, 0.2]}])), []
    policy, seeds = make_policy(own, env), [*range(40, 58)]
    found = list(rollouts(env, policy, seeds, done.append, stride=1))
    assert [each.seed for each in found] == seeds and sum(done) == 2 * 18
    for each in (found[0], found[15], found[16], found[17]):
        alone = rollout(env, policy, each.seed, stride=1)
        np.testing.assert_array_equal(each.p, alone.p)
        np.testing.assert_array_equal(each.applied, alone.applied)
    assert not np.array_equal(found[1].applied, found[2].applied)
    assert len(list(rollouts(env, policy, seeds[:2]))) == 2  # and nobody has to be told


def test_memory_is_that_of_all_episodes_that_run_side_by_side(own, user_scenario):
    """Of which each would be small enough; nothing has run then."""
    env = SFFRFlexEnv(user_scenario(duration=2.0e4))
    policy = make_policy(own, env)
    with pytest.raises(ConfigError, match=r"an episode of 4e\+04 s, 2e\+07 control periods, would take 2\.7\d GiB"):
        next(rollouts(env, policy, [1001, 1002]))
    with pytest.raises(ConfigError, match="it ran"):
        next(rollouts(env, policy, [1001]))


@pytest.mark.parametrize("change", ["object=null", "actuators.piezo.array=patches"])
def test_a_law_runs_on_the_robot_that_it_was_made_for_alone(change):
    """Another one's observations, or its actuators, are not those that it knows."""
    env, other = SFFRFlexEnv(), SFFRFlexEnv(overrides=[change])
    for own, foreign in ((env, other), (other, env)):
        with pytest.raises(ValueError, match="was made for a robot with other observations or actuators"):
            rollout(own, make_policy("hsc", foreign), 0)


def test_an_unstable_episode_is_a_failure_of_its_own(user_scenario):
    """What ended early keeps its reason; what came to its end has none, but for a limit cycle."""
    env = SFFRFlexEnv(user_scenario(duration=0.4), overrides=["limits.tip=0.003"])
    trajectory = rollout(env, make_policy("none", env), 0)
    assert result_of(trajectory).failure == trajectory.failure != ""
    assert result_of(trajectory).measures["failed"] == 1.0 and len(trajectory.signals) < 200
