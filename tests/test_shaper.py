"""Input shaping: impulses that cancel the believed panels' vibration, and a law that follows the shaped path."""

from __future__ import annotations

import numpy as np
import pytest

from sffr_baselines import make_policy
from sffr_baselines.laws import SHAPERS
from sffr_baselines.rollout import result_of, rollout
from sffr_baselines.shaper import shaped_pieces, shaper_impulses
from sffr_gym import ConfigError, load_params
from sffr_gym.config.path import N_PIECE
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.initial import initial_positions
from sffr_gym.physics.model import pack
from sffr_gym.task.reference import Desired, desired, path_reference
from sffr_gym.task.scenario import Scenario, load_scenario
from sffr_gym.task.signals import ERROR, TIP

OMEGA = 0.65829  # rad/s, the clamped panel's first mode
LINE = ["path.kind=line", "path.displacement=[3, 0]", "path.time=18", "initial.qfd=[0, 0, 0]", "initial.q.2=1.2"]
LONG = Scenario(name="move", description="a move and what is left", duration=50.0)


def residual(times, shares, omega, damping=0.0):
    """Residual vibration after impulses, of that after a single one at their end (Singer and Seering, Eq. 4)."""
    damped = omega * np.sqrt(1.0 - damping**2)
    decay = np.exp(-damping * omega * (times[-1] - times)) * shares
    return np.hypot(decay @ np.cos(damped * times), decay @ np.sin(damped * times))


@pytest.mark.parametrize("damping", [0.0, 0.05])
@pytest.mark.parametrize(("kind", "count"), [("zv", 2), ("zvd", 3)])
def test_nothing_is_left_of_the_design_frequencies(kind, count, damping):
    """Of one, and of two at once, damped or not; the shares add up to 1."""
    for omega in [OMEGA], [OMEGA, 6.4859]:
        times, shares = shaper_impulses(kind, np.array(omega), np.full(len(omega), damping))
        assert len(times) == 2 ** (len(omega) * (count - 1))
        assert shares.sum() == pytest.approx(1.0) and shares.min() > 0.0 and times[0] == 0.0
        assert times[-1] == pytest.approx(sum((count - 1) * np.pi / (w * np.sqrt(1 - damping**2)) for w in omega))
        for each in omega:
            assert residual(times, shares, each, damping) < 1e-12


@pytest.mark.parametrize(("kind", "width"), [("zv", 0.0637), ("zvd", 0.2871)])
def test_insensitivity_is_the_known_one(kind, width):
    """Widths of 5 % residual vibration over the frequency: 4/pi asin(0.05), and of its root for ZVD."""
    times, shares = shaper_impulses(kind, np.array([OMEGA]), np.zeros(1))
    ratios = np.linspace(0.7, 1.3, 6001)
    calm = [residual(times, shares, ratio * OMEGA) < 0.05 for ratio in ratios]
    assert calm[3000] and np.mean(calm) * 0.6 == pytest.approx(width, abs=3e-4)


def test_the_convolution_is_exact():
    """At any time the sum of the shifted and weighted paths."""
    params = load_params().with_overrides("path.kind=slew", "path.displacement=[3, -1]", "path.time=4")
    model = pack(params)
    reference = path_reference(params, model, initial_positions(params, model)[0])
    times, shares = np.array([0.0, 1.3, 4.0, 7.7]), np.array([0.1, 0.2, 0.3, 0.4])
    pieces = shaped_pieces(reference.pieces.reshape(-1, N_PIECE), times, shares)
    shaped, rest = reference._replace(pieces=pieces.ravel()), Desired(reference.x0, reference.y0, *[0.0] * 10)
    for t in np.linspace(0.01, 14.0, 57):
        now = [desired(reference, t - late) if t > late else rest for late in times]
        for name in ("x", "y", "xd", "xdd", "yddd", "heading", "turn", "turn_acceleration"):
            whole = sum(share * getattr(each, name) for share, each in zip(shares, now, strict=True))
            assert getattr(desired(shaped, t), name) == pytest.approx(whole, abs=1e-11), (name, t)


def tips_after(policy, *changes, scenario=LONG):
    """Largest tip displacement after the arrival, and the object's largest error then [m]."""
    env = SFFRFlexEnv(scenario, overrides=[*LINE, *changes])
    trajectory = rollout(env, make_policy(policy, env), seed=0)
    assert not trajectory.failure
    after = trajectory.signals[9000:]
    return after[:, TIP].max(), after[:, ERROR].max()


@pytest.mark.parametrize("policy", SHAPERS)
def test_the_panels_are_at_rest_when_the_robot_arrives(policy):
    """A linear panel of one element, as believed, without piezos: nothing is left, and the object is in its place."""
    plain, _ = tips_after("none")
    tip, error = tips_after(policy)
    assert plain > 0.1 and tip < 2e-3 * plain and error < 1e-6


def test_a_shaper_can_be_had_with_any_law():
    """control.shaper; the laws that it is not asked of follow the task's path, bit for bit."""
    env = SFFRFlexEnv(LONG, overrides=[*LINE, "control.shaper=zv"])
    shaped = rollout(env, make_policy("ahsc", env), seed=0)
    assert shaped.signals[:9000, ERROR].max() > 1e-3 > shaped.signals[9000:, ERROR].max()
    bare = SFFRFlexEnv("nominal", overrides=["control.shaper=zvd"])
    assert make_policy("ahsc", bare).law.shaped.pieces.size == 0  # a circle has no arrival


def test_stepping_and_the_compiled_loop_agree():
    """The law knows the time by the number of its calls."""
    env = SFFRFlexEnv("slew")
    policy = make_policy("shaped", env)
    compiled = rollout(env, policy, seed=1)
    obs, _ = env.reset(seed=1)
    policy.reset()
    for _ in range(400):
        obs, *_, info = env.step(policy(obs))
    assert info["object_error"] == compiled.signals[399, ERROR] > 0.0


def test_a_move_that_is_too_short_for_its_shaper_is_refused():
    """With the time that it takes."""
    with pytest.raises(ConfigError, match=r"control\.shaper = 'zvd': takes 10\.5 s"):
        make_policy("shaped", load_params().with_overrides(*LINE, "path.time=11"))


def test_shaping_leaves_less_than_virtual_damping_on_slew():
    """What the scenario is for: without a volt on the piezos."""
    env, tips = SFFRFlexEnv("slew"), {}
    for name in "none", "ahsc", "shaped":
        found = [result_of(rollout(env, make_policy(name, env), seed)).measures for seed in range(4)]
        tips[name] = np.mean([measures["residual_tip"] for measures in found])
        assert name != "shaped" or not any(measures["piezo_effort"] for measures in found)
    assert tips["shaped"] < 0.5 * min(tips["none"], tips["ahsc"])
    assert load_scenario("slew").duration == 60.0
