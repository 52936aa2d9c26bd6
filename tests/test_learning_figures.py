"""Learning curves over seeds, and the picture of what a schedule does."""

import numpy as np
import pytest
from small_training import small
from typer.testing import CliRunner

from sffr_agents.train import train
from sffr_baselines.damping_env import SFFRFlexDampingEnv
from sffr_baselines.laws import make_law
from sffr_baselines.learned import LearnedSchedule, Network, save_schedule
from sffr_baselines.schedule import FEATURES, N_FEATURES
from sffr_gym import ConfigError, load_params
from sffr_workbench.cli.app import app
from sffr_workbench.figures.learning import Curve, by_algorithm, learning_curves, read_curve, schedule_figure

STEP = 0.1 * make_law("ahsc", load_params()).schedule.omega[0, 0]  # rad, of the first mode from action to action


def curve(seed, steps=(100.0, 200.0), algo="ppo", ratio=0.5):
    steps = np.array(steps)
    return Curve(algo, seed, steps, 0.1 * steps, {"excited": np.full(len(steps), ratio)})


@pytest.fixture
def phased():
    """Damps q5 most where the panel is fastest, and q6 where it is bent most."""
    names = [name for name, _ in FEATURES]
    first = np.zeros((4, N_FEATURES))
    for row, (name, sign) in enumerate(
        [(name, sign) for name in ("mode1_rate", "mode1_displacement") for sign in (1, -1)]
    ):
        first[row, names.index(name)] = sign
    second = np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0]])  # of rectified halves: the magnitude
    network = Network((first, second), (np.zeros(4), np.zeros(2)), relu=True, squash=False)
    return LearnedSchedule.of(network, SFFRFlexDampingEnv(), {})


def test_curves_are_those_of_the_trainings(tmp_path):
    folders = [tmp_path / str(seed) for seed in (0, 1)]
    scores = [train(small("ppo"), seed, folder) for seed, folder in enumerate(folders)]
    curves = [read_curve(folder) for folder in folders]
    assert [each.seed for each in curves] == [0, 1]
    for own, best in zip(curves, scores, strict=True):
        assert own.steps.tolist() == [160.0, 224.0]
        assert best["nominal/vibration"] in own.vibration["nominal"]
    result = CliRunner().invoke(app, ["curves", *map(str, folders), "-o", str(tmp_path / "curves.png")])
    assert result.exit_code == 0 and "ppo, seeds 0, 1, 224 steps" in result.output
    assert (tmp_path / "curves.png").stat().st_size > 10_000


def test_unfinished_trainings_are_cut_to_the_shortest():
    groups = by_algorithm([curve(0), curve(1, (100.0, 200.0, 300.0)), curve(0, (50.0,), "sac")])
    assert [len(own.steps) for own in groups["ppo"]] == [2, 2]
    assert len(learning_curves(groups).axes) == 2


@pytest.mark.parametrize(
    ("curves", "message"),
    [([curve(0), curve(0)], "seed 0 is given twice"), ([curve(0), curve(1, (100.0, 250.0))], "at other steps")],
)
def test_what_cannot_be_compared_is_rejected(curves, message):
    with pytest.raises(ConfigError, match=message):
        by_algorithm(curves)


def test_schedule_is_drawn_against_the_phase(phased):
    figure = schedule_figure(phased, load_params())
    for axes, fastest in zip(figure.axes[:2], (True, False), strict=True):
        for line in axes.lines[:4]:
            phase, factor = np.radians(line.get_xdata()), np.log10(line.get_ydata())
            np.testing.assert_allclose(factor, np.abs(np.sin(phase) if fastest else np.cos(phase)), atol=1e-6)


@pytest.mark.parametrize(
    ("name", "age", "shown"),
    [
        ("mode1_potential_less_kinetic", 0, lambda phase: np.cos(phase) ** 2 - np.sin(phase) ** 2),
        ("mode1_displacement_by_rate", 0, lambda phase: -2.0 * np.cos(phase) * np.sin(phase)),
        ("mode1_displacement", 3, lambda phase: np.cos(phase - 3 * STEP)),
        ("mode1_rate", 1, lambda phase: -np.sin(phase - STEP)),
        ("base_error", 0, lambda phase: np.full_like(phase, -1.0)),
        ("piezo_demand", 2, lambda phase: np.full_like(phase, -1.0)),
    ],
)
def test_a_schedule_is_shown_what_it_would_see_of_a_swing(name, age, shown):
    """Products of the coordinates too, a base on its path, actuators that rest, and the same swing earlier on."""
    weights = np.zeros((2, 4, N_FEATURES))
    bound = dict(FEATURES)[name]
    weights[:, age, [each for each, _ in FEATURES].index(name)] = 1.0 / bound
    network = Network((weights.reshape(2, -1),), (np.zeros(2),), relu=False, squash=False)
    schedule = LearnedSchedule.of(network, SFFRFlexDampingEnv(stack_size=4), {})
    line = schedule_figure(schedule, load_params()).axes[0].lines[0]
    np.testing.assert_allclose(np.log10(line.get_ydata()), shown(np.radians(line.get_xdata())), atol=1e-6)


def test_phase_command_takes_files_of_policies_alone(phased, tmp_path):
    save_schedule(tmp_path / "mine.npz", phased)
    runner = CliRunner()
    assert runner.invoke(app, ["phase", str(tmp_path / "mine.npz"), "-o", str(tmp_path / "a" / "p.png")]).exit_code == 0
    assert (tmp_path / "a" / "p.png").stat().st_size > 10_000
    result = runner.invoke(app, ["phase", "ahsc"])
    assert result.exit_code == 2 and "neither a shipped learned policy nor" in result.output
