"""Reading of ``progress.csv``, without torch."""

from __future__ import annotations

from pathlib import Path

from sffr_agents.folder import STEPS
from sffr_gym.config.reading import MOST_CSV, parse_csv, read_text


def read_progress(file: Path) -> list[dict[str, str]]:
    """Return the rows of a training's log; one that was cut off when its process died is none.

    Raises:
        ConfigError: if the file cannot be read or is damaged otherwise.
    """
    whole, newline, _ = read_text(file, MOST_CSV).rpartition("\n")
    return parse_csv(whole + newline, [STEPS], str(file))
