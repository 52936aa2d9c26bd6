"""Figures and animations: of an episode under several policies, of learning, and how all figures look.

matplotlib and the encoders are imported where they are used, so that everything else runs without them.
"""

from sffr_workbench.figures.animation import MovieOptions, animate
from sffr_workbench.figures.episode import draw_episode_figures
from sffr_workbench.figures.learning import by_algorithm, learning_curves, read_curve, schedule_figure
from sffr_workbench.figures.robot import path_figure
from sffr_workbench.figures.style import load_matplotlib, policy_colours, save_figures

__all__ = [
    "MovieOptions", "animate", "by_algorithm", "draw_episode_figures", "learning_curves", "load_matplotlib",
    "path_figure", "policy_colours", "read_curve", "save_figures", "schedule_figure",
]  # fmt: skip
