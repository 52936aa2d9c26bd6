"""An episode as a table: every column with a name, a unit and a frame; docs/control.md has the list."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sffr_baselines.rollout import Trajectory
from sffr_gym import Simulator
from sffr_gym.physics.beam import N_TIP
from sffr_gym.physics.kinematics import rotation
from sffr_gym.physics.linearization import Label, command_labels, coordinate_labels, rate_of
from sffr_gym.physics.model import N_BASE, mode_slice, nodal, object_slice
from sffr_gym.task.reference import desired
from sffr_gym.task.signals import SIGNALS
from sffr_gym.types import Array

TIPS = (("axial", "m"), ("transverse", "m"), ("slope", "rad"))
SIGNAL_UNITS = dict(zip(SIGNALS, ("m", "rad", "J", "m", "N", "N m", "V2", "N", "N2 m2", "1", "1", "1"), strict=True))
DAMPING = ("N s/m", "N s/m", "N m s/rad")  # of the tip coordinates


class Column(NamedTuple):
    """A column of a history."""

    name: str
    unit: str  #: SI
    frame: str  #: in whose axes: inertial, base, panel, joint (relative to the link before), or - for none
    values: Array  #: (rows,)


def history(trajectory: Trajectory) -> list[Column]:
    """Return the columns of an episode: a row for each recorded state, with what acted from then on.

    Signals are those of the end of the control period before; the first row has those of the first period.
    """
    plant = Simulator(trajectory.episode.plant)
    columns = [Column("time", "s", "-", trajectory.t)]
    columns += _coordinates(plant, trajectory)
    columns += _desired(plant, trajectory)
    columns += _acting(plant, trajectory)
    rows = np.clip(np.round(trajectory.t / trajectory.period).astype(int) - 1, 0, len(trajectory.signals) - 1)
    measured = trajectory.signals[rows].T
    units = (SIGNAL_UNITS[name] for name in SIGNALS)
    return columns + [Column(name, unit, "-", own) for name, unit, own in zip(SIGNALS, units, measured, strict=True)]


def _coordinates(plant: Simulator, trajectory: Trajectory) -> list[Column]:
    """Return positions and rates of base, joints, object, panel tips and modes."""
    params, model = plant.params, plant.model
    labels, modes = coordinate_labels(params, model), mode_slice(model)
    frames = ["inertial"] * N_BASE + ["joint"] * (modes.start - N_BASE) + ["panel"] * (modes.stop - modes.start)
    frames += ["inertial"] * (len(labels) - len(frames))
    tips = [Label(f"{mount.name}_tip_{kind}", unit) for mount in params.panel.mounts for kind, unit in TIPS]
    columns = []
    for values, label_of in ((trajectory.p, lambda label: label), (trajectory.v, rate_of)):
        for label, frame, own in zip(labels, frames, values.T, strict=True):
            name, unit = label_of(label)
            columns.append(Column(name, unit, frame, own))
        own = np.array([nodal(model, row[modes])[:, -N_TIP:].ravel() for row in values])
        for k, label in enumerate(tips):
            name, unit = label_of(label)
            columns.append(Column(name, unit, "panel", own[:, k]))
    return columns


def _desired(plant: Simulator, trajectory: Trajectory) -> list[Column]:
    """Return where the object, or without one the base, should be."""
    carried, place = ("object", object_slice(plant.model)) if plant.params.object else ("base", slice(0, N_BASE))
    reference, turned = trajectory.reference, "phi" if plant.params.object else "yaw"
    offset = reference.phi if plant.params.object else reference.yaw
    rows = [desired(reference, float(t)) for t in trajectory.t]
    goal = np.array([(row.x, row.y, row.heading + offset) for row in rows])
    assert place.stop - place.start == goal.shape[1]
    units = ("m", "m", "rad")
    return [
        Column(f"{carried}_{name}_desired", unit, "inertial", own)
        for name, unit, own in zip(("x", "y", turned), units, goal.T, strict=True)
    ]


def _acting(plant: Simulator, trajectory: Trajectory) -> list[Column]:
    """Return what the actuators gave, virtual damping, and the internal forces."""
    params, model = plant.params, plant.model
    labels = command_labels(params, model, plant.actuators)
    n_volts = len(labels) - N_BASE - len(model.link_mass)
    frames = ["panel"] * n_volts + ["base"] * N_BASE + ["joint"] * len(model.link_mass)
    columns = [
        Column(*label, frame, own) for label, frame, own in zip(labels, frames, trajectory.applied.T, strict=True)
    ]
    for i, mount in enumerate(params.panel.mounts):
        for k, (kind, _) in enumerate(TIPS):
            columns.append(Column(f"{mount.name}_damping_{kind}", DAMPING[k], "panel", trajectory.B_hat[:, i, k]))
    q_flex, lam = _internal(plant, trajectory)
    names = (("panels_force_x", "N"), ("panels_force_y", "N"), ("panels_moment", "N m"))
    columns += [Column(*name, "inertial", own) for name, own in zip(names, q_flex.T, strict=True)]
    for g, grasp in enumerate(params.object.grasps if params.object else ()):
        columns += [Column(f"{grasp.arm}_grasp_{axis}", "N", "inertial", lam[:, g, k]) for k, axis in enumerate("xy")]
    return columns


def _internal(plant: Simulator, trajectory: Trajectory) -> tuple[Array, Array]:
    """Return Q_flex (rows, 3) and the object's forces on the grippers (rows, n_g, 2), inertial axes.

    As the compiled loop recorded them, or solved for where a law was stepped.
    """
    q_flex, lam = trajectory.q_flex.copy(), trajectory.lam.copy()
    for row, p in enumerate(trajectory.p):
        if np.isfinite(q_flex[row]).all() and np.isfinite(lam[row]).all():
            lam[row] = lam[row] @ rotation(p[2]).T
            continue
        state = plant.unflatten(float(trajectory.t[row]), p, trajectory.v[row])
        volts, base, joints = plant.split(trajectory.applied[row])
        q_flex[row] = plant.q_flex(state, base=base, joints=joints, piezo_volts=volts)[:N_BASE]
        lam[row] = plant.grasp_forces(state, base=base, joints=joints, piezo_volts=volts)
    return q_flex, lam
