"""Laws on plants: the poles of the closed loop, against closed forms and simulation, and what is warned of."""

import warnings

import numpy as np
import pytest

from sffr_baselines import make_policy
from sffr_baselines.laws import make_law
from sffr_baselines.loop_stability import FASTEST_GROWTH, closed_loop_growth
from sffr_baselines.stability import sampled_growth
from sffr_gym import SFFRFlexEnv, load_params
from sffr_gym.physics.model import mode_slice, pack
from sffr_gym.task.scenario import scenario_names

FAST_MODES = ["panel.elements=4", "panel.bending_cut=1.0e+9"]
UNDAMPED = ["panel.strain_rate_damping=0", "suppression.coordinates=all"]
RIGID = ["panel.mounts=[]", "control.period=2.0e-5"]


def lagging(seconds):
    return f"actuators.lag={{piezo: 0.0, thruster: {seconds}, joint: {seconds}}}"


@pytest.mark.parametrize("lag", [0.4, 1.0])
def test_a_rigid_robot_with_lagging_actuators_grows_as_its_cubic_says(lag):
    """All accelerations come late by one lag c: c eddd + edd + Kd ed + Kp e = 0, unstable from c = Kd / Kp on."""
    plant = load_params().with_overrides(*RIGID, lagging(lag))
    growth = closed_loop_growth(make_law("none", plant), plant)
    control = plant.control
    expected = np.roots([lag, 1.0, control.Kd, control.Kp]).real.max()
    assert expected > 0.0
    assert growth.rate == pytest.approx(expected, abs=0.01)  # the hold is late by half a period
    assert "mode" not in growth.state


def test_less_lag_than_damping_over_stiffness_is_stable():
    plant = load_params().with_overrides(*RIGID, lagging(0.3))
    assert closed_loop_growth(make_law("none", plant), plant).rate < FASTEST_GROWTH


@pytest.mark.parametrize("overrides", [FAST_MODES, UNDAMPED])
def test_on_a_base_that_cannot_move_it_is_the_clamped_panels_growth(overrides):
    plant = load_params().with_overrides(*overrides, "base.mass=1.0e9", "base.inertia=1.0e9", "object=null")
    law = make_law("hsc", plant)
    clamped = float(sampled_growth(pack(plant), law.suppression.B0, law.suppression.damped, 2.0e-3))
    growth = closed_loop_growth(law, plant)
    assert abs(growth.pole) == pytest.approx(clamped, rel=1e-5) and clamped > 1.0
    assert growth.rate == pytest.approx(np.log(clamped) / 2.0e-3, rel=1e-3)
    assert "_mode" in growth.state


def test_the_simulated_loop_grows_as_predicted():
    """The full law on undamped panels, of the free robot with its object: the axial mode, before volts saturate."""
    env = SFFRFlexEnv(
        {"name": "still", "description": "", "duration": 5.0}, overrides=[*UNDAMPED, "initial.qfd=[1e-10, 0, 0]"]
    )
    policy = make_policy_quietly("hsc", env)
    growth = closed_loop_growth(policy.law, env.params)
    obs, _ = env.reset(seed=0)
    axial, speeds = mode_slice(env.prior_task.model).start, []
    for _ in range(165):
        obs = env.step(policy(obs))[0]
        speeds.append(np.log(abs(env.velocities[axial])))
    rate = (max(speeds[140:165]) - max(speeds[90:115])) / (50 * 2.0e-3)
    assert rate == pytest.approx(growth.rate, rel=0.05)


def make_policy_quietly(name, env):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return make_policy(name, env)


def test_a_law_is_warned_of_on_a_plant_that_it_does_not_know(user_scenario):
    """The plant has modes that the believed one has not: which law, where, how fast, and what would help."""
    env = SFFRFlexEnv(user_scenario("fine", plant={"settings": FAST_MODES}))
    told = r"ahsc is unstable on the plant of scenario 'fine': .*_mode\d+.* grow by 4\d\d 1/s .*panel\.bending_cut"
    with pytest.warns(UserWarning, match=told) as warned:
        make_policy("ahsc", env)
    assert len(warned) == 1 and "\n" not in str(warned[0].message)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        make_policy("lqr", env)
        make_policy("ahsc", load_params())


def test_the_ends_of_what_is_drawn_count(user_scenario):
    """Lags up to 2 s; up to 0.1 s nothing is said."""
    with pytest.warns(UserWarning, match=r"none is unstable on a plant that scenario 'slow' draws: .*lag less"):
        make_policy(
            "none", SFFRFlexEnv(user_scenario("slow", plant={"lag": {"thruster": [0.0, 2.0], "joint": [0.0, 2.0]}}))
        )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        make_policy("none", SFFRFlexEnv(user_scenario(plant={"lag": {"thruster": [0.0, 0.1], "joint": [0.0, 0.1]}})))


@pytest.mark.parametrize("name", scenario_names())
def test_no_shipped_scenario_is_unstable_for_a_shipped_law(name):
    env = SFFRFlexEnv(name)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for law in ("none", "ahsc", "hsc-tuned", "lqr", "lqr-ff", "lqr-kf"):
            make_policy(law, env)


def test_a_free_floating_robot_is_no_warning():
    """Nothing holds its base, which drifts and does not grow."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        make_policy("ahsc-ff", load_params().with_overrides("actuators.thrusters=none"))
