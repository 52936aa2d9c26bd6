"""Figures: the geometry that they draw, and that every picture shows what it is to show."""

import io

import numpy as np
import pytest

from sffr_baselines.rollout import STRIDE
from sffr_gym.physics.beam import N_TIP
from sffr_gym.physics.kinematics import grasp_points, modal_tip_deflections, rotation, tip_deflections
from sffr_gym.physics.model import mode_slice, nodal, object_slice
from sffr_gym.render.geometry import arm_line, in_base_axes, panel_line
from sffr_gym.task.quasi_static import quasi_static_at
from sffr_gym.task.signals import ERROR, TIP, VIBRATION
from sffr_workbench.evaluation import FIGURE_FILES, evaluate
from sffr_workbench.figures.episode import _range, damping, draw_episode_figures, figure_data, forces, panels, tracking
from sffr_workbench.figures.robot import path_figure
from sffr_workbench.figures.style import POLICY_COLOURS

mpl = pytest.importorskip("matplotlib")
from matplotlib.colors import to_rgb  # noqa: E402
from matplotlib.image import imread  # noqa: E402

SCENARIO = """
name: short
description: A short episode with swinging panels, off the path and turned.
duration: 2.0
panel_modes: [{mode: 1, amplitude: [0.05, 0.25]}, {mode: 2, amplitude: [0.0, 0.01]}]
offset_position: 0.1
offset_angle: 0.05
"""


def run(folder, policies, *overrides):
    """Evaluate policies on one short episode."""
    file = folder / "short.yaml"
    file.write_text(SCENARIO)
    return evaluate(policies, str(file), episodes=1, overrides=overrides)


@pytest.fixture(scope="module")
def evaluation(tmp_path_factory):
    """Three policies; panels of two elements, the path turning."""
    overrides = "panel.elements=2", "path.heading=tangent", "path.radius=8"
    return run(tmp_path_factory.mktemp("scenario"), ["none", "hsc", "ahsc"], *overrides)


@pytest.fixture(scope="module")
def data(evaluation):
    """The same for the painters."""
    return figure_data(evaluation.first)


@pytest.fixture(scope="module")
def pictures(evaluation):
    """The contents of the files, by name."""
    return draw_episode_figures(evaluation.first)


def share(picture, colour):
    """Share of a picture's pixels that have a colour."""
    return np.mean(np.all(np.abs(picture[..., :3] - to_rgb(colour)) < 0.02, axis=-1))


def test_every_figure_is_there_and_not_blank(pictures):
    assert list(pictures) == list(FIGURE_FILES)
    for content in pictures.values():
        picture = imread(io.BytesIO(content))
        height, width = picture.shape[:2]
        assert width >= 1200 and height >= 500
        assert 0.01 < np.mean(picture[..., :3].min(axis=-1) < 0.9) < 0.5  # ink


@pytest.mark.parametrize("name", ["tracking.png", "panels.png", "forces.png"])
def test_every_policy_shows_in_its_colour(pictures, name):
    picture = imread(io.BytesIO(pictures[name]))
    assert all(share(picture, POLICY_COLOURS[policy]) > 1e-4 for policy in ("none", "hsc", "ahsc"))


def test_damping_shows_only_policies_that_have_one(data):
    for axes in damping(data).axes:
        assert [line.get_label() for line in axes.get_lines()] == ["hsc", "ahsc"]
    lines = damping(data).axes[1].get_lines()  # of q5, right panel
    np.testing.assert_array_equal(lines[1].get_ydata(), data.trajectories["ahsc"].B_hat[:, 1, 1])


def test_panels_side_by_side_share_a_range_that_shows_both(data):
    for axes in damping(data).axes:
        low, high = axes.get_ylim()
        assert all(low < line.get_ydata().min() and line.get_ydata().max() < high for line in axes.get_lines())


def test_no_damping_figure_without_damping(tmp_path, monkeypatch):
    monkeypatch.setattr("sffr_workbench.figures.style.png", lambda figure: b"")  # which ones there are, is asked
    none = run(tmp_path, ["none"])
    assert damping(figure_data(none.first)) is None
    assert list(draw_episode_figures(none.first)) == [name for name in FIGURE_FILES if name != "damping.png"]


