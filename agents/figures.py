"""Pictures of the first episode of each policy: path and robot, tracking, panels, virtual damping, forces.

matplotlib is imported where it is used, so that everything else runs without it.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from agents.evaluate import Evaluation
from agents.files import write_whole
from agents.robot_figure import path_figure
from agents.run_folder import FIGURES
from agents.score import REFERENCE
from baselines.rollout import Trajectory, true_observations
from baselines.suppression import COORDINATES
from sffr_gym.actuators import pack_actuators
from sffr_gym.beam import N_TIP, Array
from sffr_gym.geometry import resting_amplitudes, tip_deflections
from sffr_gym.model import N_BASE, Model, mode_slice, pack
from sffr_gym.params import Params
from sffr_gym.task import VIBRATION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 150
START = 40.0  # s, the part of an episode that is shown at large
PEAK = 4.0  # times the usual range: a peak beyond leaves the picture
# Okabe and Ito's colours, which colour-blind people can tell apart.
COLOURS = {
    "none": "#7F7F7F", "hsc": "#0072B2", "ahsc": "#D55E00", "ahsc-filtered": "#009E73", "random": "#CC79A7",
    "hsc-tuned": "#56B4E9", "lqr": "#E69F00",
}  # fmt: skip
OTHERS = ("#882255", "#44AA99", "#000000", "#999933", "#332288")
STYLE: dict[Any, Any] = {
    "font.size": 9, "axes.titlesize": 9, "axes.labelsize": 9, "legend.fontsize": 9, "axes.grid": True,
    "grid.color": "#E6E6E6", "grid.linewidth": 0.6, "axes.spines.top": False, "axes.spines.right": False,
    "axes.edgecolor": "#555555", "axes.axisbelow": True, "legend.frameon": False, "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-3, 4),
}  # fmt: skip


@dataclass(frozen=True)
class View:
    """What the figures draw.

    Attributes:
        trajectories: of each policy, all in the same episode.
        model, params: the episode's plant.
        limit: (n_u,) what the actuators can give in it.
        colours: of each policy.
    """

    trajectories: Mapping[str, Trajectory]
    model: Model
    params: Params
    limit: Array
    colours: Mapping[str, str]

    def lines(self) -> list[tuple[str, Trajectory, dict[str, Any]]]:
        """Policy, trajectory and line style; earlier lines are wider, so that equal ones show below each other."""
        thin = {policy for policy, trajectory in self.trajectories.items() if policy == "none" or trajectory.failure}
        widths = iter(np.linspace(2.8, 1.0, max(len(self.trajectories) - len(thin), 2)))
        styles = {
            policy: {
                "label": policy,
                "color": self.colours[policy],
                "linewidth": 1.1 if policy in thin else next(widths),
            }
            | ({"zorder": 1.5} if trajectory.failure else {})
            for policy, trajectory in self.trajectories.items()
        }
        return [(policy, trajectory, styles[policy]) for policy, trajectory in self.trajectories.items()]


def save_figures(folder: Path, evaluation: Evaluation) -> list[Path]:
    """Draw the first episode of each policy into a folder; a figure without anything to show is left out.

    Raises:
        ModuleNotFoundError: without matplotlib.
    """
    import matplotlib as mpl

    view = make_view(evaluation.first)
    painters: tuple[Callable[[View], Figure | None], ...] = (path, tracking, panels, damping, forces)
    files = []
    with mpl.rc_context(STYLE):
        for name, paint in zip(FIGURES, painters, strict=True):
            figure = paint(view)
            if figure is not None:
                picture = io.BytesIO()
                figure.savefig(picture, format="png", dpi=DPI)
                files.append(write_whole(folder / name, picture.getvalue()))
    return files


def make_view(trajectories: Mapping[str, Trajectory]) -> View:
    """Collect what the figures need from a trajectory of each policy, all in the same episode."""
    episode = next(iter(trajectories.values())).episode
    model = pack(episode.plant)
    actuators = pack_actuators(episode.plant, model)
    limit = actuators.limit * episode.health.left(actuators)
    return View(trajectories, model, episode.plant, limit, colours_of(trajectories))


def colours_of(policies: Iterable[str]) -> dict[str, str]:
    """A colour for each policy, the same in every figure for those that are shipped."""
    others = [policy for policy in policies if policy not in COLOURS]
    return COLOURS | {policy: OTHERS[i % len(OTHERS)] for i, policy in enumerate(others)}


def path(view: View) -> Figure:
    """The robot on its circle under AHSC if it took part, else under the last policy that did not fail."""
    whole = [trajectory for trajectory in view.trajectories.values() if not trajectory.failure]
    trajectory = view.trajectories.get(REFERENCE, [*view.trajectories.values(), *whole][-1])
    return path_figure(trajectory, view.model, view.params)


def tracking(view: View) -> Figure:
    """Magnitudes of the true position errors and their rates: of object, grippers (together) and base."""
    fields = next(iter(view.trajectories.values())).fields
    kinds = ("object_error", "object"), ("tip_error", "gripper"), ("base_error", "base")
    rows = [
        row
        for field, label in kinds
        for row in ((field, f"{label} error", "m"), (f"{field}_rate", f"{label} rate", "m/s"))
        if fields[field].size
    ]
    figure, axes = _grid(view, len(rows), spans=True)
    truth = {policy: true_observations(trajectory) for policy, trajectory in view.trajectories.items()}
    for (field, label, unit), row in zip(rows, axes, strict=True):
        row[0].set_ylabel(label)
        _logarithmic(row[0], unit)
        for policy, trajectory, style in view.lines():
            values = truth[policy][:, trajectory.fields[field].slice]
            for each in row:
                each.plot(trajectory.t, np.linalg.norm(values, axis=1), **style)
    return _finish(view, figure, axes)


def panels(view: View) -> Figure | None:
    """Tip deflections with the quasi-static ones, and the bending energy about the quasi-static shape."""
    mounts = view.params.panel.mounts
    if not mounts:
        return None
    figure, axes = _grid(view, len(mounts) + 1, spans=True)
    for _, trajectory, style in view.lines():
        tips = tip_deflections(view.model, trajectory.p)
        ticks = np.arange(len(trajectory.signals))[:: max(len(trajectory.signals) // 4000, 1)]
        for column in range(axes.shape[1]):
            for i in range(len(mounts)):
                axes[i, column].plot(trajectory.t, tips[:, i], **style)
            energy = trajectory.signals[ticks, VIBRATION]
            axes[-1, column].plot((ticks + 1) * trajectory.period, energy, **style)
    longest = max(view.trajectories.values(), key=lambda trajectory: len(trajectory.t))
    still = tip_deflections(view.model, quasi_static(view, longest))
    for row, mount, i in zip(axes, mounts, range(len(mounts)), strict=False):
        row[0].set_ylabel(f"{mount.name} tip\n[m]")
        for each in row:
            each.plot(longest.t, still[:, i], color="black", linewidth=1.0, linestyle=(0, (4, 2)), label="quasi-static")
    axes[-1, 0].set_ylabel("vibration energy")
    _logarithmic(axes[-1, 0], "J")
    return _finish(view, figure, axes)


def damping(view: View) -> Figure | None:
    """Virtual damping of each panel's tip coordinates, for the policies that have one."""
    lines = [line for line in view.lines() if np.nan_to_num(line[1].B_hat).any()]
    used = [k for k in range(N_TIP) if any(np.nan_to_num(line[1].B_hat[:, :, k]).any() for line in lines)]
    if not used:
        return None
    mounts = view.params.panel.mounts
    figure, axes = _grid(view, len(used), columns=len(mounts))
    for row, k in zip(axes, used, strict=True):
        row[0].set_ylabel(f"$\\hat B$ of {COORDINATES[k]}\n[{('N s/m', 'N s/m', 'N m s/rad')[k]}]")
        for i, each in enumerate(row):
            for _, trajectory, style in lines:
                each.plot(trajectory.t, trajectory.B_hat[:, i, k], **style)
    for each, mount in zip(axes[0], mounts, strict=True):
        each.set_title(f"{mount.name} panel")
    return _finish(view, figure, axes)


