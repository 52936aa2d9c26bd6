"""Figures of an episode under several policies: path and robot, tracking, panels, virtual damping, forces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sffr_baselines.rollout import Trajectory, true_observations
from sffr_baselines.suppression import COORDINATES
from sffr_gym.config.params import Params
from sffr_gym.physics.beam import N_TIP
from sffr_gym.physics.kinematics import modal_tip_deflections, tip_deflections
from sffr_gym.physics.model import N_BASE, Model, pack
from sffr_gym.task.quasi_static import quasi_static_at
from sffr_gym.task.score import REFERENCE
from sffr_gym.task.signals import VIBRATION
from sffr_gym.types import Array
from sffr_workbench.evaluation import FIGURE_FILES, actuator_limits
from sffr_workbench.figures.robot import path_figure
from sffr_workbench.figures.style import (
    SHORT,
    align_labels,
    canvas,
    draw_figures,
    legend_columns,
    plain,
    policy_colours,
    title_with_limit,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

START = 40.0  # s, the part of an episode that is shown at large
PEAK = 4.0  # times the usual range: a peak beyond leaves the picture


@dataclass(frozen=True)
class FigureData:
    """What the figures draw."""

    trajectories: Mapping[str, Trajectory]  #: of each policy, all in the same episode
    model: Model  #: the episode's plant
    params: Params
    limit: Array  #: (n_u,) what the actuators can give in it
    colours: Mapping[str, str]  #: of each policy

    def lines(self) -> list[tuple[str, Trajectory, dict[str, Any]]]:
        """Return policy, trajectory and line style; earlier lines are wider, to show below equal ones."""
        thin = {policy for policy, trajectory in self.trajectories.items() if policy == "none" or trajectory.failure}
        widths = iter(np.linspace(2.8, 1.0, max(len(self.trajectories) - len(thin), 2)))
        lines = []
        for policy, trajectory in self.trajectories.items():
            style: dict[str, Any] = {"label": plain(policy), "color": self.colours[policy]}
            style["linewidth"] = 1.1 if policy in thin else next(widths)
            lines.append((policy, trajectory, style | ({"zorder": 1.5} if trajectory.failure else {})))
        return lines


def draw_episode_figures(trajectories: Mapping[str, Trajectory]) -> dict[str, bytes]:
    """Draw a trajectory of each policy, all in the same episode, and return the contents of the PNG files by name.

    Raises:
        ConfigError: see :func:`style.load_matplotlib`.
    """
    painters = dict(zip(FIGURE_FILES, (path, tracking, panels, damping, forces), strict=True))
    return draw_figures(painters, figure_data(trajectories))


def figure_data(trajectories: Mapping[str, Trajectory]) -> FigureData:
    """Collect what the figures need from a trajectory of each policy, all in the same episode."""
    episode = next(iter(trajectories.values())).episode
    colours = policy_colours(trajectories)
    return FigureData(trajectories, pack(episode.plant), episode.plant, actuator_limits(episode), colours)


def path(data: FigureData) -> Figure:
    """Draw the robot on its circle under AHSC if it took part, else under the last policy that did not fail."""
    whole = [trajectory for trajectory in data.trajectories.values() if not trajectory.failure]
    trajectory = data.trajectories.get(REFERENCE, [*data.trajectories.values(), *whole][-1])
    return path_figure(trajectory, data.model, data.params)


def tracking(data: FigureData) -> Figure:
    """Draw the magnitudes of the true position errors and their rates: of object, grippers (together) and base."""
    fields = next(iter(data.trajectories.values())).fields
    kinds = ("object_error", "object"), ("tip_error", "gripper"), ("base_error", "base")
    rows = [
        row
        for field, label in kinds
        for row in ((field, f"{label} error", "m"), (f"{field}_rate", f"{label} rate", "m/s"))
        if fields[field].size
    ]
    figure, axes = _grid(data, len(rows), spans=True)
    truth = {policy: true_observations(trajectory) for policy, trajectory in data.trajectories.items()}
    for (field, label, unit), row in zip(rows, axes, strict=True):
        row[0].set_ylabel(label)
        _logarithmic(row[0], unit)
        for policy, trajectory, style in data.lines():
            values = truth[policy][:, trajectory.fields[field].slice]
            for each in row:
                each.plot(trajectory.t, np.linalg.norm(values, axis=1), **style)
    return _finish(data, figure, axes)


def panels(data: FigureData) -> Figure | None:
    """Draw tip deflections with the quasi-static ones, and the bending energy about the quasi-static shape."""
    mounts = data.params.panel.mounts
    if not mounts:
        return None
    figure, axes = _grid(data, len(mounts) + 1, spans=True)
    for _, trajectory, style in data.lines():
        tips = tip_deflections(data.model, trajectory.p)
        ticks = np.arange(len(trajectory.signals))[:: max(len(trajectory.signals) // 4000, 1)]
        for column in range(axes.shape[1]):
            for i in range(len(mounts)):
                axes[i, column].plot(trajectory.t, tips[:, i], **style)
            energy = trajectory.signals[ticks, VIBRATION]
            axes[-1, column].plot((ticks + 1) * trajectory.period, energy, **style)
    longest = max(data.trajectories.values(), key=lambda trajectory: len(trajectory.t))
    still = modal_tip_deflections(data.model, quasi_static_at(data.model, longest.reference, longest.t))
    for row, mount, i in zip(axes, mounts, range(len(mounts)), strict=False):
        row[0].set_ylabel(f"{plain(mount.name, SHORT)} tip\n[m]")
        for each in row:
            each.plot(longest.t, still[:, i], color="black", linewidth=1.0, linestyle=(0, (4, 2)), label="quasi-static")
    axes[-1, 0].set_ylabel("vibration energy")
    _logarithmic(axes[-1, 0], "J")
    return _finish(data, figure, axes)


def damping(data: FigureData) -> Figure | None:
    """Draw the virtual damping of each panel's tip coordinates, for the policies that have one."""
    lines = [line for line in data.lines() if np.nan_to_num(line[1].B_hat).any()]
    used = [k for k in range(N_TIP) if any(np.nan_to_num(line[1].B_hat[:, :, k]).any() for line in lines)]
    if not used:
        return None
    mounts = data.params.panel.mounts
    figure, axes = _grid(data, len(used), columns=len(mounts))
    for row, k in zip(axes, used, strict=True):
        row[0].set_ylabel(f"$\\hat B$ of {COORDINATES[k]}\n[{('N s/m', 'N s/m', 'N m s/rad')[k]}]")
        for i, each in enumerate(row):
            for _, trajectory, style in lines:
                each.plot(trajectory.t, trajectory.B_hat[:, i, k], **style)
    for each, mount in zip(axes[0], mounts, strict=True):
        each.set_title(f"{plain(mount.name, SHORT)} panel")
    return _finish(data, figure, axes)


