"""Hashes of scenarios and suites: every value counts, the wording does not."""

import pytest
import yaml

from sffr_gym.config.strict_yaml import config_dir
from sffr_gym.task.scenario import Scenario, load_scenario, scenario_names, suite_hash


def leaves(tree, prefix=()):
    """Yield the path of every value of nested lists and mappings."""
    if not isinstance(tree, dict | list):
        yield prefix
        return
    for part, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
        yield from leaves(value, (*prefix, part))


NOT_GIVEN = {  # else an interval
    "duration": 2.5, "impulses": {"count": 1, "linear": 1.0, "angular": 1.0}, "on_off": 0.3, "angle": [0.1, 0.2],
}  # fmt: skip

OTHER_WORD = {"piezo": "joint", "thruster": "piezo", "joint": "thruster"}


def other_value(key, value):
    """Return a valid value that differs from one of a scenario's file."""
    if value is None:
        return NOT_GIVEN.get(key, [1.0, 1.1])
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return OTHER_WORD.get(value, f"{value} x")
    return value + 1 if isinstance(value, int) else 0.99 * value or 0.01


def with_other_value(tree, path):
    """Return a copy of a tree with another value at a path."""
    copy = dict(tree) if isinstance(tree, dict) else list(tree)
    part, *rest = path
    copy[part] = with_other_value(tree[part], rest) if rest else other_value(part, tree[part])
    return copy


@pytest.mark.parametrize("name", scenario_names())
def test_every_value_changes_the_hash(params, name):
    """Each value of a file is a part of its hash, as are the parameters; its wording is not."""
    dumped = load_scenario(name).model_dump(mode="json")
    hashes = {"as it is": load_scenario(name).hash(params)}
    for path in leaves(dumped):
        changed = Scenario.model_validate(with_other_value(dumped, path))
        hashes[path] = changed.hash(params)
    assert hashes.pop(("description",)) == hashes["as it is"]
    assert len(set(hashes.values())) == len(hashes)
    assert load_scenario(name).hash(params.with_overrides("panel.EI=20.5")) not in hashes.values()


def test_a_suite_is_its_scenarios_in_any_order(params):
    """The hash of a suite knows each of its scenarios and the parameters, but no order."""
    suite = [load_scenario(name) for name in scenario_names()]
    whole = suite_hash(suite, params)
    assert len(whole) == 16 and int(whole, 16) >= 0
    assert suite_hash(suite[::-1], params) == whole
    smaller = {suite_hash(suite[:k] + suite[k + 1 :], params) for k in range(len(suite))}
    assert len(smaller | {whole}) == len(suite) + 1
    assert suite_hash(suite, params.with_overrides("reward.effort.weight=0.1")) != whole


def test_comments_and_the_order_of_keys_do_not_change_the_hash(params, tmp_path):
    """A file that says the same in other words has the same hash."""
    content = yaml.safe_load((config_dir() / "scenarios" / "excited.yaml").read_text(encoding="utf-8"))
    file = tmp_path / "other.yaml"
    file.write_text(yaml.safe_dump(dict(reversed(content.items())), sort_keys=False), encoding="utf-8")
    assert load_scenario(file).hash(params) == load_scenario("excited").hash(params)
