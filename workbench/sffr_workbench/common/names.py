"""Names of files after what a user has named."""

from __future__ import annotations

from urllib.parse import quote

from sffr_gym.config.files import short_hash

LONGEST = 120  # characters, of the 255 that a file system allows, an ending and that of an unfinished file besides


def file_name(name: str) -> str:
    """Return a name as that of a file: without separators, and cut where it would be too long, with its hash behind."""
    quoted = quote(name, safe="")
    return quoted if len(quoted) <= LONGEST else f"{quoted[: LONGEST - 17]}-{short_hash(name)}"
