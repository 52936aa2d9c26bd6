"""Files as every command writes them, whole or not at all; JSON without what JSON does not know; hashes of values."""

from __future__ import annotations

import hashlib
import json
import os
from contextlib import suppress
from math import isfinite
from pathlib import Path
from typing import Any

from sffr_gym.config.errors import ConfigError


def to_json(value: Any) -> str:
    """Return JSON with indentation; NaN and infinities, which JSON has not, become null."""
    return json.dumps(_plain(value), indent=2, allow_nan=False) + "\n"


def canonical_json(value: Any) -> str:
    """Return the one JSON text of plain values, whatever the order of their keys."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


def short_hash(value: Any) -> str:
    """Return the first 16 hexadecimal digits of the SHA-256 of plain values in canonical JSON."""
    return hashlib.sha256(canonical_json(value).encode()).hexdigest()[:16]


def check_target(file: Path, overwrite: bool = False) -> None:
    """Make sure, before anything runs, that a file may be written.

    Raises:
        ConfigError: if something is there that is not to be replaced or is no file, or its folder is not there or
            cannot be written.
    """
    try:
        if "\0" in str(file):
            raise ValueError("embedded null byte")
        if file.is_dir():
            raise ConfigError(f"{file}: is a folder; name a file with --out")
        if os.path.lexists(file) and not overwrite:
            raise ConfigError(f"{file}: is there already; choose another name with --out or add --overwrite")
        above = file.absolute().parent
        while not above.exists():
            above = above.parent
    except (OSError, ValueError) as error:
        if isinstance(error, ConfigError):
            raise
        raise ConfigError(f"{str(file)!r}: is no name of a file: {error}") from None
    if not (above.is_dir() and os.access(above, os.W_OK | os.X_OK)):
        reason = "cannot be written to" if above.is_dir() else "is not a folder"
        raise ConfigError(f"{file}: cannot be written: {above} {reason}")


def write_whole(path: Path, content: bytes) -> Path:
    """Write a file under another name and put it into place, so that no reader ever finds a part of it.

    Raises:
        OSError: if it cannot be written, which names the file, whatever could not be done; the old one is left then.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        part.write_bytes(content)
        os.replace(part, path)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
    finally:
        with suppress(OSError):  # of a folder that cannot be written any more
            part.unlink()
    return path


def _plain(value: Any) -> Any:
    """Return the same with NaN and infinities replaced by None and NumPy's numbers by plain ones."""
    if isinstance(value, dict):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if hasattr(value, "item"):
        value = value.item()
    return None if isinstance(value, float) and not isfinite(value) else value