def forces(view: View) -> Figure:
    """What each actuator applies, with its limit in writing, which would squash the curves as a line."""
    params, limit = view.params, view.limit
    mounts, names = params.panel.mounts, ("axial", "transverse", "slope")
    n_c = (len(limit) - N_BASE - params.n_links) // max(len(mounts), 1)
    piezos = [[f"{mount.name} piezo {names[c] if n_c == N_TIP else c + 1}" for c in range(n_c)] for mount in mounts]
    joints = [f"{arm.name} joint {k + 1}" for arm in params.arms for k in range(len(arm.links))]
    at = n_c * len(mounts)
    groups = [
        [(at, "thrust x", "N"), (at + 1, "thrust y", "N"), (at + 2, "thruster torque", "N m")],
        [(at + N_BASE + k, name, "N m") for k, name in enumerate(joints)],
        *([(i * n_c + c, name, "V") for c, name in enumerate(own)] for i, own in enumerate(piezos)),
    ]
    rows = [group[k : k + 3] for group in groups for k in range(0, len(group), 3)]
    figure, axes = _grid(view, len(rows), columns=3, share=False)
    for row, entries in zip(axes, rows, strict=True):
        for each, (k, name, unit) in zip(row, entries, strict=False):
            each.set_title(f"{name} [{unit}]", loc="left")
            each.set_title(f"limit \u00b1{limit[k]:g} {unit}", loc="right", color="#777777", fontsize=8)
            for _, trajectory, style in view.lines():
                each.plot(trajectory.t, trajectory.applied[:, k], **style)
            if not any(trajectory.applied[:, k].any() for trajectory in view.trajectories.values()):
                each.text(0.5, 0.6, "not used", transform=each.transAxes, ha="center", color="#777777")
        for each in row[len(entries) :]:
            each.set_axis_off()
    return _finish(view, figure, axes)


