"""Nested values as JSON and arrays: what a checkpoint is written as, so that nothing of it is run when it is read."""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np

NUMBERS = ("nan", "inf", "-inf")  # that JSON does not know


def encode(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    """Return a value as JSON, and put its arrays into ``arrays`` under the names by which it calls them."""
    if isinstance(value, np.ndarray):
        name = f"a{len(arrays)}"
        arrays[name] = value
        return {"array": name}
    if isinstance(value, np.random.Generator):
        return {"generator": dict(value.bit_generator.state)}
    if isinstance(value, dict):
        return {"items": {name: encode(entry, arrays) for name, entry in value.items()}}
    if isinstance(value, list | tuple):
        return [encode(entry, arrays) for entry in value]
    value = value.item() if isinstance(value, np.generic) else value
    return {"number": str(value)} if isinstance(value, float) and not isfinite(value) else value


def decode(saved: Any, template: Any, arrays: dict[str, np.ndarray]) -> Any:
    """Undo :func:`encode`, with None in place of arrays that are not there.

    Args:
        saved: any JSON.
        template: whose tuples, with names or without, become those of the result where it has as many entries.
        arrays: by name; each is taken out, so that no two values share one.

    Raises:
        ValueError: for what :func:`encode` does not write.
    """
    if isinstance(saved, list):
        return _decode_list(saved, template, arrays)
    if not isinstance(saved, dict):
        return saved
    if len(saved) != 1:
        raise ValueError(f"must have one of array, generator, items and number, has {', '.join(map(repr, saved))}")
    ((kind, content),) = saved.items()
    if kind == "array" and isinstance(content, str):
        return arrays.pop(content, None)
    if kind == "generator":
        return _generator(content)
    if kind == "number" and content in NUMBERS:
        return float(content)
    if kind != "items" or not isinstance(content, dict):
        raise ValueError(f"{kind!r} is no kind of value, or its content none of that kind")
    known = template if isinstance(template, dict) else {}
    return {name: decode(entry, known.get(name), arrays) for name, entry in content.items()}


def _decode_list(saved: list[Any], template: Any, arrays: dict[str, np.ndarray]) -> Any:
    """Return a list, or the tuple that the template has in its place."""
    fits = isinstance(template, list | tuple) and len(template) == len(saved)
    parts = template if fits else [None] * len(saved)
    values = [decode(entry, part, arrays) for entry, part in zip(saved, parts, strict=True)]
    if fits and hasattr(template, "_fields"):
        return type(template)(*values)
    return tuple(values) if isinstance(template, tuple) else values


def _generator(state: Any) -> np.random.Generator:
    """Return a generator with a state; raises ValueError if that is none of PCG64, the only kind that is written."""
    bits = np.random.PCG64(0)
    try:
        bits.state = state
    except (TypeError, ValueError, KeyError, OverflowError):
        raise ValueError("a generator's state is none of PCG64") from None
    own = bits.state  # where what did not fit was cut off
    if own != state or own["has_uint32"] not in (0, 1) or own["state"]["inc"] % 2 == 0:
        raise ValueError("a generator's state is none of PCG64")
    return np.random.Generator(bits)
