"""All measurements by name."""

from __future__ import annotations

from collections.abc import Callable

from sffr_gym import ConfigError
from sffr_gym.config.suggestion import did_you_mean
from sffr_workbench.speed.environments import batches, single, vector
from sffr_workbench.speed.growth import growth
from sffr_workbench.speed.measure import Section
from sffr_workbench.speed.memory import memory
from sffr_workbench.speed.physics import closed_loop, physics
from sffr_workbench.speed.precision import precision
from sffr_workbench.speed.profile import profile
from sffr_workbench.speed.starts import starts

REPEATS, QUICK_REPEATS = 7, 2

MEASUREMENTS: dict[str, Callable[[int, bool], Section]] = {
    "physics": physics,
    "loop": closed_loop,
    "gym": single,
    "vector": vector,
    "batches": batches,
    "growth": growth,
    "memory": memory,
    "starts": starts,
    "precision": precision,
    "profile": profile,
}


def choose(only: str | None) -> list[str]:
    """Return names of the measurements in a list such as ``physics,gym``; all of them for None.

    Raises:
        ConfigError: for an unknown name (with the nearest one).
    """
    if only is None:
        return list(MEASUREMENTS)
    names = [name.strip() for name in only.split(",")]
    for name in names:
        if name not in MEASUREMENTS:
            raise ConfigError(
                f"unknown measurement {name!r}{did_you_mean(name, MEASUREMENTS)} (known: {', '.join(MEASUREMENTS)})"
            )
    return names
