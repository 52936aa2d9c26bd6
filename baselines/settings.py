"""Numbers of the policies that were computed and not taken from the paper, read from ``configs/policies``."""

from __future__ import annotations

import functools
from typing import TypeVar

from pydantic import Field

from sffr_gym import config
from sffr_gym.params import Params
from sffr_gym.sections import NonNegative, Positive, Section

SettingsT = TypeVar("SettingsT", bound=Section)


class Damping(Section):
    """Constant virtual damping of the bending coordinates, and where it comes from."""

    q5: NonNegative = Field(description="of the tip's transverse displacement [N s/m]")
    q6: NonNegative = Field(description="of the tip's slope [N m s/rad]")
    cost: NonNegative = Field(description="what it scored where it was tuned, AHSC scoring 1 [-]")
    hsc_cost: NonNegative = Field(description="what HSC with B0 scored there [-]")
    command: str = Field(description="what found it")
    date: str = Field(description="when")

    def applied_to(self, prior: Params) -> Params:
        """The parameters with this damping as B0; that of the axial coordinate stays."""
        return prior.with_overrides(f"suppression.B0=[{prior.suppression.B0[0]!r}, {self.q5!r}, {self.q6!r}]")


class Weights(Section):
    """What the linear-quadratic regulator minimises: energy plus priced effort."""

    effort: Positive = Field(description="price of a squared volt [J/V2]")


@functools.cache
def load_damping() -> Damping:
    """The damping of ``hsc-tuned``; raises ConfigError if the file is not valid."""
    return _load(Damping, "hsc-tuned")


@functools.cache
def load_weights() -> Weights:
    """The weights of ``lqr``; raises ConfigError if the file is not valid."""
    return _load(Weights, "lqr")


def _load(model: type[SettingsT], name: str) -> SettingsT:
    data, where = config.read_mapping(config.find_config(name, folder="policies"))
    return config.build(model, data, where)
