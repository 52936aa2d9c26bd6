"""Figures of scores: whatever the number of policies and scenarios, all that is written lies in the picture."""

import numpy as np
import pytest

from sffr_gym.task.metrics import MEASURES
from sffr_gym.task.score import Result
from sffr_workbench.benchmark.figures import differences, intervals, profiles, tradeoff
from sffr_workbench.benchmark.scores import score_suite
from sffr_workbench.figures.style import drawing

pytest.importorskip("matplotlib")
from matplotlib.backends.backend_agg import FigureCanvasAgg

NAMES = ("ahsc", "hsc", "lqr", *(f"rho{rho}-price{price}" for rho in (3, 10, 30) for price in range(6)))


def scores(policies, scenarios):
    """Scores of policies with measures around AHSC's, on four episodes of each scenario."""
    rng = np.random.default_rng(0)
    return score_suite([
        Result(f"scenario{m}", policy, seed, dict.fromkeys(MEASURES, 1.0 + rng.uniform(-0.5, 0.3)), "", {})
        for m in range(scenarios)
        for policy in policies
        for seed in range(4)
    ])  # fmt: skip


@pytest.mark.parametrize("count", [1, 8, len(NAMES)])
@pytest.mark.parametrize("scenarios", [1, 15])
@pytest.mark.parametrize("paint", [intervals, profiles, differences, tradeoff])
def test_nothing_is_cut_off(paint, scenarios, count):
    with drawing():
        figure = paint(scores(NAMES[:count], scenarios))
        renderer = FigureCanvasAgg(figure).get_renderer()
        figure.draw_without_rendering()  # lays everything out, and colours no pixel
        whole = figure.bbox.padded(1.0)
        legends = [text for legend in figure.legends for text in legend.get_texts()]
        texts = [*figure.texts, *legends, *(axes.title for axes in figure.axes if axes.get_visible())]
        corners = {text.get_text(): text.get_window_extent(renderer).corners() for text in texts}
    outside = {text for text, points in corners.items() if not all(whole.contains(*point) for point in points)}
    assert not outside and corners.keys() & {"scenario0", "all scenarios", *NAMES}
    assert figure.get_figwidth() <= 30.0


def test_policies_of_one_colour_have_markers_of_their_own():
    (axes,) = tradeoff(scores(NAMES, 1)).axes
    drawn = [(line.get_color(), line.get_marker()) for line in axes.lines if line.get_marker() != "None"]
    assert len(drawn) == len(set(drawn)) == len(NAMES)
