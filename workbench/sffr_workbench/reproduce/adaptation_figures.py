"""Figures that the paper lacks: why its adaptation does not last, and other starts and gains."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sffr_gym.physics.beam import N_TIP
from sffr_workbench.figures.style import POLICY_COLOURS, SERIES, canvas, legend
from sffr_workbench.reproduce.adaptation import adaptation_integral
from sffr_workbench.reproduce.cases import ADAPTIVE, GAINS, STARTS, Case, CaseRuns, adaptation_law, describe
from sffr_workbench.reproduce.paper_figures import CaptionedFigure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def adaptation_figures(runs: CaseRuns) -> list[CaptionedFigure]:
    """Draw why the printed adaptation does not last, and other gains."""
    return [
        CaptionedFigure(
            "adaptation_integral.png", "Why the printed law integrates to a function of the deflection",
            "Eq. 39 with Y = e = -q and the regressor diag(e_dot) is dB_k/dt = Gamma_k qd_k (M^-1 q)_k. M^-1 is "
            "constant and symmetric, so the sum of dB_k / Gamma_k is d(q' M^-1 q / 2), whatever the motion. Left: the "
            "printed law lies on that diagonal; the filtered one leaves it, since it adds qd' M^-1 qd > 0. A single "
            "B_k has its own part Gamma_k (M^-1)_kk q_k^2 / 2 and the cross part, integrals of q_j dq_k: areas that "
            "the tip's path encloses in the plane of q5 and q6, nothing while it moves in one mode (right). So B is "
            "traced back and forth (middle), and a straight panel has its first damping again: it cannot learn.",
            integral(runs),
        ),
        CaptionedFigure(
            "gains.png", "Other starts and other gains",
            "Mean vibration energy and the object's error for HSC and for both laws with one, ten and a hundred times "
            "the gains of Table IV. Too much damping holds the panels back from the quasi-static shape and costs too.",
            gains(runs),
        ),
    ]  # fmt: skip


def integral(runs: CaseRuns) -> Figure:
    """Draw the printed law's integral: on the diagonal, traced back and forth, and its parts."""
    figure, axes = canvas(1, 3, 3.6)
    whole, back, parts = axes[0]
    for policy in reversed(ADAPTIVE):
        trajectory, law = runs.trajectories[Case(policy)], adaptation_law(runs.params, policy)
        split = adaptation_integral(trajectory, law)
        q = trajectory.obs[:, trajectory.fields["elastic"].slice].reshape(len(trajectory.t), -1, N_TIP)
        whole.plot(
            1e3 * split.potential[:, 0], 1e3 * split.total[:, 0], color=POLICY_COLOURS[policy], label=policy, lw=1.4
        )
        back.plot(1e3 * q[:, 0, 1], trajectory.B_hat[:, 0, 1], color=POLICY_COLOURS[policy], lw=1.4)
        if policy == "ahsc":
            cross = split.change - split.own
            for values, label, style in (
                (split.change, "change of B", "-"), (split.own, "own part", "--"), (cross, "cross part", ":"),
            ):  # fmt: skip
                for k, colour in (1, SERIES[0]), (2, SERIES[3]):
                    parts.plot(
                        trajectory.t, values[:, 0, k], style, color=colour, lw=1.3, label=f"{label}, $q_{4 + k}$"
                    )
    ends = np.array(whole.get_xlim())
    whole.plot(ends, ends, color="black", lw=0.8, ls="--", label="function of the deflection", zorder=1)
    whole.set(
        xlabel="$q'M^{-1}q\\,/\\,2$, left panel [10$^{-3}$]", ylabel="$\\Sigma\\,\\Delta B_k/\\Gamma_k$ [10$^{-3}$]"
    )
    back.set(xlabel="transverse tip deflection $q_5$, left panel [mm]", ylabel="$\\hat B$ of $q_5$ [N s/m]")
    parts.set(xlabel="time [s]", ylabel="[N s/m, N m s/rad]")
    parts.set_title("printed law, left panel", loc="left", y=1.14)
    parts.legend(
        fontsize=7, ncols=3, loc="upper center", bbox_to_anchor=(0.47, 1.17), columnspacing=0.8, handlelength=1.4
    )
    return legend(figure, whole)


def gains(runs: CaseRuns) -> Figure:
    """Draw vibration and tracking over the gains, for each start and law."""
    figure, axes = canvas(1, 2, 3.5)
    labels = ["HSC", *("\u0393" if gain == 1.0 else f"{gain:g} \u0393" for gain in GAINS)]
    shown = ("vibration", 1e3, "mean vibration energy [mJ]"), ("track_rmse", 1e6, "object error, rms [\u00b5m]")
    for each, (name, factor, label) in zip(axes[0], shown, strict=True):
        for start, colour in zip(STARTS, SERIES, strict=False):
            for policy, style in zip(ADAPTIVE, ("o-", "s--"), strict=True):
                listed = [Case("hsc", start), *(Case(policy, start, gain) for gain in GAINS)]
                values = [factor * runs.measures[case][name] for case in listed]
                where = describe(Case(policy, start))
                each.plot(labels, values, style, color=colour, markersize=4, lw=1.3, label=where)
        each.axhline(factor * runs.measures[Case("none")][name], color=POLICY_COLOURS["none"], lw=1.0, label="none")
        each.set(yscale="log", ylabel=label)
        _plain_log(each)
    handles, names = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside right center")
    return figure


def _plain_log(axes: Axes) -> None:
    """Write plain numbers at a logarithmic axis."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 3.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
