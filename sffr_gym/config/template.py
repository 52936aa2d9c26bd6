"""The border in front of compiled code: what comes from outside must have the form of a template.

Compiled code trusts the shapes and types of what it gets. States, checkpoints and recordings are compared here, once,
with an object of the form that they must have.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from sffr_gym.config.errors import one_line


def conform(value: Any, template: Any, where: str) -> Any:
    """Return ``value`` if it has the form of ``template``.

    Arrays must have the template's shape and type, mappings its keys, named tuples and objects its class, lists and
    tuples its length, generators its bit generator; None in the template accepts anything. What a number may be is for
    those to check who know what it means.

    Args:
        value: what came from outside.
        template: an object of the right form.
        where: what it is, for messages, such as ``state``.

    Raises:
        ValueError: for another form; the message names the place, what is there and what must be.
    """
    for difference in _differences(value, template, where):
        raise ValueError(difference)
    return value


def contiguous(value: Any) -> Any:
    """Return mappings and tuples of arrays with all arrays as compiled code has them: aligned, row by row."""
    if isinstance(value, np.ndarray):
        return np.require(value, requirements=["C", "ALIGNED"]).reshape(value.shape)
    if isinstance(value, Mapping):
        return {key: contiguous(entry) for key, entry in value.items()}
    if hasattr(value, "_fields"):
        return type(value)(*map(contiguous, value))
    return value


def _differences(value: Any, template: Any, where: str) -> Iterator[str]:
    """Yield what is different, in words."""
    if template is None:
        return
    if isinstance(template, np.ndarray):
        yield from _array_differences(value, template, where)
    elif isinstance(template, np.random.Generator):
        own, other = type(template.bit_generator).__name__, type(getattr(value, "bit_generator", value)).__name__
        if own != other:
            yield f"{where}: must be a generator of {own}, is {other}"
    elif hasattr(template, "_fields") or isinstance(template, list | tuple):
        yield from _sequence_differences(value, template, where)
    elif isinstance(template, Mapping):
        yield from _mapping_differences(value, template, where)
    elif not isinstance(value, type(template)):
        yield f"{where}: must be of type {type(template).__name__}, is {type(value).__name__}"


def _array_differences(value: Any, template: np.ndarray, where: str) -> Iterator[str]:
    if not isinstance(value, np.ndarray):
        yield f"{where}: must be an array, is {type(value).__name__}"
    elif value.shape != template.shape:
        yield f"{where}: must have the shape {template.shape}, has {value.shape}"
    elif value.dtype != template.dtype:
        yield f"{where}: must be of type {template.dtype}, is {value.dtype}"


def _sequence_differences(value: Any, template: Sequence[Any], where: str) -> Iterator[str]:
    if type(value) is not type(template):
        yield f"{where}: must be a {type(template).__name__}, is {type(value).__name__}"
    elif len(value) != len(template):
        yield f"{where}: must have {len(template)} entries, has {len(value)}"
    else:
        names = getattr(template, "_fields", range(len(template)))
        for name, entry, own in zip(names, value, template, strict=True):
            yield from _differences(entry, own, f"{where}.{name}")


def _mapping_differences(value: Any, template: Mapping[Any, Any], where: str) -> Iterator[str]:
    if not isinstance(value, Mapping):
        yield f"{where}: must be a mapping, is {type(value).__name__}"
        return
    if missing := [key for key in template if key not in value]:
        yield f"{where}: has no {missing[0]!r}"
    elif unknown := [key for key in value if key not in template]:
        yield f"{where}: has '{one_line(str(unknown[0]))}', which is unknown"
    for key in template:
        yield from _differences(value[key], template[key], f"{where}.{key}")
