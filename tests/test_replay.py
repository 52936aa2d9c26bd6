"""What the report's replay is told of the robot, put together as the page does."""

import numpy as np
import pytest

from sffr_baselines import make_policy
from sffr_baselines.rollout import rollout
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.kinematics import rotation
from sffr_gym.physics.model import pack
from sffr_workbench.evaluation.recording import Recording
from sffr_workbench.report.replay import columns_of, robot_data


@pytest.fixture(scope="module", params=["excited", "truth"])
def recording(request):
    env = SFFRFlexEnv(request.param)
    return Recording.of(rollout(env, make_policy("ahsc", env), 1_000_000))


def test_arms_reach_the_object(recording):
    """Mount, angle, lengths and joint angles, put together as the page does, end at the grasp points."""
    robot, columns = robot_data(recording), columns_of(recording, pack(recording.plant))
    grasping = [arm for arm in robot["arms"] if arm["grasps"]]
    assert len(robot["arms"]) == 4 and len(grasping) == 2
    for row in (0, -1):
        (x, y, yaw), joints, obj = (columns[name][row] for name in ("base", "joints", "object"))
        for arm, grasp in zip(grasping, recording.plant.object.grasps, strict=True):
            mount_x, mount_y, angle = arm["mount"]
            tip = np.array([x, y]) + rotation(yaw) @ [mount_x, mount_y]
            way = yaw + angle
            for k, length in enumerate(arm["links"]):
                way += joints[arm["first"] + k]
                tip += length * np.array([np.cos(way), np.sin(way)])
            np.testing.assert_allclose(tip, obj[:2] + rotation(obj[2]) @ grasp.point, rtol=0, atol=1e-5)
