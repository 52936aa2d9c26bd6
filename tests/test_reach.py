"""Inverse kinematics: joint angles that hold the object, by both forms of the key and for poses out of reach."""

import re

import numpy as np
import pytest

from sffr_gym import ConfigError, SFFRFlexEnv, Simulator, load_params
from sffr_gym.physics.kinematics import rotation

BASE_ALONE = ("initial.q=[0.3, -0.2, 0.4]", "initial.qd=null")
THIRD_ARM = (
    "arms.0.links=[{mass: 4, length: 0.6, inertia: 0.2, com: 0.3}, {mass: 3, length: 0.5, inertia: 0.2, com: 0.2}, "
    "{mass: 2, length: 0.3, inertia: 0.1, com: 0.1}]",
)


def tips(plant, state):
    """Return where the grippers are, by adding up links, and where the object wants them."""
    found, wanted, joints = [], [], iter(state.q[3:])
    angles = {arm.name: [next(joints) for _ in arm.links] for arm in plant.params.arms}
    for grasp in plant.params.object.grasps:
        arm = next(arm for arm in plant.params.arms if arm.name == grasp.arm)
        place, direction = state.q[:2] + rotation(state.q[2]) @ arm.mount, state.q[2] + arm.mount_angle
        for link, angle in zip(arm.links, angles[arm.name], strict=True):
            direction += angle
            place = place + link.length * np.array([np.cos(direction), np.sin(direction)])
        found.append(place)
        wanted.append(state.obj[:2] + rotation(state.obj[2]) @ grasp.point)
    return np.array(found), np.array(wanted)


@pytest.mark.parametrize("more", [(), THIRD_ARM], ids=["two links", "three links"])
def test_auto_needs_no_joint_angles(more):
    """With the base alone in ``q`` the arms hold the object, well bent, and the rest of the joints are at zero."""
    plant = Simulator(load_params().with_overrides(*BASE_ALONE, "initial.reach=auto", *more))
    state = plant.initial_state()
    found, wanted = tips(plant, state)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12)
    elbows = [1 + 3, 3 + 3 + len(more)]
    assert (abs(np.sin(state.q[elbows])) > 0.9).all()
    np.testing.assert_array_equal(state.q[-2:], 0.0)
    np.testing.assert_allclose(state.q[:3], [0.3, -0.2, 0.4])


def test_pose_is_kept_in_base_axes():
    pose = np.array([1.3, 0.2, -0.3])
    plant = Simulator(load_params().with_overrides(*BASE_ALONE, f"initial.reach={pose.tolist()}"))
    state, same = plant.initial_state(), plant.reach(pose)
    expected = [*(state.q[:2] + rotation(0.4) @ pose[:2]), 0.4 + pose[2]]
    np.testing.assert_allclose(state.obj, expected, rtol=0, atol=1e-8)
    np.testing.assert_allclose(same.obj, expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(same.q, state.q, rtol=0, atol=1e-8)
    assert plant.constraint_drift(same) < 1e-12
    assert not same.qd.any()


def test_joint_angles_given_are_a_guess():
    """Of both bends the one that is nearer, and the joints of other arms as they are."""
    given = [0.6, 4.2, 5.6, 2.1, 0.4, 0.1]
    plant = Simulator(load_params().with_overrides(f"initial.q={[0, 0, 0, *given]}", "initial.reach=auto"))
    state = plant.initial_state()
    assert np.sin(state.q[4]) < -0.9 and np.sin(state.q[6]) > 0.9
    np.testing.assert_array_equal(state.q[-2:], given[-2:])


def test_out_of_reach_the_nearest_pose_is_told_and_can_be_held():
    plant = Simulator()
    with pytest.raises(ConfigError, match=r"initial\.reach = \[3, 0, 0\].* nearest that can be held is") as error:
        plant.reach([3.0, 0.0, 0.0])
    text = re.search(r"held is \[(.*)\]", str(error.value))
    assert text
    nearest = np.array([float(each) for each in text[1].split(",")])
    # Straight in front both arms end at x with (x - 0.5)^2 + (0.5 - 0.106)^2 = l^2, l short of straight elbows.
    elbow = np.arcsin(3 * 0.02)
    length = abs(1 + np.exp(1j * elbow))
    assert nearest[0] == pytest.approx(0.5 + np.sqrt(length**2 - (0.5 - 0.1060941716362195) ** 2), abs=2e-3)
    plant.reach(nearest)  # as printed


def test_what_cannot_be_held_at_all_is_told():
    far = "object.grasps=[{arm: arm1, point: [0, 9]}, {arm: arm2, point: [0, -9]}]"
    with pytest.raises(ConfigError, match="arm1, arm2 cannot all hold"):
        Simulator(load_params().with_overrides("initial.reach=auto", far)).initial_state()
    with pytest.raises(ConfigError, match="no object"):
        Simulator(load_params().with_overrides("initial.reach=auto", "object=null")).initial_state()
    with pytest.raises(ConfigError, match=r"initial\.reach"):
        load_params().with_overrides("initial.q=[0, 0, 0]")
    with pytest.raises(ValueError, match="pose must have shape"):
        Simulator().reach([1.0, 2.0])
    with pytest.raises(ValueError, match="not finite"):
        Simulator().reach([1.0, 2.0, float("nan")])


def test_an_environment_starts_from_angles_that_were_found():
    env = SFFRFlexEnv(overrides=["initial.q=[0, 0, 0]", "initial.reach=auto"])
    obs, _ = env.reset(seed=0)
    gap = env.fields["tip_error"].slice
    np.testing.assert_allclose(obs[gap], 0.0, atol=1e-12)
    for _ in range(20):
        *_, info = env.step(np.zeros(15))
    assert info["failure"] == 0
