"""Pictures that the paper lacks: why its adaptation does not last, other gains, and which periods a law can run at."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from agents.figures import COLOURS
from agents.reproduce.adaptation import account
from agents.reproduce.figures import SERIES, Plate, canvas, legend
from agents.reproduce.study import ADAPTIVE, GAINS, STARTS, Case, Study, adaptation_law, describe
from baselines.stability import axial_alone, largest_stable_damping, sampled_growth
from sffr_gym.beam import N_TIP, Array
from sffr_gym.model import Model, pack
from sffr_gym.params import Params

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PERIODS = np.geomspace(1.0e-4, 4.0e-3, 240)  # s
AXIAL = np.geomspace(30.0, 1.0e5, 240)  # N s/m
COARSE = 10  # periods at which the largest damping is sought
CAP = 1.6  # growth per period beyond which the picture tells no difference
ELEMENTS = (1, 2, 4, 8)
ALL_BENDING = "panel.bending_cut=1.0e+9"
UNDAMPED = "panel.strain_rate_damping=0"


def further_plates(study: Study) -> list[Plate]:
    """The further pictures."""
    return [
        Plate(
            "adaptation_integral.png", "Why the printed law integrates to a function of the deflection",
            "Eq. 39 with Y = e = -q and the regressor diag(e_dot) is dB_k/dt = Gamma_k qd_k (M^-1 q)_k. M^-1 is "
            "constant and symmetric, so the sum of dB_k / Gamma_k is d(q' M^-1 q / 2), whatever the motion. Left: the "
            "printed law lies on that diagonal; the filtered one leaves it, since it adds qd' M^-1 qd > 0. A single "
            "B_k has its own part Gamma_k (M^-1)_kk q_k^2 / 2 and the cross part, integrals of q_j dq_k: areas that "
            "the tip's path encloses in the plane of q5 and q6, nothing while it moves in one mode (right). So B is "
            "traced back and forth (middle), and a straight panel has its first damping again: it cannot learn.",
            integral(study),
        ),
        Plate(
            "gains.png", "Other starts and other gains",
            "Mean vibration energy and the object's error for HSC and for both laws with one, ten and a hundred times "
            "the gains of Table IV. Too much damping holds the panels back from the quasi-static shape and costs too.",
            gains(study),
        ),
        Plate(
            "stability.png", "Which control periods the virtual damping allows",
            "Left and middle: growth of a clamped panel's axial vibration per control period under an axial virtual "
            "damping that is held over the period; red is unstable. Dots: Table IV's B(0) at 0.5 ms, as run here, and "
            "at 2 ms. Lines: half an axial cycle (Nyquist), and a quarter (dashed), up to which the setting auto of "
            "suppression.coordinates damps it. Beyond, strain-rate damping decides whether the held force calms or "
            "feeds the mode. Right: the largest stable damping of the tip's slope if all bending modes are kept; more "
            "elements make the tip node lighter, which is why fast modes are cut by default (panel.bending_cut).",
            stability(study.params),
        ),
    ]  # fmt: skip


def integral(study: Study) -> Figure:
    """The printed law's integral: on the diagonal, traced back and forth, and its parts."""
    figure, axes = canvas(1, 3, 3.6)
    whole, back, parts = axes[0]
    for policy in reversed(ADAPTIVE):
        trajectory, law = study.trajectories[Case(policy)], adaptation_law(study.params, policy)
        taken = account(trajectory, law)
        q = trajectory.obs[:, trajectory.fields["elastic"].slice].reshape(len(trajectory.t), -1, N_TIP)
        whole.plot(1e3 * taken.potential[:, 0], 1e3 * taken.spent[:, 0], color=COLOURS[policy], label=policy, lw=1.4)
        back.plot(1e3 * q[:, 0, 1], trajectory.B_hat[:, 0, 1], color=COLOURS[policy], lw=1.4)
        if policy == "ahsc":
            cross = taken.change - taken.own
            for values, label, style in (
                (taken.change, "change of B", "-"), (taken.own, "own part", "--"), (cross, "cross part", ":"),
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


def gains(study: Study) -> Figure:
    """Vibration and tracking over the gains, for each start and law."""
    figure, axes = canvas(1, 2, 3.5)
    labels = ["HSC", *("\u0393" if gain == 1.0 else f"{gain:g} \u0393" for gain in GAINS)]
    shown = ("vibration", 1e3, "mean vibration energy [mJ]"), ("track_rmse", 1e6, "object error, rms [\u00b5m]")
    for each, (name, factor, label) in zip(axes[0], shown, strict=True):
        for start, colour in zip(STARTS, SERIES, strict=False):
            for policy, style in zip(ADAPTIVE, ("o-", "s--"), strict=True):
                listed = [Case("hsc", start), *(Case(policy, start, gain) for gain in GAINS)]
                values = [factor * study.measures[case][name] for case in listed]
                where = describe(Case(policy, start))
                each.plot(labels, values, style, color=colour, markersize=4, lw=1.3, label=where)
        each.axhline(factor * study.measures[Case("none")][name], color=COLOURS["none"], lw=1.0, label="none")
        each.set(yscale="log", ylabel=label)
        _plain_log(each)
    handles, names = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside right center")
    return figure


def stability(params: Params) -> Figure:
    """Growth over period and axial damping with and without strain-rate damping; the slope's largest damping."""
    from matplotlib.colors import TwoSlopeNorm

    figure, axes = canvas(1, 3, 3.9)
    norm = TwoSlopeNorm(1.0, 0.0, CAP)
    for each, changed in zip(axes[0], (params, params.with_overrides(UNDAMPED)), strict=False):
        model = pack(changed)
        growth = np.minimum(growth_map(model, PERIODS, AXIAL), CAP)
        mesh = each.pcolormesh(
            1e3 * PERIODS, AXIAL, growth, cmap="RdYlBu_r", norm=norm, shading="nearest", rasterized=True
        )
        each.contour(1e3 * PERIODS, AXIAL, growth, [1.0 + 1e-9], colors="black", linewidths=1.0)
        _mark(each, model, params)
        each.set_title(f"strain-rate damping {changed.panel.strain_rate_damping:g} s", loc="left")
        each.set(xscale="log", yscale="log", xlabel="control period [ms]")
    axes[0, 0].set_ylabel("axial virtual damping [N s/m]")
    figure.colorbar(mesh, ax=list(axes[0, :2]), label="growth per period", ticks=[0.0, 0.5, 1.0, 1.2, 1.4, CAP])
    slope, thinned = axes[0, 2], np.geomspace(PERIODS[0], PERIODS[-1], COARSE)
    for elements, colour in zip(ELEMENTS, SERIES, strict=True):
        model = pack(params.with_overrides(f"panel.elements={elements}", ALL_BENDING))
        largest = [largest_stable_damping(model, [0.0, 0.0, 1.0], np.ones(N_TIP), period) for period in thinned]
        slope.plot(1e3 * thinned, largest, color=colour, lw=1.4)
        name = f"{elements} element{'s' * (elements > 1)}"
        slope.annotate(name, (1e3 * thinned[0], largest[0]), (2, 6), textcoords="offset points", color=colour)
    slope.axhline(params.suppression.B0[2], color="black", lw=0.8, ls="--")
    slope.annotate("B(0)", (1e3 * thinned[-1], params.suppression.B0[2]), (-24, 4), textcoords="offset points")
    slope.set_title("largest stable damping of the slope", loc="left")
    slope.set(xscale="log", yscale="log", xlabel="control period [ms]", ylabel="[N m s/rad]")
    for each in axes[0]:
        each.set_xticks([0.1, 0.2, 0.5, 1.0, 2.0, 4.0], ["0.1", "0.2", "0.5", "1", "2", "4"])
        each.minorticks_off()
    return figure


def growth_map(model: Model, periods: Array, damping: Array) -> Array:
    """Growth per period (len(damping), len(periods)) of the axial vibration of a clamped panel."""
    axial, B = axial_alone(model), np.zeros((len(damping), N_TIP))
    B[:, 0] = damping
    return np.column_stack([sampled_growth(axial, B, np.ones(N_TIP), period) for period in periods])


def _mark(axes: Axes, model: Model, params: Params) -> None:
    """The paper's damping at two periods, and the limits of the sampling."""
    axes.plot([0.5, 2.0], [params.suppression.B0[0]] * 2, "o", color="black", markersize=4)
    half = 1e3 * np.pi / np.sqrt(model.omega2[0, 0])
    axes.text(0.16, 100.0, "stable")
    axes.text(0.25, 6.0e4, "unstable", color="white")
    for period, style in (half, "-"), (half / 2, "--"):
        axes.axvline(period, color="#333333", lw=0.9, ls=style)


def _plain_log(axes: Any) -> None:
    """Plain numbers on a logarithmic axis."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 3.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
