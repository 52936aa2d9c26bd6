"""Files as every command writes them, whole or not at all; JSON without what JSON does not know; hashes of values."""

from __future__ import annotations

import hashlib
import json
import os
from math import isfinite
from pathlib import Path
from typing import Any


def to_json(value: Any) -> str:
    """Return JSON with indentation; NaN and infinities, which JSON has not, become null."""
    return json.dumps(_plain(value), indent=2, allow_nan=False) + "\n"


def canonical_json(value: Any) -> str:
    """Return the one JSON text of plain values, whatever the order of their keys."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


def short_hash(value: Any) -> str:
    """Return the first 16 hexadecimal digits of the SHA-256 of plain values in canonical JSON."""
    return hashlib.sha256(canonical_json(value).encode()).hexdigest()[:16]


def write_whole(path: Path, content: bytes) -> Path:
    """Write a file under another name and put it into place, so that no reader ever finds a part of it."""
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        part.write_bytes(content)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
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
