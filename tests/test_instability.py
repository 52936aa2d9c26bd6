"""Episodes that became unstable although nothing left its range: from both sides, and what tables say of them."""

import numpy as np
import pytest

from sffr_baselines import make_policy
from sffr_baselines.rollout import result_of, rollout
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.metrics import instability, instability_of, last_ticks
from sffr_gym.task.signals import N_SIGNALS, SAT_JOINT, SAT_PIEZO, SAT_THRUST, VIBRATION
from sffr_gym.task.status import LIMIT_CYCLE, REASONS
from sffr_workbench.evaluation import evaluate, summary_remarks

FAST_MODES = ["panel.elements=4", "panel.bending_cut=1.0e+9"]  # which a law sampled every 2 ms feeds


def signals(busy, energy, group=SAT_PIEZO):
    """Signals of 1000 periods: in the last quarter a share of a group at its limits, and so much of the energy left."""
    made = np.zeros((1000, N_SIGNALS))
    made[:, VIBRATION] = 1.0
    made[750:, VIBRATION], made[750:, group] = energy, busy
    return made


@pytest.mark.parametrize("group", [SAT_PIEZO, SAT_THRUST, SAT_JOINT])
@pytest.mark.parametrize(
    ("busy", "energy", "unstable"), [(0.26, 0.06, True), (0.24, 0.9, False), (1.0, 0.04, False), (0.0, 1.0, False)]
)
def test_both_saturation_and_swinging_are_needed(group, busy, energy, unstable):
    assert instability(signals(busy, energy, group), 0.1) == (REASONS[LIMIT_CYCLE] if unstable else "")


@pytest.mark.parametrize("largest", [1.0, 8.0, 2.0**-20])
def test_both_ends_count_as_stable(largest):
    """A quarter of a group and 5 % of the energy, whatever that is, are not more than that; 2 s are enough to tell."""
    mean = np.zeros(N_SIGNALS)
    for busy, energy, ticks, unstable in (
        (0.25, 1.0, 1000, False), (np.nextafter(0.25, 1.0), 1.0, 1000, True), (1.0, 0.05, 1000, False),
        (1.0, np.nextafter(0.05, 1.0), 1000, True), (1.0, 1.0, 1000, True), (1.0, 1.0, 999, False),
    ):  # fmt: skip
        mean[[SAT_THRUST, VIBRATION]] = busy, energy * largest
        assert bool(instability_of(mean, ticks, largest, 2.0e-3)) == unstable


@pytest.mark.parametrize(("ticks", "last"), [(1, 1), (3, 1), (4, 1), (7, 1), (8, 2), (11, 2), (400, 100)])
def test_the_last_part_of_a_short_episode_is_a_quarter_of_it_or_a_period(ticks, last):
    assert last_ticks(ticks) == last


def test_what_happened_earlier_does_not_count():
    made = signals(0.0, 0.001)
    made[:700, SAT_PIEZO] = 1.0
    assert instability(made, 0.1) == ""


def test_a_short_episode_cannot_tell():
    made = signals(1.0, 1.0)
    assert instability(made, 0.0079) == "" != instability(made, 0.0081)


@pytest.mark.filterwarnings("ignore:.*is unstable")
def test_a_limit_cycle_is_a_failure(user_scenario):
    """AHSC feeds fast modes at full voltage and stays in its range; none and lqr on the same plant are well."""
    env = SFFRFlexEnv(user_scenario(duration=8.0), overrides=FAST_MODES)
    found = {name: result_of(rollout(env, make_policy(name, env), 0)) for name in ("none", "ahsc", "lqr")}
    assert found["ahsc"].failure == REASONS[LIMIT_CYCLE] and found["ahsc"].measures["failed"] == 1.0
    assert not found["none"].failure and not found["lqr"].failure


@pytest.mark.parametrize("scenario", ["patches", "weak", "thrust", "degraded"])
def test_weak_actuators_that_calm_the_panels_are_no_failure(scenario):
    env = SFFRFlexEnv(scenario)
    for name in "ahsc", "lqr-ff":
        assert not result_of(rollout(env, make_policy(name, env), 1)).failure


@pytest.mark.filterwarnings("ignore:.*is unstable")
def test_a_table_says_that_its_reference_failed(user_scenario):
    evaluation = evaluate(["ahsc", "lqr"], user_scenario(duration=8.0), overrides=FAST_MODES)
    remarks = summary_remarks(evaluation)
    assert "ahsc itself failed, so that ratios to it say little" in remarks
    assert any(remark.startswith("ahsc failed in 1 of 1: unstable") for remark in remarks)
