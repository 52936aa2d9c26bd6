"""What the speed is meant to be, and whether one run meets it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from sffr_workbench.speed.measure import Section
from sffr_workbench.speed.precision import TARGET

Sections = Mapping[str, Section]


class Target(NamedTuple):
    """A target and what came out."""

    what: str  #: for people
    value: float  #: measured
    required: float  #: the bound
    at_least: bool  #: whether that is the lowest allowed value, else the highest
    unit: str  #: of both

    @property
    def met(self) -> bool:
        """Whether the value keeps the bound; NaN does not."""
        return self.value >= self.required if self.at_least else self.value <= self.required


class _Rule(NamedTuple):
    what: str
    section: str
    value: Callable[[Section], float]
    required: float
    at_least: bool
    unit: str


def _fastest_peer(section: Section) -> float:
    """Return the rate of the fastest HalfCheetah vector environment, of any size and kind."""
    return max(row.median for row in section.rows if row.versus)


def _change(section: Section) -> float:
    """Return the largest change of resident memory after the first tenth of a run, relative [%]."""
    changes = []
    for row in section.rows:
        start, *later = row.samples[max(len(row.samples) // 10 - 1, 0) :]
        changes += [100.0 * abs(reading / start - 1.0) for reading in later]
    return max(changes)


def _ratio(key: str, versus: str) -> Callable[[Section], float]:
    return lambda section: section[key].median / section[versus].median


_RULES = (
    _Rule("physics alone against MuJoCo RK4", "physics", lambda s: s.ratio(s["RK4"]), 7.0, True, "times"),
    _Rule(
        "physics alone against MuJoCo implicitfast", "physics",
        lambda s: s.ratio(s["implicitfast"]), 2.0, True, "times",
    ),
    _Rule(
        "relative error over the circle at 2 ms", "precision",
        lambda s: s["sffr-gym ETDRK4 2 ms"].extra["error_max"], TARGET, False, "",
    ),
    _Rule("closed loop with AHSC", "loop", lambda s: s["ahsc"].median, 400.0, True, "times real time"),
    _Rule("gym.make against HalfCheetah-v5", "gym", lambda s: s.ratio(s["peer"]), 3.0, True, "times"),
    _Rule("vector environment of 1024", "vector", lambda s: s["ours-1024"].median, 1_000_000.0, True, "periods/s"),
    _Rule(
        "the same against the fastest HalfCheetah-v5 vector environment", "vector",
        lambda s: s["ours-1024"].median / _fastest_peer(s), 80.0, True, "times",
    ),
    _Rule(
        "65,536 environments against 1,024, random actions", "batches", _ratio("large-random", "random"), 1.0, True, "",
    ),
    _Rule("random actions with their resets against none", "batches", _ratio("random", "still"), 0.8, True, ""),
    _Rule("robots that differ against such that are alike", "batches", _ratio("mismatch", "still"), 0.7, True, ""),
    _Rule("import sffr_gym", "starts", lambda s: s["import"].median, 0.8, False, "s"),
    _Rule("start to first step of gym.make", "starts", lambda s: s["single"].median, 1.0, False, "s"),
    _Rule("change of resident memory after a tenth of the run", "memory", _change, 1.0, False, "%"),
)  # fmt: skip


def check_targets(sections: Sequence[Section]) -> list[Target]:
    """Check the targets whose sections were measured, in full."""
    measured = {section.name: section for section in sections}
    return [
        Target(rule.what, rule.value(measured[rule.section]), rule.required, rule.at_least, rule.unit)
        for rule in _RULES
        if rule.section in measured
    ]
