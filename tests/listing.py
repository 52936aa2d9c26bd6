"""What lies in a folder."""

from pathlib import Path

from sffr_gym.config.run_folder import LOCK


def listing(folder: Path) -> dict[str, bytes]:
    """Return all files of a folder but the lock, with their content."""
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in sorted(folder.rglob("*"))
        if file.is_file() and file.name != LOCK
    }
