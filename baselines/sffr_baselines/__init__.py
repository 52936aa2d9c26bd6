"""Reference controllers of the case study: HSC and AHSC of the paper, and what they are compared with."""

from sffr_baselines.policies import POLICIES, Policy, make_policy

__all__ = ["POLICIES", "Policy", "make_policy"]
