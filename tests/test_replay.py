"""What the report's replay is told of the robot, put together as the page does."""

import base64

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
from sffr_workbench.report.replay import columns_of, policy_data, robot_data
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


def test_the_path_is_drawn_in_even_steps_to_a_tenth_of_a_millimetre(recording):
    """A point for each degree of a circle, and the first one again."""
    path = robot_data(recording)["path"]
    points = np.array(path["points"])
    assert points.shape == (361, 2)
    turned = points - path["centre"]
    angles = np.unwrap(np.arctan2(turned[:, 1], turned[:, 0]))
    np.testing.assert_allclose(np.diff(angles), np.deg2rad(1.0), rtol=0, atol=1e-4)
    in_tenths = 1e4 * points
    np.testing.assert_allclose(in_tenths, np.round(in_tenths), rtol=0, atol=1e-6)
    assert np.abs(in_tenths - 10.0 * np.round(0.1 * in_tenths)).max() > 1.0


def test_shapes_are_given_at_both_ends_of_32_parts_to_nine_digits(recording):
    """For a smooth line, without more than it takes."""
    for panel in robot_data(recording)["panels"]:
        shapes, n_m = np.array(panel["shapes"]), pack(recording.plant).omega2.shape[1]
        assert shapes.shape == (33, n_m) and len(panel["x"]) == 33
        digits = 1e9 * shapes
        np.testing.assert_allclose(digits, np.round(digits), rtol=0, atol=1e-6)
        assert np.abs(digits - 10.0 * np.round(0.1 * digits)).max() > 1.0


def test_arms_know_where_their_joints_begin(recording):
    """All joints belong to one arm each."""
    arms = robot_data(recording)["arms"]
    firsts = np.cumsum([0, *(len(arm["links"]) for arm in arms)]).tolist()
    assert [arm["first"] for arm in arms] == firsts[:-1] and firsts[-1] == 6


def test_a_policys_table_has_its_columns_side_by_side(recording):
    """As the page reads them: single precision, row by row, at the places that the layout names."""
    data, model = policy_data("ahsc", recording, "#102030"), pack(recording.plant)
    table = np.frombuffer(base64.b64decode(data["table"]), "<f4").reshape(data["rows"], data["width"])
    columns, end = columns_of(recording, model), 0
    assert list(data["layout"]) == list(columns)
    for name, (start, width) in data["layout"].items():
        np.testing.assert_allclose(table[:, start : start + width], columns[name], rtol=1e-6)
        assert start == end
        end += width
    assert end == data["width"] and data["rows"] == len(recording.t)
    assert data["step"] == pytest.approx(recording.t[1]) and (data["name"], data["colour"]) == ("ahsc", "#102030")


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
