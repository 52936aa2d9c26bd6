"""Figs. 6 to 13 of the paper with our numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sffr_baselines.rollout import Trajectory
from sffr_gym.physics.beam import N_TIP
from sffr_gym.physics.kinematics import modal_tip_deflections
from sffr_gym.task.quasi_static import quasi_static_at
from sffr_gym.task.signals import VIBRATION
from sffr_gym.types import Array
from sffr_workbench.common import prefixed_unit
from sffr_workbench.figures import episode, path_figure
from sffr_workbench.figures.style import POLICY_COLOURS, SERIES, canvas, legend, title_with_limit
from sffr_workbench.reproduce.cases import STARTS, Case, CaseRuns, TaskErrors, describe, task_errors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EARLY = 12.0  # s, the part of a run that is shown at large
LEAST_SPAN = 0.03  # of a virtual damping, that its axis shows


class CaptionedFigure(NamedTuple):
    """A figure of the page."""

    file: str  #: its name
    title: str  #: heading
    caption: str  #: what it shows
    figure: Any  #: a matplotlib figure


def paper_figures(runs: CaseRuns) -> list[CaptionedFigure]:
    """Draw the paper's figures, in its order."""
    ahsc = runs.trajectories[Case("ahsc")]
    return [
        CaptionedFigure(
            "fig06.png", "Fig. 6: AHSC and HSC during the manipulation",
            "Transverse deflection of the panels' tips, and vibration energy about the quasi-static shape that the "
            "path's acceleration asks for; the first 40 s and the whole. What remains of the energy after some seconds "
            "is no vibration: the damping holds the panels a little behind the quasi-static shape.",
            episode.panels(figure_data(runs, "none", "hsc", "ahsc", "ahsc-filtered")),
        ),
        CaptionedFigure(
            "fig06_starts.png", "Fig. 6, varied: other virtual dampings at the start",
            "Vibration energy from B(0) of Table IV, a tenth and a hundredth of it. Where HSC starts with too little "
            "damping, both adaptations gain on it.",
            starts(runs),
        ),
        CaptionedFigure(
            "fig07.png", "Fig. 7: virtual damping of the left and right panel",
            "The printed law moves B while the panel is deflected and takes it back; the filtered one keeps most. The "
            "axial damping stays, since the axial deflection is tiny (Fig. 12).",
            virtual_damping(runs),
        ),
        CaptionedFigure(
            "fig08.png", "Fig. 8: errors of the workspace variables under AHSC",
            "After the start's transient a remainder turns with the path: the pull of the panels under the path's "
            "acceleration, which the rigid-body law does not know.",
            errors(runs, rates=False),
        ),
        CaptionedFigure(
            "fig09.png", "Fig. 9: rates of these errors", "They fall with the panels' vibration to the slow turning of "
            "the remainder.", errors(runs, rates=True),
        ),
        CaptionedFigure(
            "fig10.png", "Fig. 10: forces of the thrusters under AHSC", "Along the body axes.",
            actuators(runs, ["thrust x", "thrust y", "torque"], base=True),
        ),
        CaptionedFigure(
            "fig11.png", "Fig. 11: torques of the joints under AHSC", "Joints are counted from the base.",
            actuators(runs, episode.joint_names(runs.params), base=False),
        ),
        CaptionedFigure(
            "fig12.png", "Fig. 12: deflection of the panels under AHSC",
            "The elastic coordinates of both tips. Once the initial speed of Table IV is damped out, the panels follow "
            "the quasi-static shape.",
            deflections(runs),
        ),
        CaptionedFigure(
            "fig13.png", "Fig. 13: the robot on its path under AHSC", "Positions along the path, and one at large.",
            path_figure(ahsc, runs.model, runs.params),
        ),
    ]  # fmt: skip


def figure_data(runs: CaseRuns, *policies: str) -> episode.FigureData:
    """Return what the figures of ``sffr evaluate`` draw from."""
    return episode.figure_data(runs.table_iv(*policies))


