"""Figs. 6 to 13 of the paper with our numbers. matplotlib is imported where it is used."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from agents import figures
from agents.figures import COLOURS, View, make_view
from agents.reproduce.study import STARTS, Case, Study, Workspace, describe, workspace
from agents.robot_figure import path_figure
from baselines.rollout import Trajectory
from sffr_gym.beam import N_TIP, Array
from sffr_gym.task import VIBRATION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EARLY = 12.0  # s, the part of a run that is shown at large
LEAST_SPAN = 0.03  # of a virtual damping, that its axis shows
SERIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")  # coordinates of a group, Okabe and Ito's colours
PREFIX = {1.0: "", 1e3: "m", 1e6: "\u00b5", 1e9: "n"}  # of units, by the factor on the values


class Plate(NamedTuple):
    """A picture of the report.

    Attributes:
        file: its name; title: heading; caption: what it shows.
        figure: a matplotlib figure.
    """

    file: str
    title: str
    caption: str
    figure: Any


def paper_plates(study: Study) -> list[Plate]:
    """The paper's figures, in its order."""
    ahsc = study.trajectories[Case("ahsc")]
    return [
        Plate(
            "fig06.png", "Fig. 6: AHSC and HSC during the manipulation",
            "Transverse deflection of the panels' tips, and vibration energy about the quasi-static shape that the "
            "path's acceleration asks for; the first 40 s and the whole. What remains of the energy after some seconds "
            "is no vibration: the damping holds the panels a little behind the quasi-static shape.",
            figures.panels(view(study, "none", "hsc", "ahsc", "ahsc-filtered")),
        ),
        Plate(
            "fig06_starts.png", "Fig. 6, varied: other virtual dampings at the start",
            "Vibration energy from B(0) of Table IV, a tenth and a hundredth of it. Where HSC starts with too little "
            "damping, both adaptations gain on it.",
            starts(study),
        ),
        Plate(
            "fig07.png", "Fig. 7: virtual damping of the left and right panel",
            "The printed law moves B while the panel is deflected and takes it back; the filtered one keeps most. The "
            "axial damping stays, since the axial deflection is tiny (Fig. 12).",
            virtual_damping(study),
        ),
        Plate(
            "fig08.png", "Fig. 8: errors of the workspace variables under AHSC",
            "After the start's transient a remainder turns with the path: the pull of the panels under the path's "
            "acceleration, which the rigid-body law does not know.",
            errors(study, rates=False),
        ),
        Plate(
            "fig09.png", "Fig. 9: rates of these errors", "They fall with the panels' vibration to the slow turning of "
            "the remainder.", errors(study, rates=True),
        ),
        Plate(
            "fig10.png", "Fig. 10: forces of the thrusters under AHSC", "Along the body axes.",
            actuators(study, ["thrust x", "thrust y", "torque"], base=True),
        ),
        Plate(
            "fig11.png", "Fig. 11: torques of the joints under AHSC", "Joints are counted from the base.",
            actuators(study, joint_names(study), base=False),
        ),
        Plate(
            "fig12.png", "Fig. 12: deflection of the panels under AHSC",
            "The elastic coordinates of both tips. Once the initial speed of Table IV is damped out, the panels follow "
            "the quasi-static shape.",
            deflections(study),
        ),
        Plate(
            "fig13.png", "Fig. 13: the robot on its path under AHSC", "Positions along the path, and one at large.",
            path_figure(ahsc, study.model, study.params),
        ),
    ]  # fmt: skip


def view(study: Study, *policies: str) -> View:
    """What the figures of ``sffr evaluate`` draw from."""
    return make_view(study.table_iv(*policies))


