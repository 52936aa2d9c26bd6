"""Where a result comes from, in words; the data are those of :mod:`sffr_gym.config.provenance`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def describe_versions(versions: Mapping[str, str | None]) -> str:
    """Return names and versions of what is installed."""
    return ", ".join(f"{name} {version}" for name, version in versions.items() if version)


def describe_commit(git: Mapping[str, Any] | None) -> str:
    """Return the commit of a ``git_state``, and whether anything differs from it."""
    return f"{git['commit'][:12]}{', with changes' if git.get('dirty') else ''}" if git else "unknown"