def forces(data: FigureData) -> Figure:
    """Draw what each actuator applies."""
    params, limit = data.params, data.limit
    mounts, names = params.panel.mounts, ("axial", "transverse", "slope")
    n_c = (len(limit) - N_BASE - params.n_links) // max(len(mounts), 1)
    piezos = [
        [f"{plain(mount.name, SHORT)} piezo {names[c] if n_c == N_TIP else c + 1}" for c in range(n_c)]
        for mount in mounts
    ]
    at = n_c * len(mounts)
    groups = [
        [(at, "thrust x", "N"), (at + 1, "thrust y", "N"), (at + 2, "thruster torque", "N m")],
        [(at + N_BASE + k, name, "N m") for k, name in enumerate(joint_names(params))],
        *([(i * n_c + c, name, "V") for c, name in enumerate(own)] for i, own in enumerate(piezos)),
    ]
    rows = [group[k : k + 3] for group in groups for k in range(0, len(group), 3)]
    figure, axes = _grid(data, len(rows), columns=3, share=False)
    for row, entries in zip(axes, rows, strict=True):
        for each, (k, name, unit) in zip(row, entries, strict=False):
            title_with_limit(each, name, limit[k], unit)
            for _, trajectory, style in data.lines():
                each.plot(trajectory.t, trajectory.applied[:, k], **style)
            if not any(trajectory.applied[:, k].any() for trajectory in data.trajectories.values()):
                each.text(0.5, 0.6, "not used", transform=each.transAxes, ha="center", color="#777777")
        for each in row[len(entries) :]:
            each.set_axis_off()
    return _finish(data, figure, axes)


def joint_names(params: Params) -> list[str]:
    """Return each joint's arm and number."""
    return [f"{plain(arm.name, SHORT)} joint {k + 1}" for arm in params.arms for k in range(len(arm.links))]


def _grid(data: FigureData, rows: int, columns: int = 1, spans: bool = False, share: bool = True) -> tuple[Figure, Any]:
    """Return axes (rows, columns) over time; ``spans``: the first 40 s in one column, the whole in another."""
    end = max(trajectory.t[-1] for trajectory in data.trajectories.values())
    columns = 2 if spans and end > 1.5 * START else columns
    figure, axes = canvas(rows, columns, 0.8 + 1.45 * rows, sharex="col", sharey="row" if share else False)
    for each in axes.flat:
        each.margins(x=0.0)
    if columns == 2 and spans:
        axes[0, 0].set_xlim(0.0, START)
    return figure, axes


def _logarithmic(axes: Axes, unit: str) -> None:
    """Make the vertical axis logarithmic, in powers of ten of a unit."""
    from matplotlib.ticker import EngFormatter, NullFormatter

    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(EngFormatter(unit))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _finish(data: FigureData, figure: Figure, axes: Any) -> Figure:
    """Choose the ranges, name the time axes and put one legend above everything.

    Policies that failed do not widen the ranges, unless all did.
    """
    failed = {plain(policy) for policy, trajectory in data.trajectories.items() if trajectory.failure}
    failed = set() if len(failed) == len(data.trajectories) else failed
    for each in axes.flat:
        together = each.get_shared_y_axes().get_siblings(each)
        lines = [line for one in together for line in one.get_lines() if line.get_label() not in failed]
        values = np.concatenate([np.zeros(0), *(line.get_ydata() for line in lines)])
        values = values[np.isfinite(values)] if np.isfinite(values).any() else np.zeros(1)
        if each.get_yscale() == "log":
            top = np.max(values, initial=1e-12)
            low = np.quantile(values[values > 0.0], 0.01) if (values > 0.0).any() else top
            each.set_ylim(min(0.5 * low, top / 50.0), 1.6 * top)
        else:
            each.set_ylim(_range(values))
    for column in axes.T:
        lowest = [each for each in column if each.axison][-1]
        lowest.set_xlabel("time [s]")
        lowest.tick_params(labelbottom=True)
    align_labels(figure)
    shown = {line.get_label(): line for line in axes[0, 0].get_lines()}
    columns = legend_columns(list(shown))
    figure.legend(shown.values(), shown.keys(), loc="outside upper center", ncols=columns)
    return figure


def _range(values: Array) -> tuple[float, float]:
    """Return the range of a linear axis: all values, except a short peak that would squash the rest, and a margin."""
    low, high = values.min(), values.max()
    most = np.quantile(values, [0.003, 0.997])
    if high - low > PEAK * (most[1] - most[0]) > 0.0:
        low, high = most
    air = 0.06 * (high - low) or 1.0
    return low - air, high + air
