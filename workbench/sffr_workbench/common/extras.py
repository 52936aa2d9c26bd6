"""Optional packages: whether they are there, and how to install them."""

from __future__ import annotations

from importlib.util import find_spec

from sffr_gym import ConfigError


def is_missing(module: str) -> bool:
    """Return whether a module is not installed."""
    return find_spec(module) is None


def require(extra: str, *modules: str) -> None:
    """Make sure that modules of an extra are installed.

    Raises:
        ConfigError: if one is not, with the command that installs it.
    """
    if missing := [module for module in modules if is_missing(module)]:
        raise ConfigError(f"not installed: {', '.join(missing)}; pip install 'sffr-gym[{extra}]'")