def test_drawn_arms_hold_the_object(evaluation, data):
    for p in evaluation.first["ahsc"].p[::10]:
        points = grasp_points(data.model, p[object_slice(data.model)])
        for point, arm in zip(points, data.model.grasp_arm, strict=True):
            np.testing.assert_allclose(arm_line(data.model, p, arm)[-1], point, atol=1e-7)


def test_drawn_panel_ends_at_its_tip_coordinates(evaluation, data):
    trajectory, model = evaluation.first["none"], data.model
    row = len(trajectory.p) // 2
    p = trajectory.p[row]
    axial, transverse, _ = np.moveaxis(nodal(model, p[mode_slice(model)])[:, -N_TIP:], 0, 1)
    assert np.abs(transverse).min() > 1e-3
    np.testing.assert_allclose(tip_deflections(model, trajectory.p)[row], transverse, rtol=1e-12)
    for i, (angle, factor) in enumerate([(np.pi / 2, 1.0), (-np.pi / 2, 5.0)]):
        line = panel_line(model, data.params, p, i, factor)
        local = (line - p[:2]) @ rotation(p[2]) - model.panel_root[i]
        tip = rotation(angle).T @ local[-1]
        np.testing.assert_allclose(tip, [data.params.panel.length + axial[i], factor * transverse[i]], atol=1e-12)
        np.testing.assert_allclose(local[0], 0.0, atol=1e-12)


def test_base_axes_keep_the_robot_together(evaluation, data):
    p = evaluation.first["ahsc"].p[-1]
    seen = in_base_axes(data.model, p)
    assert not seen[:3].any()
    tip = arm_line(data.model, seen, data.model.grasp_arm[0])[-1]
    np.testing.assert_allclose(tip, grasp_points(data.model, seen[object_slice(data.model)])[0], atol=1e-7)


def test_quasi_static_shape_is_that_of_the_measure(evaluation, data):
    """The shape about which the panels swing is that of the vibration's energy, and its tips are dashed."""
    model = data.model
    (dashed,) = (line for line in panels(data).axes[0].get_lines() if line.get_label() == "quasi-static")
    for trajectory in evaluation.first.values():
        at, still = mode_slice(model), quasi_static_at(model, trajectory.reference, trajectory.t)
        np.testing.assert_array_equal(dashed.get_ydata(), modal_tip_deflections(model, still)[:, 0])
        deflection = trajectory.p[:, at].reshape(still.shape) - still
        rate = trajectory.v[:, at].reshape(deflection.shape)
        energy = 0.5 * (rate**2 + model.omega2 * deflection**2)[:, :, model.n_axial :].sum(axis=(1, 2))
        ticks = np.arange(STRIDE, len(trajectory.signals), STRIDE) - 1  # a signal is that of the period's end
        np.testing.assert_allclose(energy[1:], trajectory.signals[ticks, VIBRATION], rtol=1e-9)


def test_tracking_shows_the_measured_error(evaluation, data):
    axes = tracking(data).axes[0]
    lines = {line.get_label(): line for line in axes.get_lines()}
    for policy, trajectory in evaluation.first.items():
        ticks = np.arange(STRIDE, len(trajectory.signals), STRIDE) - 1
        np.testing.assert_allclose(lines[policy].get_ydata()[1:], trajectory.signals[ticks, ERROR], rtol=1e-6)


def test_forces_have_their_limits_in_writing_and_all_of_their_curve(data):
    figure = forces(data)
    titles = [axes.get_title(loc="right") for axes in figure.axes]
    assert titles.count("limit \u00b1100 N") == 2
    assert titles.count("limit \u00b1100 N m") == 1
    assert titles.count("limit \u00b17 N m") == 6
    assert titles.count("limit \u00b1200 V") == 6
    for axes in figure.axes:
        low, high = axes.get_ylim()
        assert all(low <= line.get_ydata().min() and line.get_ydata().max() <= high for line in axes.get_lines())
    shown = [axes for axes in figure.axes if axes.get_title(loc="left") == "arm1 joint 2 [N m]"]
    trajectory = data.trajectories["none"]
    np.testing.assert_array_equal(shown[0].get_lines()[0].get_ydata(), trajectory.applied[:, 10])


