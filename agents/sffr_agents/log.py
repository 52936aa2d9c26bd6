"""What a training logs: ``progress.csv``, one row for each time, and TensorBoard's files; both survive a resumption."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

from stable_baselines3.common.logger import KVWriter, TensorBoardOutputFormat

from sffr_agents.folder import STEPS
from sffr_agents.progress import read_progress
from sffr_gym.config.files import write_whole
from sffr_gym.config.strict_yaml import ConfigError

OF_A_PROCESS = ("time/fps", "time/iterations", "time/time_elapsed")  # tell nothing of the whole run


class CsvLog(KVWriter):
    """Stable-Baselines3's logger output as a CSV file that can be continued.

    Args:
        file: where; rows in it up to ``steps`` stay, later ones are of a process that was killed.
        steps: where the training goes on, 0 for a new one.

    Raises:
        ConfigError: if the file is damaged.
    """

    def __init__(self, file: Path, steps: int = 0) -> None:
        self._file = file
        self._rows: list[dict[str, Any]] = []
        self._begun = False  # whether the file holds what was kept and no more
        if steps > 0 and file.is_file():
            self._rows = [dict(row) for row in read_progress(file) if _step(file, row) <= steps]

    def write(self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0) -> None:
        """Add a row; a new column rewrites the whole file."""
        columns = self._columns()
        self._rows.append({STEPS: step} | numbers(key_values))
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


class Board(TensorBoardOutputFormat):
    """TensorBoard's files in a folder; it is told to forget what a killed process wrote after ``steps``."""

    def __init__(self, folder: Path, steps: int) -> None:
        from torch.utils.tensorboard import SummaryWriter  # may not be installed

        first = steps + 1 if steps else None  # of those that go
        self.writer = SummaryWriter(log_dir=str(folder), purge_step=first)
        self._is_closed = False


def numbers(values: dict[str, Any]) -> dict[str, int | float]:
    """Return what a logger holds as Python's own numbers, so that they are written alike before and after a kill."""
    plain = {name: value.item() if getattr(value, "ndim", None) == 0 else value for name, value in values.items()}
    return {name: value for name, value in plain.items() if isinstance(value, int | float) and name not in OF_A_PROCESS}


def _step(file: Path, row: dict[str, str]) -> int:
    """Return the step of a row; raises ConfigError for anything else."""
    try:
        return int(row[STEPS])
    except ValueError:
        raise ConfigError(f"{file}: {STEPS} = {row[STEPS]!r}: must be a whole number") from None
