"""Parameters as plain data, and the messages that reject them."""

import json

import pytest
import yaml

from sffr_gym.config.strict_yaml import ConfigError, config_dir

SHIPPED = config_dir() / "sffr.yaml"
PATCHES, TIP = "actuators.piezo.patches", "actuators.piezo.tip"


def flatten(tree, prefix=""):
    """Return {dotted key: leaf} of nested mappings and lists."""
    if not isinstance(tree, dict | list):
        return {prefix: tree}
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    return {key: leaf for part, value in items for key, leaf in flatten(value, f"{prefix}.{part}".lstrip(".")).items()}


def put(tree, key, value):
    """Return a copy of nested plain values with another one at a dotted key."""
    copy = json.loads(json.dumps(tree))
    *parents, last = [int(part) if part.isdecimal() else part for part in key.split(".")]
    place = copy
    for part in parents:
        place = place[part]
    place[last] = value
    return copy


AS_READ = json.dumps(yaml.safe_load(SHIPPED.read_text()))


def shipped_tree():
    """Return the shipped file as PyYAML's own loader reads it, a copy for each who asks."""
    return json.loads(AS_READ)


LEAVES = flatten(shipped_tree())


def rejection(params, *assignments):
    """Return the message that rejects some overrides."""
    with pytest.raises(ConfigError) as caught:
        params.with_overrides(*assignments)
    return str(caught.value)


def message_or_nothing(params, assignment):
    """Return the message that rejects an override, or nothing."""
    try:
        params.with_overrides(assignment)
    except ConfigError as error:
        return str(error)
    return ""