def test_peak_of_a_moment_does_not_squash_the_rest():
    wave = np.sin(np.linspace(0.0, 6.0, 2000))
    low, high = _range(np.append(wave, -100.0))
    assert -1.2 < low < -0.9 and 0.9 < high < 1.2
    low, high = _range(np.append(wave, -3.0))
    assert low < -3.0
    low, high = _range(np.zeros(10))
    assert low < 0.0 < high


def test_policy_that_fails_does_not_squash_the_others(tmp_path):
    both = run(tmp_path, ["hsc", "random"], "limits.position=0.5", "limits.tip=0.15")
    assert both.first["random"].failure and not both.first["hsc"].failure
    (axes,) = (
        each
        for each in forces(figure_data(both.first)).axes
        if each.get_title(loc="left") == "left piezo transverse [V]"
    )
    volts = {policy: np.abs(trajectory.applied[:, 1]).max() for policy, trajectory in both.first.items()}
    assert volts["hsc"] < axes.get_ylim()[1] < 2.0 * volts["hsc"] < volts["random"]


def test_a_path_that_crosses_itself_shows_one_robot_with_both_times(tmp_path):
    (tmp_path / "eight.yaml").write_text(
        "{name: eight, description: A test's., robot: [path.kind=figure-eight, path.radius=10]}"
    )
    first = evaluate(["hsc"], str(tmp_path / "eight.yaml"), episodes=1).first
    figure = path_figure(first["hsc"], (data := figure_data(first)).model, data.params)
    times = [text.get_text().count(" s") for text in figure.axes[0].texts]
    assert sorted(times) == [1] * 6 + [2]


def test_robot_without_an_object_or_arms_is_drawn(tmp_path):
    free = run(tmp_path, ["hsc"], "object=null", "arms=[]", "initial.q=[0, 0, 0]", "initial.qd=[0.85, 0, 0]")
    data = figure_data(free.first)
    figure = path_figure(free.first["hsc"], data.model, data.params)
    texts = {text.get_text() for text in figure.axes[1].texts}
    assert {"base", "left panel", "right panel"} <= texts and "object" not in texts
    assert len(draw_episode_figures(free.first)) == len(FIGURE_FILES)


def episode_of(folder, text, policies=("none",)):
    """Evaluate policies on one episode of a scenario."""
    file = folder / "mine.yaml"
    file.write_text(f"{{name: mine, description: A test's., duration: 0.5, {text}}}")
    return figure_data(evaluate(policies, str(file), episodes=1).first)


def test_tracking_shows_the_truth_and_not_what_noisy_sensors_saw(tmp_path):
    """The lines are the magnitudes of the true errors, a thousand times smaller than the noise here."""
    data = episode_of(tmp_path, "sensors: {position: 1.0e-2}")
    figure, trajectory = tracking(data), data.trajectories["none"]
    shown = figure.axes[0].get_lines()[0].get_ydata()
    true = trajectory.signals[STRIDE - 1 :: STRIDE, ERROR]  # after each period that a recorded one follows
    np.testing.assert_allclose(shown[1 : len(true) + 1], true[: len(shown) - 1], rtol=0, atol=1e-14)
    seen = np.linalg.norm(trajectory.obs[:, trajectory.fields["object_error"].slice], axis=1)
    assert seen.mean() > 1e-2 > shown.max()


def test_figures_show_the_robot_of_the_episode(tmp_path):
    """Quasi-static shape, tips and limits are those of the drawn plant and its fault, not of the parameters."""
    data = episode_of(tmp_path, "plant: {EI: [0.5, 0.5]}, faults: [{actuators: thruster, remaining: 0.25}]")
    trajectory = data.trajectories["none"]
    assert data.params.panel.EI == 10.0
    np.testing.assert_array_equal(data.limit[6:9], [25.0, 25.0, 25.0])
    titles = [axes.get_title("right") for axes in forces(data).axes]
    assert "limit \u00b125 N" in titles and "limit \u00b17 N m" in titles
    bends = np.abs(tip_deflections(data.model, trajectory.p)).max(axis=1)
    measured = trajectory.signals[STRIDE - 1 :: STRIDE, TIP]
    np.testing.assert_allclose(bends[1:], measured[: len(bends) - 1], rtol=0, atol=1e-14)
