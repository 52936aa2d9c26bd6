"""A slew that ends at rest: a shaped path with the piezos off, beside AHSC and a regulator that spend volts.

A slew is a way and a turn from rest to rest. Its accelerations bend the panels, which swing on after the arrival.
A shaper puts a shorter motion in its place, again after half a period and after a whole one, such that the swings
cancel: no volt, but another way in between, and it must know the period. That is exact for a line; a turn carries
the panels' axes along. With a file as argument it draws: ``python shaped_slew.py slew.png``.
"""

import sys

import numpy as np

from sffr_workbench import evaluate

SLEW = {
    "name": "arrival",
    "description": "3 m and a third of a radian in 16 s, then 24 s at rest",
    "duration": 40.0,
    "robot": ["path.kind=slew", "path.displacement=[3, 0]", "path.turn=0.33", "path.time=16", "initial.qfd=[0, 0, 0]"],
}
POLICIES = ["none", "ahsc", "lqr-ff", "shaped"]


def print_table(found):
    """Print what is left at the arrival, and what it took."""
    for name, row in found.table.items():
        volts = abs(found.first[name].applied[:, :6]).max()  # of two panels with three channels each
        print(f"{name:7} tips swing by {1e3 * row['residual_tip']:6.1f} mm after the arrival", end=", ")
        print(f"object within {1e3 * row['track_max']:8.4f} mm, {volts:6.3f} V, {row['piezo_effort']:7.3f} V2 s")


def draw(found, file):
    """Draw object, right panel and its volts in the first episode of each policy but ``none``."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(3, 1, sharex=True, figsize=(8, 7), layout="constrained")
    for name, style in zip(POLICIES[1:], ("-", "--", "-"), strict=True):
        run = found.first[name]
        axes[0].plot(run.t, run.v[:, -3], style, label=name)  # positions and rates end with the object's pose
        axes[1].plot(run.period * np.arange(1, len(run.tips) + 1), 1e3 * run.tips[:, 1], style)
        axes[2].plot(run.t, run.applied[:, 4], style)
    for axis, label in zip(axes, ("object's speed along x [m/s]", "right tip [mm]", "right piezo [V]"), strict=True):
        axis.set_ylabel(label)
        axis.axvline(16.0, color="grey", linestyle=":")
    axes[0].legend(), axes[2].set_xlabel("time [s]")
    figure.savefig(file)


if __name__ == "__main__":
    known = evaluate(POLICIES, SLEW)
    print_table(known)
    print("EI of the panels up to a quarter off what the laws believe:")
    off = evaluate(POLICIES, SLEW | {"plant": {"EI": [0.8, 1.25]}}, episodes=5)
    print_table(off)
    if sys.argv[1:]:
        draw(known, sys.argv[1])
    left = [{name: row["residual_tip"] for name, row in found.table.items()} for found in (known, off)]
    assert left[0]["shaped"] < 0.1 * left[0]["ahsc"] and left[1]["shaped"] < 0.2 * left[1]["ahsc"]
