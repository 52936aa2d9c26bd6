"""``progress.csv``: what a training logs, one row for each time, kept through a resumption."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

from stable_baselines3.common.logger import KVWriter

from sffr_agents.folder import STEPS
from sffr_gym.config.files import write_whole


class CsvLog(KVWriter):
    """Stable-Baselines3's logger output as a CSV file that can be continued.

    Args:
        file: where; rows in it up to ``steps`` stay, later ones are of a process that was killed.
        steps: where the training goes on, 0 for a new one.
    """

    def __init__(self, file: Path, steps: int = 0) -> None:
        self._file = file
        self._rows: list[dict[str, Any]] = []
        self._begun = False  # whether the file holds what was kept and no more
        if steps > 0 and file.is_file():
            whole, _, _ = file.read_text(encoding="utf-8").rpartition("\n")  # the last row may have been cut off
            self._rows = [row for row in csv.DictReader(whole.splitlines()) if int(row[STEPS]) <= steps]

    def write(self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0) -> None:
        """Add a row; a new column rewrites the whole file."""
        columns = self._columns()
        self._rows.append({STEPS: step} | {name: value for name, value in key_values.items() if _is_number(value)})
        text = io.StringIO()
        writer = csv.DictWriter(text, self._columns(), restval="", lineterminator="\n")
        if self._columns() == columns and self._begun:
            writer.writerow(self._rows[-1])
            with self._file.open("a", encoding="utf-8") as file:
                file.write(text.getvalue())
            return
        writer.writeheader()
        writer.writerows(self._rows)
        write_whole(self._file, text.getvalue().encode())
        self._begun = True

    def close(self) -> None:
        """Nothing is open between two rows."""

    def _columns(self) -> list[str]:
        """Return the names of all columns, in the order in which they came."""
        return list(dict.fromkeys(name for row in self._rows for name in row))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) or hasattr(value, "item")
