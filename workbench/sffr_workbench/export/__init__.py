"""What leaves for other tools: linear models and the histories of runs, as tables and matrices."""

from sffr_workbench.export.histories import Column, history
from sffr_workbench.export.linear import LINEAR_SUFFIXES, linear_arrays, linear_bytes
from sffr_workbench.export.run import Choice, export_run
from sffr_workbench.export.tables import FORMS

__all__ = [
    "FORMS", "LINEAR_SUFFIXES", "Choice", "Column", "export_run", "history", "linear_arrays", "linear_bytes",
]  # fmt: skip