def starts(study: Study) -> Figure:
    """Vibration energy over time from each start."""
    figure, axes = canvas(1, len(STARTS), 2.9, sharey="row")
    for each, start in zip(axes[0], STARTS, strict=True):
        each.set_title(describe(Case("", start)).strip() or "from B(0) of Table IV")
        for policy, width in ("hsc", 2.8), ("ahsc", 1.9), ("ahsc-filtered", 1.0):
            trajectory = study.trajectories[Case(policy, start)]
            kept = slice(None, None, max(len(trajectory.signals) // 4000, 1))
            energy = trajectory.signals[kept, VIBRATION]
            times = trajectory.period * (np.arange(len(trajectory.signals))[kept] + 1)
            each.plot(times, 1e3 * energy, color=COLOURS[policy], linewidth=width, label=policy)
        each.set(yscale="log", xlabel="time [s]")
        each.margins(x=0.0)
    axes[0, 0].set_ylabel("vibration energy [mJ]")
    top = max(line.get_ydata().max() for line in axes[0, 0].get_lines())
    axes[0, 0].set_ylim(2e-6 * top, 2.0 * top)
    return legend(figure, axes[0, 0])


def virtual_damping(study: Study) -> Figure | None:
    """Virtual damping over time; an axis spans at least a few per cent, so that rounding does not fill it."""
    figure = figures.damping(view(study, "hsc", "ahsc", "ahsc-filtered"))
    for axes in figure.axes if figure else ():
        low, high = axes.get_ylim()
        middle = (low + high) / 2
        if high - low < LEAST_SPAN * middle:
            axes.set_ylim(middle * (1 - LEAST_SPAN), middle * (1 + LEAST_SPAN))
    return figure


def errors(study: Study, rates: bool) -> Figure:
    """Errors of the task coordinates, or their rates, group by group: the start at large, and the whole."""
    trajectory = study.trajectories[Case("ahsc")]
    groups = workspace(trajectory, study.model)
    figure, axes = canvas(len(groups), 2, 6.4, sharex="col", sharey="row")
    for row, group in zip(axes, groups, strict=True):
        values = group.rates if rates else group.errors
        factor = factor_for(np.abs(values).max())
        unit = f"{PREFIX[factor]}{group.unit}" + ("/s" if rates else "")
        row[0].set_ylabel(f"{group.name}\n[{unit}]")
        for each in row:
            _draw_group(each, trajectory, group, factor * values)
        row[1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    _time(axes, trajectory)
    return figure


def actuators(study: Study, names: list[str], base: bool) -> Figure:
    """Forces of the base's thrusters, or torques of the joints, with their limits in writing."""
    trajectory, settings = study.trajectories[Case("ahsc")], study.params.actuators
    first = trajectory.applied.shape[1] - len(study.model.link_mass) - (3 if base else 0)
    rows = -(-len(names) // 3)
    figure, axes = canvas(rows, 3, 0.9 + 1.7 * rows, sharex="all")
    for k, (each, name) in enumerate(zip(axes.flat, names, strict=True)):
        limit = settings.joint_torque if not base else settings.thruster_torque if k == 2 else settings.thruster_force
        unit = "N" if base and k < 2 else "N m"
        each.set_title(f"{name} [{unit}]", loc="left")
        each.set_title(f"limit \u00b1{limit:g} {unit}", loc="right", color="#777777", fontsize=8)
        each.plot(trajectory.t, trajectory.applied[:, first + k], color=COLOURS["ahsc"], linewidth=1.2)
        each.margins(x=0.0)
    for each in axes[-1]:
        each.set_xlabel("time [s]")
    return figure


def joint_names(study: Study) -> list[str]:
    """Each joint's arm and number."""
    return [f"{arm.name} joint {k + 1}" for arm in study.params.arms for k in range(len(arm.links))]


def deflections(study: Study) -> Figure:
    """The tips' elastic coordinates over time: the start at large, and the whole."""
    trajectory, mounts = study.trajectories[Case("ahsc")], study.params.panel.mounts
    q = trajectory.obs[:, trajectory.fields["elastic"].slice].reshape(len(trajectory.t), -1, N_TIP)
    still = study.model.shapes[0, -N_TIP + 1] @ quasi_static_amplitudes(study, trajectory)
    names = ("axial $q_4$", "m"), ("transverse $q_5$", "m"), ("slope $q_6$", "rad")
    figure, axes = canvas(N_TIP, 2, 5.4, sharex="col", sharey="row")
    for k, (row, (name, unit)) in enumerate(zip(axes, names, strict=True)):
        factor = factor_for(np.abs(q[..., k]).max())
        row[0].set_ylabel(f"{name}\n[{PREFIX[factor]}{unit}]")
        for each in row:
            for i, mount in enumerate(mounts):
                each.plot(
                    trajectory.t, factor * q[:, i, k], color=SERIES[i], linewidth=1.2, label=f"{mount.name} panel"
                )
            for curve, label in zip(still if k == 1 else (), ("quasi-static", None), strict=False):
                each.plot(trajectory.t, factor * curve, color="black", linewidth=0.9, linestyle="--", label=label)
    _time(axes, trajectory)
    return legend(figure, axes[1, 0])


def quasi_static_amplitudes(study: Study, trajectory: Trajectory) -> Array:
    """Modal amplitudes (n_p, n_m, rows) that the path's acceleration alone holds."""
    p = figures.quasi_static(view(study, "ahsc"), trajectory)
    start = p.shape[1] - study.model.omega2.size - 3
    amplitudes: Array = p[:, start : start + study.model.omega2.size].T.reshape(*study.model.omega2.shape, -1)
    return amplitudes


def canvas(rows: int, columns: int, height: float, **sharing: Any) -> tuple[Figure, Any]:
    """A figure of the report's width and its axes (rows, columns)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **sharing)


def legend(figure: Figure, axes: Axes) -> Figure:
    """One legend above everything, of the lines in ``axes``."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    figure.align_ylabels()
    return figure


def factor_for(largest: float) -> float:
    """The factor to the unit in which a value has at least one digit before the point; nano at most."""
    return next((factor for factor in PREFIX if factor * largest >= 1.0), 1e9)


def _draw_group(axes: Axes, trajectory: Trajectory, group: Workspace, values: Array) -> None:
    """Lines of a group's coordinates; of four the first two wider, since those of the grippers nearly coincide."""
    for k, (label, column, colour) in enumerate(zip(group.labels, values.T, SERIES, strict=False)):
        width = 2.6 if k < len(group.labels) - 2 else 1.2
        axes.plot(trajectory.t, column, color=colour, linewidth=width, label=label)


def _time(axes: Any, trajectory: Trajectory) -> None:
    """Time axes: the start in the left column, all in the right one."""
    for column, end in zip(axes.T, (min(EARLY, trajectory.t[-1]), trajectory.t[-1]), strict=True):
        column[-1].set_xlim(0.0, end)
        column[-1].set_xlabel("time [s]")
