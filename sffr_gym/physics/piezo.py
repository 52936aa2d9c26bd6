"""Piezo arrays of a panel: what each channel pushes, from the geometry of the patches (Eqs. 14 and 15).

``generalized`` has a channel for each elastic coordinate of the tip, as the paper's law needs. ``patches`` (near the
root) and ``tip`` (where the paper puts them) are pairs of patches bonded to both faces, a channel for each face. A
patch under voltage pushes the two sections at its ends apart with a force F along its face. That face lies at ``y``,
plus or minus half the panel's thickness, and stretches by ``u' - y w''`` per unit length; the work on it gives a force
on the elastic coordinates of ``F ([U] - y [W'])``, the brackets being differences between the patch's two ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sffr_gym.config.actuator_sections import Piezo
from sffr_gym.config.params import Params
from sffr_gym.config.sections import Panel
from sffr_gym.physics.beam import N_TIP, Modes, section_motion
from sffr_gym.physics.each_panel import panel_modes
from sffr_gym.types import Array


class Channels(NamedTuple):
    """The channels of one panel."""

    gain: Array  #: (n_c,) force [N] or moment [N m] for one volt
    reach: Array  #: (n_f, n_c) displacement [m] or slope that it works on, for a unit of each nodal coordinate


def channels(piezo: Piezo, panel: Panel, elements: int) -> Channels:
    """Return the channels of the chosen array on a panel of so many elements.

    Bonded pairs run from the root outwards, of each the upper face (positive transverse displacement) first.
    """
    if piezo.array == "generalized":
        reach = np.eye(N_TIP * elements)[:, -N_TIP:]
        return Channels(np.array([piezo.force, piezo.force, piezo.moment]) / piezo.voltage, reach)
    half, columns = thickness(panel) / 2, []
    for start, stop in piezo.patches if piezo.array == "patches" else piezo.tip:
        (u_start, slope_start), (u_stop, slope_stop) = (
            section_motion(panel.length, elements, place) for place in (start, stop)
        )
        columns += [u_stop - u_start - y * (slope_stop - slope_start) for y in (half, -half)]
    return Channels(np.full(len(columns), piezo.force / piezo.voltage), np.column_stack(columns))


def thickness(panel: Panel) -> float:
    """Return the thickness [m] of the rectangular section with the panel's area and stiffness, ``sqrt(12 I / a)``."""
    return float(np.sqrt(12.0 * panel.EI / (panel.E * panel.area)))


def authority(params: Params, array: str) -> tuple[Modes, Array]:
    """Return what an array can do: its forces on the modes of a clamped panel.

    Args:
        params: the robot, with a first panel whose elements and cuts decide the modes.
        array: ``generalized``, ``patches`` or ``tip``.

    Returns:
        The modes, and the modal force (n_m, n_c) of each channel for one volt [N / (kg^(1/2) V)].
    """
    panel, modes = (params.panel.each or (params.panel,))[0], panel_modes(params)[0]
    gain, reach = channels(params.actuators.piezo.model_copy(update={"array": array}), panel, panel.elements)
    return modes, modes.shapes.T @ reach * gain
