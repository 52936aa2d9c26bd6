"""What leaves for other tools: linear models and the histories of runs, as tables and matrices."""

from sffr_workbench.export.linear import LINEAR_SUFFIXES, linear_arrays, linear_bytes

__all__ = ["LINEAR_SUFFIXES", "linear_arrays", "linear_bytes"]