def quasi_static(view: View, trajectory: Trajectory) -> Array:
    """Positions (rows, n): bending amplitudes that the reference's acceleration alone holds, and zeros."""
    fields, p = trajectory.fields, np.zeros_like(trajectory.p)
    a = trajectory.obs[:, fields["reference_acceleration"].slice]
    turn = trajectory.obs[:, fields["reference_turn"].slice][:, 0]
    amplitudes = resting_amplitudes(view.model, trajectory.reference, a, turn)
    p[:, mode_slice(view.model)] = amplitudes.reshape(len(p), -1)
    return p


def _grid(view: View, rows: int, columns: int = 1, spans: bool = False, share: bool = True) -> tuple[Figure, Any]:
    """Axes (rows, columns) over time; ``spans``: the first 40 s in one column, the whole in another."""
    from matplotlib.figure import Figure

    end = max(trajectory.t[-1] for trajectory in view.trajectories.values())
    columns = 2 if spans and end > 1.5 * START else columns
    figure = Figure(figsize=(10.0, 0.8 + 1.45 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, sharex="col", sharey="row" if share else False, squeeze=False)
    for each in axes.flat:
        each.margins(x=0.0)
    if columns == 2 and spans:
        axes[0, 0].set_xlim(0.0, START)
    return figure, axes


def _logarithmic(axes: Axes, unit: str) -> None:
    """A logarithmic axis in powers of ten of a unit."""
    from matplotlib.ticker import EngFormatter, NullFormatter

    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(EngFormatter(unit))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _finish(view: View, figure: Figure, axes: Any) -> Figure:
    """Choose the ranges, name the time axes and put one legend above everything.

    Policies that failed do not stretch the ranges, unless all did.
    """
    failed = {policy for policy, trajectory in view.trajectories.items() if trajectory.failure}
    failed = set() if len(failed) == len(view.trajectories) else failed
    for each in axes.flat:
        together = each.get_shared_y_axes().get_siblings(each)
        lines = [line for one in together for line in one.get_lines() if line.get_label() not in failed]
        values = np.concatenate([line.get_ydata() for line in lines] or [np.zeros(1)])
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
    figure.align_ylabels()
    shown = {line.get_label(): line for line in axes[0, 0].get_lines()}
    figure.legend(shown.values(), shown.keys(), loc="outside upper center", ncols=len(shown))
    return figure


def _range(values: Array) -> tuple[float, float]:
    """What a linear axis shows of values: all, except a moment's peak that would squash the rest, and a little air."""
    low, high = values.min(), values.max()
    most = np.quantile(values, [0.003, 0.997])
    if high - low > PEAK * (most[1] - most[0]) > 0.0:
        low, high = most
    air = 0.06 * (high - low) or 1.0
    return low - air, high + air
