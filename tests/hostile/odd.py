"""Odd values of any kind, and changes of plain values: what strangers, editors and broken disks leave in files."""

from __future__ import annotations

import math
from typing import Any

import yaml
from hypothesis import strategies as st

WHOLE = (0, 1, -1, 2, 63, 64, 65, 2**31, -(2**31), 2**63, -(2**63) - 1, 10**12, 10**30, 10**400)
REAL = (
    0.0, -0.0, 1e-300, 5e-324, 1e-30, 1e-12, 1e-6, 1e-3, 0.5, 1.0000001, -1.0, 90.0, 360.0, 1e4, 1e6, 1e12, 1e100,
    1e300, 1.7e308, -1e300, math.inf, -math.inf, math.nan,
)  # fmt: skip
TEXTS = (
    "", " ", "0", "1e400", "nan", "NaN", "inf", "null", "true", "~", "=", "<<", "*a", "&a", "!!python/name:os.system",
    "../outside/secret.txt", "../../outside/secret.txt", "/nowhere/secret.txt", "/dev/zero",
    "a" * 5000, "a\nb", "a\r\nerror: all is well", "\x00", "a\x00b",
    "\x1b[2J\x1b[31m", "\u202eabc", "\ufeff", "\u2028", "\ud7ff\ue000", "\U0001f600" * 20, "e\u0301" * 50,
    "[red]x[/red]", "[/]", "<script>alert(1)</script>", "</script>", "{{7*7}}", "${HOME}", "%s%n", "{0.__class__}",
    "'", '"', "`", ",", "a,b", "a;b", "=1+1", "nominal", "ahsc", "left",
)  # fmt: skip

NUMBERS = (
    "-1", "0", "0.5", "1e3", "1e-300", "1e400", "nan", "-inf", "+1", "1_000", "\u0661", "0x10", " 1", "1 ", "9" * 21,
    "2147483648", "-0", "1.", ".", "--", "1,5", "1;2", "10**9",
)  # fmt: skip

numbers = st.one_of(
    st.sampled_from(WHOLE), st.sampled_from(REAL), st.integers(-5, 200), st.floats(), st.floats(1e-9, 1e9)
)
texts = st.one_of(st.sampled_from(TEXTS), st.text(max_size=20))
plain = st.one_of(st.none(), st.booleans(), numbers, texts)
values = st.recursive(
    plain,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(texts, inner, max_size=3),
    ),
    max_leaves=6,
)  # fmt: skip


def deep(depth: int) -> Any:
    """Return lists in each other."""
    value: Any = []
    for _ in range(depth):
        value = [value]
    return value


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the path of every value within a value, itself first."""
    found = [path]
    if isinstance(value, dict):
        found += [place for key, entry in value.items() for place in places(entry, (*path, key))]
    elif isinstance(value, list):
        found += [place for k, entry in enumerate(value) for place in places(entry, (*path, k))]
    return found


def at(value: Any, path: tuple[Any, ...]) -> Any:
    """Return what stands at a path."""
    for key in path:
        value = value[key]
    return value


def put(value: Any, path: tuple[Any, ...], new: Any) -> Any:
    """Return a value with another one at a path."""
    if not path:
        return new
    copy = dict(value) if isinstance(value, dict) else list(value)
    copy[path[0]] = put(value[path[0]], path[1:], new)
    return copy


@st.composite
def changed(draw: st.DrawFn, value: Any) -> tuple[Any, str]:
    """Draw a change of plain mappings, lists and scalars; returns the value and what was done."""
    path = draw(st.sampled_from(places(value)[1:] or [()]))
    old = at(value, path)
    label = ".".join(map(str, path))[:80]
    ways = ["replace", "replace", "replace", "nest", "text"]
    if isinstance(old, int | float) and not isinstance(old, bool):
        ways += ["scale", "scale", "number", "number", "number"]
    if isinstance(old, dict):
        ways += ["drop", "add", "rename", "empty"]
    if isinstance(old, list):
        ways += ["shorten", "repeat", "swap", "empty"]
    way = draw(st.sampled_from(ways))
    new: Any = old
    if way == "replace":
        new = draw(values)
    elif way == "nest":
        new = draw(st.sampled_from([[old], {"a": old}, deep(10), deep(60), deep(900)]))
    elif way == "text":
        new = draw(texts)
    elif way == "scale":
        factor = draw(st.sampled_from([-1, 1e-9, 1e-3, 0.1, 10, 57.29578, 1000, 1e9]))
        new = old * factor if abs(old) < 1e300 else -old
    elif way == "number":
        new = draw(numbers)
    elif way == "empty":
        new = type(old)()
    elif way == "drop" and old:
        gone = draw(st.sampled_from(sorted(old, key=str)))
        new = {key: entry for key, entry in old.items() if key != gone}
        label += f" without {gone}"
    elif way == "add":
        new = {**old, draw(texts): draw(values)}
    elif way == "rename" and old:
        gone, name = draw(st.sampled_from(sorted(old, key=str))), draw(texts)
        new = {name if key == gone else key: entry for key, entry in old.items()}
    elif way in ("shorten", "repeat", "swap") and old:
        k = draw(st.integers(0, len(old) - 1))
        new = {"shorten": [*old[:k], *old[k + 1 :]], "repeat": [*old[:k], old[k], *old[k:]], "swap": old[::-1]}[way]
    return put(value, path, new), f"{label}: {way} -> {repr(new)[:60]}"


def dumped(value: Any) -> bytes:
    """Return a value as YAML."""
    try:
        return yaml.safe_dump(value, allow_unicode=True, sort_keys=False).encode("utf-8", "surrogatepass")
    except RecursionError:
        return b"base: " + b"[" * 5000
