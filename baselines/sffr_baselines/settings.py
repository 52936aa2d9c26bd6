"""Constants of the policies that were computed instead of taken from the paper, read from ``configs/policies``."""

from __future__ import annotations

import functools
from typing import Annotated

from pydantic import Field

from sffr_gym.config.params import Params
from sffr_gym.config.ranges import Damping, Text
from sffr_gym.config.sections import Section
from sffr_gym.config.strict_yaml import build, find_config, read_mapping

Cost = Annotated[float, Field(ge=0.0, le=1.0e12)]  # relative to AHSC's


class TunedDamping(Section):
    """Constant virtual damping of the bending coordinates, and where it comes from."""

    q5: Damping = Field(description="of the tip's transverse displacement [N s/m]")
    q6: Damping = Field(description="of the tip's slope [N m s/rad]")
    cost: Cost = Field(description="what it scored where it was tuned, AHSC scoring 1 [-]")
    hsc_cost: Cost = Field(description="what HSC with B0 scored there [-]")
    command: Text = Field(description="what found it")
    date: Text = Field(description="when")

    def applied_to(self, prior: Params) -> Params:
        """Return the parameters with this damping as B0; that of the axial coordinate stays."""
        return prior.with_overrides(f"suppression.B0=[{prior.suppression.B0[0]!r}, {self.q5!r}, {self.q6!r}]")


class RegulatorWeights(Section):
    """What the linear-quadratic regulator minimises: energy plus priced effort."""

    effort: float = Field(ge=1.0e-12, le=1.0e12, description="price of squared volts over what the score makes it [-]")
    swing: float = Field(ge=1.0e-6, le=1.0e3, description="tip amplitude at which AHSC's effort is taken [m]")


@functools.cache
def load_tuned_damping() -> TunedDamping:
    """Return the damping of ``hsc-tuned``; raises ConfigError if the file is not valid."""
    return build(TunedDamping, *read_mapping(find_config("hsc-tuned", folder="policies")))


@functools.cache
def load_regulator_weights() -> RegulatorWeights:
    """Return the weights of ``lqr``; raises ConfigError if the file is not valid."""
    return build(RegulatorWeights, *read_mapping(find_config("lqr", folder="policies")))
