"""Reference controllers of the case study: HSC and AHSC of the paper, and what they are compared with."""

from pathlib import Path

from sffr_gym.compile.cache import cache_sources

cache_sources(__name__, Path(__file__).parent.rglob("*.py"))

from sffr_baselines.policies import POLICIES, Policy, make_policy  # noqa: E402  (kernels after the cache is named)

__all__ = ["POLICIES", "Policy", "make_policy"]
