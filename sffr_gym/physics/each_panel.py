"""What differs from panel to panel: their integrals and modes, computed once for those that are alike."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TypeVar

from sffr_gym.config.params import Params
from sffr_gym.config.sections import Panel
from sffr_gym.physics.beam import Beam, Modes, beam, clamped_modes, slowest_modes

T = TypeVar("T")


def panel_beams(params: Params) -> list[Beam]:
    """Return the shape integrals of each panel; without panels those of the one that is configured."""
    return of_each_panel(params, _beam)


def panel_modes(params: Params) -> list[Modes]:
    """Return the clamped modes of each panel; without panels those of the one that is configured.

    The cuts are those of the configured panel: of each other one as many of its slowest modes are kept. Foreshortened
    panels keep their length.
    """
    panel = params.panel
    shared = _modes_of(*_numbers(panel), 0.0 if panel.foreshortening else panel.axial_cut, panel.bending_cut)
    return of_each_panel(params, lambda each: shared if each is panel else slowest_modes(_beam(each), shared))


def of_each_panel(params: Params, function: Callable[[Panel], T]) -> list[T]:
    """Return what a function gives for each panel, computed once for those that are alike; at least for one panel."""
    panels = params.panel.each or (params.panel,)
    values = {key: function(panel) for key, panel in {id(each): each for each in panels}.items()}
    return [values[id(panel)] for panel in panels]


def _beam(panel: Panel) -> Beam:
    return _beam_of(*_numbers(panel))


def _numbers(panel: Panel) -> tuple[float, float, float, float, int]:
    """Return what a panel's integrals depend on, as :func:`beam` takes it."""
    return panel.mass, panel.length, panel.EI, panel.E * panel.area, panel.elements


@functools.lru_cache(maxsize=64)
def _beam_of(mass: float, length: float, EI: float, EA: float, elements: int) -> Beam:
    """Return what :func:`beam` does, for all who read it."""
    integrals = beam(mass, length, EI, EA, elements)
    for each in integrals[3:]:
        each.setflags(write=False)
    return integrals


@functools.lru_cache(maxsize=64)
def _modes_of(
    mass: float, length: float, EI: float, EA: float, elements: int, axial_cut: float, bending_cut: float
) -> Modes:
    """Return what :func:`clamped_modes` does, for all who read it."""
    modes = clamped_modes(_beam_of(mass, length, EI, EA, elements), axial_cut, bending_cut)
    for each in (modes.omega, modes.shapes):
        each.setflags(write=False)
    return modes
