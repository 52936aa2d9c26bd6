"""The reward: bounded in every period, and never more for an episode that fails than for one that goes on."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sffr_baselines import make_policy
from sffr_baselines.damping_env import SFFRFlexDampingEnv
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.reward import REWARDS, Weights, period_cost, reward_terms, reward_weights, tolerance
from sffr_gym.task.signals import ERROR, N_SIGNALS, PIEZO, SAT_JOINT, SAT_PIEZO, SAT_THRUST, VIBRATION
from sffr_gym.task.status import RUNNING, TIP_RANGE

N_PIEZOS, N_ACTIONS, LONGEST = 6, 15, 4000
POLICIES = {
    "all at +1": lambda rng: np.ones(N_ACTIONS),
    "all at -1": lambda rng: -np.ones(N_ACTIONS),
    "joints": lambda rng: np.r_[np.zeros(9), np.ones(6)],
    "piezos": lambda rng: np.r_[np.ones(N_PIEZOS), np.zeros(9)],
    "turning": lambda rng: np.r_[np.zeros(8), 1.0, np.zeros(6)],
    "random": lambda rng: rng.uniform(-1.0, 1.0, N_ACTIONS),
    "bang": lambda rng: rng.choice([-1.0, 1.0], N_ACTIONS),
}


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("scenario", ["nominal", "excited", "offset"])
def test_a_failure_pays_less_than_going_on_for_any_time(policy, scenario):
    """An episode earns more with every period; the one in which it fails, which anything else would do, gives none."""
    env, rng = SFFRFlexEnv(scenario), np.random.default_rng(3)
    law, (obs, _) = make_policy("ahsc", env), env.reset(seed=2)
    for _ in range(LONGEST):
        before, seen = env.get_state(), obs
        obs, reward, failed, _, info = env.step(POLICIES[policy](rng))
        assert sum(info[f"reward_{name}"] for name in REWARDS) == pytest.approx(reward)
        if failed:
            break
        assert 0.0 < reward <= 1.0
    assert failed or policy in ("piezos", "turning", "random")
    if not failed:
        return
    assert reward == 0.0
    env.set_state(before)
    _, instead, lost, *_ = env.step(law(seen))
    assert lost or 0.0 < instead <= 1.0


def test_terms_are_bounded_and_fall_at_any_size():
    """Each in (0, weight], strictly falling from nothing to 1e150 scales, with a slope for each factor of ten."""
    sizes = np.r_[0.0, np.logspace(-12, 150, 163)]
    values = np.array([tolerance(x) for x in sizes])
    assert values[0] == 1.0 and (values > 0.0).all() and (np.diff(values) < 0.0).all()
    assert tolerance(math.e - 1.0) == pytest.approx(0.5)
    weights, terms = Weights(0.35, 0.60, 0.05, 1e-10, 5e-3, 100.0), np.zeros(len(REWARDS))
    signals = np.zeros(N_SIGNALS)
    assert reward_terms(weights, signals, RUNNING, terms) == pytest.approx(1.0) and terms.tolist() == [0.35, 0.6, 0.05]
    signals[[ERROR, VIBRATION, PIEZO]] = 1e-5, 5e-3, 100.0
    half = 1.0 / (1.0 + math.log(2.0))
    assert reward_terms(weights, signals, RUNNING, terms) == pytest.approx(half)
    assert reward_terms(weights, signals, TIP_RANGE, terms) == 0.0 and not terms.any()


def test_weights_and_scales_are_those_of_the_configuration(params):
    """A term is half where its measure is its scale, whose square the squared measures are compared with."""
    keys = {"tracking.weight": 2.0, "vibration.weight": 3.0, "effort.weight": 4.0}
    keys |= {"tracking.scale": 1e-3, "vibration.scale": 0.03, "effort.scale": 5.0}
    given = params.with_overrides(*(f"reward.{key}={value}" for key, value in keys.items()))
    assert reward_weights(given) == pytest.approx((2.0, 3.0, 4.0, 1e-6, 0.03, 25.0))
    signals, terms = np.zeros(N_SIGNALS), np.zeros(len(REWARDS))
    signals[[ERROR, VIBRATION, PIEZO]] = 1e-3, 0.03, 25.0
    assert reward_terms(reward_weights(given), signals, RUNNING, terms) == pytest.approx(9.0 / (1.0 + math.log(2.0)))


@pytest.mark.parametrize("status", [RUNNING, TIP_RANGE])
@pytest.mark.parametrize("saturated", [None, SAT_PIEZO, SAT_THRUST, SAT_JOINT])
def test_cost_is_one_for_saturation_or_failure(saturated, status):
    """However small the share of a group that is at its limits; anything else costs nothing."""
    signals = np.ones(N_SIGNALS)
    signals[[SAT_PIEZO, SAT_THRUST, SAT_JOINT]] = 0.0
    if saturated is not None:
        signals[saturated] = 0.1
    assert period_cost(signals, status) == float(saturated is not None or status != RUNNING)


def test_the_damping_environment_earns_in_every_step():
    """Its sum over the periods of a step, in [0, 50]."""
    env, rng = SFFRFlexDampingEnv("excited", duration=2.0), np.random.default_rng(0)
    env.reset(seed=0)
    rewards = [env.step(rng.uniform(-1.0, 1.0, 4))[1] for _ in range(20)]
    assert 0.0 < min(rewards) and max(rewards) <= 50.0


def test_doing_nothing_earns_more_than_crashing():
    """As an agent finds out first."""
    env, returns = SFFRFlexEnv(), {}
    for name in ("nothing", "all at +1"):
        env.reset(seed=0)
        action, total, over = np.full(N_ACTIONS, float(name != "nothing")), 0.0, False
        while not over:
            _, reward, terminated, truncated, _ = env.step(action)
            total, over = total + reward, terminated or truncated
        returns[name] = total
    assert returns["nothing"] > 100.0 * returns["all at +1"] > 0.0
