"""Which frequencies the panels vibrate at, and how much of their limits the actuators use."""

from __future__ import annotations

from typing import Any

import numpy as np

from sffr_gym.physics.model import N_BASE, pack
from sffr_gym.physics.simulator import Simulator
from sffr_gym.types import Array
from sffr_workbench.evaluation import Recording

WINDOW = 60.0  # s, of Welch's method: half a dozen periods of the first mode
BINS = 160  # of a spectrum, evenly spaced on a logarithmic axis
HIGHEST = 20.0  # Hz; whatever is beyond is far below the panels' bending modes
PERIODS = 4  # of the highest frequency that an episode must at least have for a spectrum
SHARES = np.logspace(-5, 0, 16)  # ends of the bins of |command| / limit, three a decade
GROUPS = ("piezo", "thruster", "joint")


def spectrum(recording: Recording) -> dict[str, Any]:
    """Estimate the power spectral densities of the tips' transverse motion, from every control period.

    Welch's method with a Hann window; the mean of what falls into a bin of a logarithmic axis.

    Returns:
        ``f`` (k,) [Hz], ``psd`` (n_p, k) [m2/Hz]; empty for a robot without panels, and for an episode that is too
        short for a spectrum below ``HIGHEST``.
    """
    from scipy.signal import welch  # it takes most of a second to import, which other commands need not wait for

    tips = recording.tips[np.isfinite(recording.tips).all(axis=1)]
    length = min(round(WINDOW / recording.period), len(tips))
    if not tips.size or length < max(BINS, PERIODS / (HIGHEST * recording.period)):
        return {"f": [], "psd": [[] for _ in tips.T]}
    f, power = welch(tips, 1.0 / recording.period, nperseg=length, detrend="linear", axis=0)
    edges = np.geomspace(f[1] * 0.999, min(HIGHEST, f[-1]), BINS + 1)
    bins = np.digitize(f, edges) - 1
    kept = [k for k in range(BINS) if (bins == k).any()]
    return {
        "f": [_short(f[bins == k].mean()) for k in kept],
        "psd": [[_short(column[bins == k].mean()) for k in kept] for column in power.T],
    }


def mode_frequencies(recording: Recording) -> list[float]:
    """Return the natural frequencies [Hz] of the whole robot at the episode's start, below ``HIGHEST``.

    None of a state so far beyond the model's range that its mass matrix is not positive definite to rounding.
    """
    if not np.isfinite(recording.p[0]).all():
        return []
    sim = Simulator(recording.plant)
    try:
        frequencies: Array = sim.frequencies(sim.unflatten(0.0, recording.p[0], np.zeros_like(recording.p[0])))
    except np.linalg.LinAlgError:
        return []
    return [_short(f) for f in frequencies / (2.0 * np.pi) if f <= HIGHEST]


def use_of_limits(recording: Recording) -> dict[str, list[float]]:
    """Return for each group of actuators the share of time that ``|command| / limit`` spends in each bin.

    The bins are those between ``SHARES``, before them what is smaller, behind them what is at the limit. Actuators that
    can give nothing, dead ones, are left out.
    """
    n_joints = len(pack(recording.plant).link_mass)
    n_volts = len(recording.limit) - N_BASE - n_joints
    groups = np.split(np.arange(len(recording.limit)), [n_volts, n_volts + N_BASE])
    shares = {}
    for name, members in zip(GROUPS, groups, strict=True):
        alive = members[recording.limit[members] > 0.0]
        used = np.abs(recording.applied[:, alive]) / recording.limit[alive]
        bins = np.digitize(used, [*SHARES[:-1], 1.0 - 1e-6])
        counts = np.bincount(bins.ravel(), minlength=len(SHARES) + 1)
        shares[name] = [_short(count / max(used.size, 1)) for count in counts]
    return shares


def _short(value: float) -> float:
    """Round to five significant digits, to keep the page small."""
    return float(f"{value:.5g}")
