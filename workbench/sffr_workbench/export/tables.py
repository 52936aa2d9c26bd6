"""Histories as files: CSV, MATLAB's ``.mat`` and Parquet, each with the units and frames of its columns."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.io import savemat

from sffr_gym.config.files import to_json
from sffr_workbench.common import require
from sffr_workbench.export.histories import Column

FORMS = ("csv", "mat", "parquet")
SCHEMA_FILE = "schema.json"


def table_bytes(columns: Sequence[Column], form: str) -> bytes:
    """Return the content of a file of a history.

    Args:
        columns: of as many rows each.
        form: one of ``FORMS``; ``parquet`` needs the extra of that name.

    Raises:
        ConfigError: if what a form needs is not installed.
    """
    return {"csv": _csv, "mat": _mat, "parquet": _parquet}[form](columns)


def schema(columns: Sequence[Column]) -> str:
    """Return what the columns are, as JSON: name, unit, frame of each, in order."""
    entries = [{"name": each.name, "unit": each.unit, "frame": each.frame} for each in columns]
    return to_json({"format": "sffr-history-1", "columns": entries})


def check_form(form: str) -> None:
    """Make sure that what a form needs is installed; raises ConfigError."""
    if form == "parquet":
        require("parquet", "pyarrow")


def _csv(columns: Sequence[Column]) -> bytes:
    """Return a table with a line of names; numbers have all their digits, and are empty where there is none."""
    rows = np.column_stack([each.values for each in columns]).tolist()
    lines = [",".join(each.name for each in columns)]
    lines += [",".join("" if value != value else repr(value) for value in row) for row in rows]
    return ("\n".join(lines) + "\n").encode()


def _mat(columns: Sequence[Column]) -> bytes:
    """Return a file with a vector for each column, and the cells ``names``, ``units`` and ``frames``."""
    entries: dict[str, Any] = {each.name: each.values for each in columns}
    for kind in "name", "unit", "frame":
        entries[f"{kind}s"] = np.array([getattr(each, kind) for each in columns], dtype=object)
    file = io.BytesIO()
    savemat(file, entries, do_compression=True, oned_as="column", long_field_names=True)
    return file.getvalue()


def _parquet(columns: Sequence[Column]) -> bytes:
    """Return a table whose fields have their unit and frame as metadata."""
    import pyarrow as arrow  # optional
    from pyarrow import parquet

    fields = [
        arrow.field(each.name, arrow.float64(), metadata={"unit": each.unit, "frame": each.frame}) for each in columns
    ]
    table = arrow.table([arrow.array(each.values) for each in columns], schema=arrow.schema(fields))
    file = io.BytesIO()
    parquet.write_table(table, file)
    return file.getvalue()
