"""Constants of the policies that were computed instead of taken from the paper, read from ``configs/policies``."""

from __future__ import annotations

import functools
from typing import Annotated, ClassVar, Self

from pydantic import Field

from sffr_gym.config.params import Params
from sffr_gym.config.ranges import Damping, Text
from sffr_gym.config.sections import Section
from sffr_gym.config.strict_yaml import build, find_config, read_mapping

Cost = Annotated[float, Field(ge=0.0, le=1.0e12)]  # relative to AHSC's
Pair = tuple[
    Annotated[float, Field(ge=1.0e-6, le=1.0e3)], Annotated[float, Field(ge=1.0e-6, le=1.0e3)]
]  # of the two bending modes
StiffnessShare = Annotated[float, Field(ge=1.0e-6, lt=1.0)]  # positive feedback of more of it is unstable
Swing = Annotated[float, Field(ge=1.0e-6, le=1.0e3)]  # m


class Found(Section):
    """Where settings come from that an optimiser found."""

    cost: Cost = Field(description="what the law scored where it was tuned, AHSC scoring 1 [-]")
    start_cost: Cost = Field(description="what it scored there with the settings that the search began from [-]")
    command: Text = Field(description="what found it")
    date: Text = Field(description="when")


class Settings(Section):
    """Settings of a law, of which ``sffr tune-law`` searches some."""

    SEARCHED: ClassVar[tuple[str, ...]]  #: names of positive numbers, or of tuples of them

    found: Found | None = Field(default=None, description="what was found, if an optimiser did")

    @classmethod
    def start(cls, prior: Params) -> Self:
        """Return what a search begins from, for a robot."""
        raise NotImplementedError


class TunedDamping(Settings):
    """Constant virtual damping of the bending coordinates."""

    SEARCHED = ("q5", "q6")

    q5: Damping = Field(description="of the tip's transverse displacement [N s/m]")
    q6: Damping = Field(description="of the tip's slope [N m s/rad]")

    @classmethod
    def start(cls, prior: Params) -> Self:
        """Begin from B(0)."""
        return cls(q5=prior.suppression.B0[1], q6=prior.suppression.B0[2])

    def applied_to(self, prior: Params) -> Params:
        """Return the parameters with this damping as B0; that of the axial coordinate stays."""
        return prior.with_overrides(f"suppression.B0=[{prior.suppression.B0[0]!r}, {self.q5!r}, {self.q6!r}]")


class RegulatorWeights(Settings):
    """What the linear-quadratic regulator minimises: energy plus priced effort."""

    SEARCHED = ("effort",)

    effort: float = Field(ge=1.0e-12, le=1.0e12, description="price of squared volts over what the score makes it [-]")
    swing: Swing = Field(description="tip amplitude at which AHSC's effort is taken [m]")

    @classmethod
    def start(cls, prior: Params) -> Self:
        """Begin from the score's price at the swing of the shipped file."""
        return cls(effort=1.0, swing=0.1)


class FilterSettings(Settings):
    """Filters of positive position feedback, of the first and the second bending mode."""

    SEARCHED = ("gain", "damping", "frequency", "swing")

    gain: tuple[StiffnessShare, StiffnessShare] = Field(description="share of each mode's stiffness that it takes [-]")
    damping: Pair = Field(description="damping ratio of each filter [-]")
    frequency: Pair = Field(description="frequency of each filter over its mode's [-]")
    swing: Swing = Field(description="tip amplitude of the first mode up to which the piezos are to suffice [m]")

    @classmethod
    def start(cls, prior: Params) -> Self:
        """Begin from filters a little faster than their modes, near the least mean energy of a clamped panel."""
        return cls(gain=(0.65, 0.5), damping=(0.6, 0.65), frequency=(1.2, 1.15), swing=0.05)


TUNED: dict[str, type[Settings]] = {  # the laws that have settings, by the names of their files
    "hsc-tuned": TunedDamping,
    "lqr": RegulatorWeights,
    "mpc": RegulatorWeights,
    "ppf": FilterSettings,
}


@functools.cache
def load_settings(name: str) -> Settings:
    """Return the shipped settings of a key of ``TUNED``; raises ConfigError if the file is not valid."""
    return build(TUNED[name], *read_mapping(find_config(name, folder="policies")))
