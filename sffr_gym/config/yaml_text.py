"""Texts in YAML become values, or errors: bounded in size, depth and references, by the rules of YAML 1.2's core."""

from __future__ import annotations

import copy
import functools
import re
from collections.abc import Iterator
from typing import Any

import yaml

from sffr_gym.config.errors import one_line

Key = tuple[Any, ...]  # path from the root: names of keys, positions in lists

MOST_YAML = 100_000  # bytes; the shipped case study has 6,000, and PyYAML reads 100,000 in about a second
MOST_VALUES = 20_000  # in a text, once all its references (*name) are written out
MOST_DEPTH = 50  # of lists and mappings in each other; the shipped case study has 5
# Beside its own errors, PyYAML lets through what Python raises on values such as "!!bool maybe" or "!!int ''".
UNREADABLE = (yaml.YAMLError, ValueError, LookupError, AttributeError, TypeError, OverflowError, RecursionError)


class _Loader(yaml.SafeLoader):
    """Safe loader that reads numbers and words as YAML 1.2 does, rejects a key given twice and what is nested deeply.

    PyYAML follows YAML 1.1, in which ``3e-4`` is a text, ``010`` is eight, ``1:30`` is ninety and ``off`` is false.
    """

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}
    depth = 0

    def compose_node(self, parent: Any, index: Any) -> yaml.Node | None:
        """Compose a node and raise if it lies too deep."""
        self.depth += 1
        if self.depth > MOST_DEPTH:
            raise yaml.YAMLError("it is nested too deeply")
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node

    def compose_scalar_node(self, anchor: Any) -> yaml.ScalarNode:
        """Compose a scalar and raise if it is no text that could be written: half of a surrogate pair is none."""
        node = super().compose_scalar_node(anchor)
        try:
            node.value.encode()
        except UnicodeEncodeError:
            raise yaml.MarkedYAMLError(problem="half of a surrogate pair", problem_mark=node.start_mark) from None
        return node

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """Compose a mapping and raise if two of its keys are the same."""
        node = super().compose_mapping_node(anchor)
        seen = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if (key.tag, key.value) in seen:
                    raise yaml.MarkedYAMLError(problem=f"key {key.value!r} is given twice", problem_mark=key.start_mark)
                seen.add((key.tag, key.value))
        return node


for _tag, _pattern, _first in (
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("merge", r"<<", "<"),
    ("int", r"[-+]?(0|[1-9][0-9]*)", "-+0123456789"),
    (
        "float",
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        "-+.0123456789",
    ),
):
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(f"^(?:{_pattern})$"), list(_first))


def parse_yaml(text: str) -> tuple[Any, dict[Key, int]]:
    """Return the value of a YAML text and the line of each key.

    Raises:
        Exception: one of ``UNREADABLE``, which :func:`explain_unreadable` puts into words.
    """
    value, lines = _parsed(text)
    return copy.deepcopy(value), dict(lines)


@functools.lru_cache(maxsize=64)
def _parsed(text: str) -> tuple[Any, dict[Key, int]]:
    """Return what :func:`parse_yaml` does: the shipped files are read again for each environment."""
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        _check_expansion(node)
        lines = dict(_lines(node, ()))  # before the construction, which moves merged keys about
        return (None if node is None else loader.construct_document(node)), lines
    finally:
        loader.dispose()


def _check_expansion(node: yaml.Node | None) -> None:
    """Raise if a few references in a text stand for more values than anybody would write out."""
    counts: dict[int, int] = {}

    def count(node: yaml.Node) -> int:
        if id(node) not in counts:
            children: list[Any] = node.value if isinstance(node, yaml.CollectionNode) else []
            parts = [part for child in children for part in (child if isinstance(child, tuple) else (child,))]
            counts[id(node)] = 1 + sum(map(count, parts))
        return counts[id(node)]

    if node is not None and (values := count(node)) > MOST_VALUES:
        raise yaml.YAMLError(f"holds {values:.3g} values once its references are written out, at most {MOST_VALUES}")


def _lines(node: yaml.Node | None, key: Key) -> Iterator[tuple[Key, int]]:
    children: list[tuple[Any, yaml.Node, yaml.Node]] = []
    if isinstance(node, yaml.MappingNode):
        children = [(name.value, name, value) for name, value in node.value if isinstance(name, yaml.ScalarNode)]
    elif isinstance(node, yaml.SequenceNode):
        children = [(index, value, value) for index, value in enumerate(node.value)]
    for part, mark, value in children:
        yield (*key, part), mark.start_mark.line + 1
        yield from _lines(value, (*key, part))


def explain_unreadable(error: Exception) -> str:
    """Return what is wrong with a text, for a message."""
    if isinstance(error, RecursionError):
        return "cannot be read: something in it refers to itself"
    if isinstance(error, yaml.reader.ReaderError):
        return f"cannot be read as YAML: character {error.position + 1} is {error.character:#04x}"
    return f"cannot be read as YAML: {one_line(str(getattr(error, 'problem', None) or error))}"
