"""Feed-forward of the panels' reaction: with it, the whole robot moves as the law asks, not its rigid part alone."""

import numpy as np
import pytest
from commanded import Commanded
from grasping_robots import ROBOTS
from observer import Observer, bent, command_of

from sffr_baselines.laws import LawPolicy, make_law
from sffr_baselines.policies import make_policy
from sffr_baselines.rollout import result_of, rollout
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.simulator import Simulator

ON = "control.feedforward=true"
RIGID_AXIS = "panel.axial_cut=1.0e-3"  # no axial mode is left, as the law supposes
SLANTED = "panel.mounts=[{name: only, root: [0.3, -0.7], angle: 2.1}]"
ROBOTS = ROBOTS | {"one slanted panel": lambda: ROBOTS["paper"]().with_overrides(SLANTED)}
WIDE = ["actuators.thruster_force=1.0e+6", "actuators.thruster_torque=1.0e+6", "actuators.joint_torque=1.0e+6"]


@pytest.mark.parametrize("law", ["none", "ahsc", "lqr"])
@pytest.mark.parametrize("array", ["generalized", "patches"])
@pytest.mark.parametrize("name", ["paper", "yawed, tangent", "no object", "one slanted panel"])
def test_the_whole_robot_gets_the_commanded_acceleration(name, array, law):
    """Whatever the panels do, base and object of the simulator move as Eqs. 9 and 12 ask for."""
    params = ROBOTS[name]().with_overrides(RIGID_AXIS, f"actuators.piezo.array={array}", *WIDE)
    observer, p, v = bent(params, seed=3)
    wanted = Commanded(observer, p, v, 0)
    errors = {}
    for feedforward in "true", "false":
        other = params.with_overrides(f"control.feedforward={feedforward}")
        simulator = Simulator(other)
        command = command_of(law, Observer(other), p, v)
        qdd, _, xdd = simulator.acceleration(simulator.unflatten(0.0, p, v), **command)
        errors[feedforward] = np.abs(qdd[:3] - wanted.base).max()
        if feedforward == "true" and wanted.object is not None:
            np.testing.assert_allclose(xdd, wanted.object, rtol=0, atol=1e-9)
    assert errors["true"] < 1e-9 < 1e-2 < errors["false"]


def test_volts_beyond_the_limits_count_as_they_act():
    """What the limits cut off does not reach the panels, and the base need not hold against it."""
    weak = ["actuators.piezo.force=0.01", "actuators.piezo.moment=0.01"]
    params = ROBOTS["paper"]().with_overrides(RIGID_AXIS, ON, *weak, *WIDE)
    observer, p, v = bent(params, seed=4)
    command, simulator = command_of("hsc", observer, p, v), Simulator(params)
    assert np.abs(command["piezo_volts"]).max() > 2.0 * params.actuators.piezo.voltage
    qdd, _, _ = simulator.acceleration(simulator.unflatten(0.0, p, v), **command)
    np.testing.assert_allclose(qdd[:3], Commanded(observer, p, v, 0).base, rtol=0, atol=1e-9)


def test_the_papers_laws_have_none():
    for name in "none", "hsc", "ahsc", "ahsc-filtered", "hsc-tuned", "lqr":
        assert not make_policy(name, ROBOTS["paper"]()).law.reaction.active
    assert make_policy("ahsc-ff", ROBOTS["paper"]()).law.reaction.active


@pytest.mark.parametrize(
    ("plant", "largest"),
    [([], 10e-9), (["panel.elements=4"], 0.2e-6)],
    ids=["as believed", "4 elements"],
)
def test_the_object_is_carried_along_the_circle(plant, largest):
    """Over the whole circle, within nanometres; a plant of more elements costs 0.1 micrometres."""
    env = SFFRFlexEnv(overrides=plant)
    errors = {
        name: result_of(rollout(env, LawPolicy(name, make_law(name, env.params)), 0)).measures["track_rmse"]
        for name in ("ahsc", "ahsc-ff", "lqr-ff")
    }
    assert errors["ahsc-ff"] < largest and errors["lqr-ff"] < largest
    assert errors["ahsc"] > 3e-6
