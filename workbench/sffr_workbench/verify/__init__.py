"""Checks of the simulator against derivations and engines that its authors did not write, and their page.

The engines are in the extra ``verify``; what is missing fails its own checks alone.
"""

from sffr_workbench.verify.check import Check, CheckFigure
from sffr_workbench.verify.page import PAGE_FILE, write_page
from sffr_workbench.verify.suite import NAMES, SECTIONS, missing_libraries, run_checks

__all__ = ["NAMES", "PAGE_FILE", "SECTIONS", "Check", "CheckFigure", "missing_libraries", "run_checks", "write_page"]
