"""All measurements by name."""

from __future__ import annotations

import difflib
from collections.abc import Callable

from agents.bench.environments import single, vector
from agents.bench.growth import growth
from agents.bench.measure import Section
from agents.bench.memory import memory
from agents.bench.physics import closed_loop, physics
from agents.bench.precision import precision
from agents.bench.profile import profile
from agents.bench.starts import starts
from sffr_gym import ConfigError

REPEATS, QUICK_REPEATS = 7, 2

MEASUREMENTS: dict[str, Callable[[int, bool], Section]] = {
    "physics": physics,
    "loop": closed_loop,
    "gym": single,
    "vector": vector,
    "growth": growth,
    "memory": memory,
    "starts": starts,
    "precision": precision,
    "profile": profile,
}


def choose(only: str | None) -> list[str]:
    """Names of the measurements in a list such as ``physics,gym``; all of them for None.

    Raises:
        ConfigError: for an unknown name (with the nearest one).
    """
    if only is None:
        return list(MEASUREMENTS)
    names = [name.strip() for name in only.split(",")]
    for name in names:
        if name not in MEASUREMENTS:
            near = difflib.get_close_matches(name, MEASUREMENTS, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise ConfigError(f"unknown measurement {name!r}{hint} (known: {', '.join(MEASUREMENTS)})")
    return names