def starts(runs: CaseRuns) -> Figure:
    """Draw the vibration energy over time from each start."""
    figure, axes = canvas(1, len(STARTS), 2.9, sharey="row")
    for each, start in zip(axes[0], STARTS, strict=True):
        each.set_title(describe(Case("", start)).strip() or "from B(0) of Table IV")
        for policy, width in ("hsc", 2.8), ("ahsc", 1.9), ("ahsc-filtered", 1.0):
            trajectory = runs.trajectories[Case(policy, start)]
            kept = slice(None, None, max(len(trajectory.signals) // 4000, 1))
            energy = trajectory.signals[kept, VIBRATION]
            times = trajectory.period * (np.arange(len(trajectory.signals))[kept] + 1)
            each.plot(times, 1e3 * energy, color=POLICY_COLOURS[policy], linewidth=width, label=policy)
        each.set(yscale="log", xlabel="time [s]")
        each.margins(x=0.0)
    axes[0, 0].set_ylabel("vibration energy [mJ]")
    top = max(line.get_ydata().max() for line in axes[0, 0].get_lines())
    axes[0, 0].set_ylim(2e-6 * top, 2.0 * top)
    return legend(figure, axes[0, 0])


def virtual_damping(runs: CaseRuns) -> Figure | None:
    """Draw the virtual damping over time; an axis spans at least a few per cent, so that rounding does not fill it."""
    figure = episode.damping(figure_data(runs, "hsc", "ahsc", "ahsc-filtered"))
    for axes in figure.axes if figure else ():
        low, high = axes.get_ylim()
        middle = (low + high) / 2
        if high - low < LEAST_SPAN * middle:
            axes.set_ylim(middle * (1 - LEAST_SPAN), middle * (1 + LEAST_SPAN))
    return figure


def errors(runs: CaseRuns, rates: bool) -> Figure:
    """Draw errors of the task coordinates, or their rates, group by group: the start at large, and the whole."""
    trajectory = runs.trajectories[Case("ahsc")]
    groups = task_errors(trajectory, runs.model)
    figure, axes = canvas(len(groups), 2, 6.4, sharex="col", sharey="row")
    for row, group in zip(axes, groups, strict=True):
        values = group.rates if rates else group.errors
        unit, scale = prefixed_unit(group.unit, np.abs(values).max())
        row[0].set_ylabel(f"{group.name}\n[{unit}{'/s' if rates else ''}]")
        for each in row:
            _draw_group(each, trajectory, group, values / scale)
        row[1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    _time(axes, trajectory)
    return figure


def actuators(runs: CaseRuns, names: list[str], base: bool) -> Figure:
    """Draw the forces of the base's thrusters, or the torques of the joints."""
    trajectory, settings = runs.trajectories[Case("ahsc")], runs.params.actuators
    first = trajectory.applied.shape[1] - len(runs.model.link_mass) - (3 if base else 0)
    rows = -(-len(names) // 3)
    figure, axes = canvas(rows, 3, 0.9 + 1.7 * rows, sharex="all")
    for k, (each, name) in enumerate(zip(axes.flat, names, strict=True)):
        limit = settings.joint_torque if not base else settings.thruster_torque if k == 2 else settings.thruster_force
        unit = "N" if base and k < 2 else "N m"
        title_with_limit(each, name, limit, unit)
        each.plot(trajectory.t, trajectory.applied[:, first + k], color=POLICY_COLOURS["ahsc"], linewidth=1.2)
        each.margins(x=0.0)
    for each in axes[-1]:
        each.set_xlabel("time [s]")
    return figure


def deflections(runs: CaseRuns) -> Figure:
    """Draw the tips' elastic coordinates over time: the start at large, and the whole."""
    trajectory, mounts = runs.trajectories[Case("ahsc")], runs.params.panel.mounts
    q = trajectory.obs[:, trajectory.fields["elastic"].slice].reshape(len(trajectory.t), -1, N_TIP)
    still = modal_tip_deflections(runs.model, quasi_static_at(runs.model, trajectory.reference, trajectory.t)).T
    names = ("axial $q_4$", "m"), ("transverse $q_5$", "m"), ("slope $q_6$", "rad")
    figure, axes = canvas(N_TIP, 2, 5.4, sharex="col", sharey="row")
    for k, (row, (coordinate, unit)) in enumerate(zip(axes, names, strict=True)):
        shown_unit, scale = prefixed_unit(unit, np.abs(q[..., k]).max())
        row[0].set_ylabel(f"{coordinate}\n[{shown_unit}]")
        for each in row:
            for i, mount in enumerate(mounts):
                name = f"{mount.name} panel"
                each.plot(trajectory.t, q[:, i, k] / scale, color=SERIES[i], linewidth=1.2, label=name)
            for curve, label in zip(still if k == 1 else (), ("quasi-static", None), strict=False):
                each.plot(trajectory.t, curve / scale, color="black", linewidth=0.9, linestyle="--", label=label)
    _time(axes, trajectory)
    return legend(figure, axes[1, 0])


def _draw_group(axes: Axes, trajectory: Trajectory, group: TaskErrors, values: Array) -> None:
    """Draw a group's coordinates; of four the first two wider, since those of the grippers nearly coincide."""
    for k, (label, column, colour) in enumerate(zip(group.labels, values.T, SERIES, strict=False)):
        width = 2.6 if k < len(group.labels) - 2 else 1.2
        axes.plot(trajectory.t, column, color=colour, linewidth=width, label=label)


def _time(axes: Any, trajectory: Trajectory) -> None:
    """Set the time axes: the start in the left column, all in the right one."""
    for column, end in zip(axes.T, (min(EARLY, trajectory.t[-1]), trajectory.t[-1]), strict=True):
        column[-1].set_xlim(0.0, end)
        column[-1].set_xlabel("time [s]")
