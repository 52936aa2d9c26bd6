"""Checks of the simulator against derivations and engines that its authors did not write, and their report.

The engines are in the extra ``verify``; what is missing fails its own checks alone.
"""

from verification.check import Check, Picture
from verification.page import FILE, number, write_page
from verification.suite import NAMES, SECTIONS, missing_libraries, run_checks

__all__ = ["FILE", "NAMES", "SECTIONS", "Check", "Picture", "missing_libraries", "number", "run_checks", "write_page"]
