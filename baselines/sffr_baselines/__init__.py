"""Reference controllers of the case study: HSC and AHSC of the paper, and what they are compared with."""

from sffr_baselines.own_law import ControlLaw, UnfitError
from sffr_baselines.policies import POLICIES, Policy, make_policy

__all__ = ["POLICIES", "ControlLaw", "Policy", "UnfitError", "make_policy"]
