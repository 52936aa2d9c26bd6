"""Errors that a model finds between its fields, reported at the key that they are about."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError
from pydantic_core import InitErrorDetails

from sffr_gym.config.strict_yaml import check_error


def error_at(key: tuple[str | int, ...], value: Any, reason: str) -> InitErrorDetails:
    """Return an error that pydantic reports at a key below the model that is being checked."""
    return InitErrorDetails(type=check_error(reason), loc=key, input=value)


def raise_errors(errors: list[InitErrorDetails]) -> None:
    """Raise the errors together, if there are any."""
    if errors:
        raise ValidationError.from_exception_data("Params", errors)
