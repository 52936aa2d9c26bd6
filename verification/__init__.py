"""Checks of the simulator against derivations and engines that its authors did not write, and their report.

The engines are in the extra ``verify``; what is missing fails its own checks alone.
"""

from verification.check import Check, Picture
from verification.page import number, write_page
from verification.suite import compile_kernels, run_checks

__all__ = ["Check", "Picture", "compile_kernels", "number", "run_checks", "write_page"]
