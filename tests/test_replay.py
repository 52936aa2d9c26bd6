"""What the report's replay is told of the robot, put together as the page does."""

import numpy as np
import pytest

from sffr_baselines import make_policy
from sffr_baselines.rollout import rollout
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.kinematics import rotation
from sffr_gym.physics.model import pack
from sffr_gym.task.reference import desired
from sffr_gym.task.signals import ERROR, VIBRATION
from sffr_workbench.evaluation.recording import Recording
from sffr_workbench.report.replay import columns_of, robot_data
from sffr_workbench.report.spectrum import spectrum


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


def test_panels_are_drawn_from_root_to_tip(recording):
    """In metres along each panel's own axis; a length is the panel's."""
    panels, plant = robot_data(recording)["panels"], recording.plant
    for panel, mount, own in zip(panels, plant.panel.mounts, plant.panel.each, strict=True):
        assert panel["name"] == mount.name and panel["root"] == list(mount.root)
        np.testing.assert_allclose(panel["axis"], [np.cos(mount.angle), np.sin(mount.angle)], atol=1e-15)
        assert panel["length"] == own.length and (panel["x"][0], panel["x"][-1]) == (0.0, own.length)
        assert (np.diff(panel["x"]) > 0.0).all()


def test_the_path_is_drawn_once_around(recording):
    """From where it begins to where it ends, a circle of 15 m in 110.9 s."""
    path = robot_data(recording)["path"]
    assert path["span"] == pytest.approx(110.88, abs=0.005)
    want = desired(recording.reference, 0.0)
    for end in path["points"][0], path["points"][-1]:
        np.testing.assert_allclose(end, [want.x, want.y], rtol=0, atol=1e-4)
    np.testing.assert_allclose(path["centre"], [want.x, want.y + 15.0], rtol=0, atol=0.01)
    distances = np.hypot(*(np.array(path["points"]) - path["centre"]).T)
    np.testing.assert_allclose(distances, 15.0, rtol=0, atol=0.01)
    assert path["radius"] == pytest.approx(15.0, abs=0.01)


@pytest.mark.parametrize(("array", "faces"), [("generalized", 1), ("patches", 2), ("tip", 2)])
def test_piezos_have_the_faces_of_their_array(recording, array, faces):
    """A generalised one is drawn once, bonded pairs on both faces."""
    plant = recording.plant.with_overrides(f"actuators.piezo.array={array}")
    assert robot_data(Recording(**vars(recording) | {"plant": plant}))["faces"] == faces


def test_columns_are_what_was_recorded(recording):
    """Each with its numbers in a row; swing is the tips' deflection beyond that of the quasi-static shape."""
    model, rows = pack(recording.plant), len(recording.t)
    columns = columns_of(recording, model)
    n_p, n_m = model.omega2.shape
    widths = {name: block.shape[1] for name, block in columns.items() if len(block) == rows}
    assert widths == {
        "base": 3, "joints": 6, "object": 3, "modes": n_p * n_m, "rest": n_p * n_m, "volts": 6, "thrust": 3,
        "grasp": 4, "tips": n_p, "swing": n_p, "error": 1, "energy": 1, "damping": n_p,
    }  # fmt: skip
    np.testing.assert_array_equal(
        np.hstack([columns[name] for name in ("base", "joints", "modes", "object")]), recording.p
    )
    np.testing.assert_array_equal(columns["error"][:, 0], recording.signals[:, ERROR])
    np.testing.assert_array_equal(columns["energy"][:, 0], recording.signals[:, VIBRATION])
    np.testing.assert_array_equal(np.hstack([columns["volts"], columns["thrust"]]), recording.applied[:, :9])
    np.testing.assert_array_equal(columns["grasp"], -recording.grasp.reshape(rows, 4))


def test_spectrum_begins_at_its_resolution(recording):
    """The lowest frequency is that of Welch's window, 1 / 60 s; the highest lies below 20 Hz."""
    for seconds, period, lowest, highest in (
        (30.0, 0.002, 1 / 30, 20.0),
        (90.0, 0.01, 1 / 60, 20.0),
        (90.0, 0.05, 1 / 60, 10.0),
    ):
        t = np.arange(0.0, seconds, period)
        changes = {"period": period, "tips": np.sin(t)[:, None]}
        f = spectrum(Recording(**vars(recording) | changes))["f"]
        assert f[0] == pytest.approx(lowest, rel=1e-3) and 0.97 * highest < f[-1] <= highest
