"""The parameters: every key of the file is read, and nothing else; their identity and plain form."""

import json
import math
import pickle
import re

import pytest
import yaml
from plain_params import LEAVES, PATCHES, TIP, flatten, message_or_nothing, rejection, shipped_tree
from pydantic import BaseModel, ValidationError

from sffr_gym.config.params import Params, load_params
from sffr_gym.config.sections import PANEL_KEYS, Base, PanelMount
from sffr_gym.config.strict_yaml import SHIPPED, ConfigError, config_dir

OTHER_WORDS = {
    "fixed": "tangent",
    "none": "zv",
    "etdrk4": "rk4",
    "auto": "all",
    "exact": "staggered",
    "generalized": "tip",
    "continuous": "on-off",
}
OBSERVER = dict.fromkeys(("position", "angle", "velocity", "rate", "acceleration", "angular_acceleration"), 0.1)
# Keys that another one refers to change together with it.
TOGETHER = {
    "arms.0.name": {"arms.0.name": "first", "object.grasps.0.arm": "first"},
    "arms.1.name": {"arms.1.name": "second", "object.grasps.1.arm": "second"},
    "object.grasps.0.arm": {"object.grasps.0.arm": "arm2", "object.grasps.1.arm": "arm1"},
    "object.grasps.1.arm": {"object.grasps.0.arm": "arm2", "object.grasps.1.arm": "arm1"},
    **{
        f"{PATCHES}.{i}.1": {f"{PATCHES}.{i}.1": 0.1 * i + 0.105, f"{PATCHES}.{i + 1}.0": 0.1 * i + 0.105}
        for i in range(3)
    },
    f"{TIP}.0.1": {f"{TIP}.0.1": 0.99},
    "initial.reach": {"initial.reach": "auto"},
    "path.speed": {"path.speed": 0.9, "initial.qd.0": 0.9},  # else the start follows the path
    "path.kind": {"path.kind": "line", "initial.qd.0": 0.1},
    "path.heading": {"path.heading": "tangent", "initial.qd.2": 0.85 / 15.0},
}


def sections(tree, prefix=""):
    """Return the dotted keys of all the mappings below the root, with their own keys."""
    found = {prefix: list(tree)} if isinstance(tree, dict) else {}
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for part, value in items:
        found |= sections(value, f"{prefix}.{part}".lstrip("."))
    return found


def put(tree, key, value):
    """Set the leaf at a dotted key."""
    *parents, last = [int(part) if part.isdecimal() else part for part in key.split(".")]
    for part in parents:
        tree = tree[part]
    tree[last] = value


def other_value(leaf, key=""):
    """Return a valid value that differs from a shipped one."""
    if leaf is None:
        return OBSERVER if key.endswith("observer") else 2.5
    if isinstance(leaf, bool):
        return not leaf
    if isinstance(leaf, str):
        return OTHER_WORDS.get(leaf, leaf + "2")
    return leaf + 1 if isinstance(leaf, int) else leaf * 1.01 if leaf else 0.01


KEYS = [(section, name) for section, names in sections(shipped_tree()).items() for name in names]


def test_loaded_values_are_those_of_the_file(params):
    """Nothing is dropped, renamed, converted or added; a plain YAML reader sees the same numbers."""
    assert flatten(params.to_dict()) == LEAVES
    assert len(LEAVES) > 100


def test_no_field_has_a_default_and_every_number_has_a_unit():
    """The file alone holds the values, and messages can name the unit; a mount may leave out what it does not have."""

    def check(model):
        for name, field in model.model_fields.items():
            assert field.is_required() or (model is PanelMount and name in PANEL_KEYS), name
            inner = [each for each in models_in(field.annotation)]
            assert field.description if inner else re.search(r"\[.+\]$", field.description), name
            for each in inner:
                check(each)

    def models_in(annotation):
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            return [annotation]
        return [found for arg in getattr(annotation, "__args__", ()) for found in models_in(arg)]

    check(Params)


@pytest.mark.parametrize("key", list(LEAVES))
def test_every_key_changes_the_loaded_object(params, key, tmp_path):
    """An override and a file change the value at the key, the same way, and nothing else."""
    changes = TOGETHER.get(key, {key: other_value(LEAVES[key], key)})
    tree = shipped_tree()
    for each, value in changes.items():
        put(tree, each, value)
    changed = params.with_overrides(*(f"{each}={value!r}" for each, value in changes.items()))
    assert flatten(changed.to_dict()) == flatten(tree)
    assert changed != params
    assert changed.hash() != params.hash()
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(tree))
    assert load_params(path) == changed


@pytest.mark.parametrize(("section", "name"), KEYS)
def test_misspelled_key_raises_with_the_nearest_name(section, name, tmp_path):
    """Each key of each mapping, with one letter too many, is rejected and the right one is suggested."""
    tree = shipped_tree()
    owner = tree
    for part in section.split(".") if section else ():
        owner = owner[int(part) if part.isdecimal() else part]
    wrong = name + name[-1]
    owner[wrong] = owner.pop(name)
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(tree))
    with pytest.raises(ConfigError) as caught:
        load_params(path)
    key = re.escape(f"{section}.{wrong}".lstrip("."))
    assert re.search(rf"mine\.yaml:\d+: {key}: unknown key; did you mean '{name}'\? \(known: ", str(caught.value))


@pytest.mark.parametrize("key", LEAVES)
def test_missing_or_wrongly_typed_value_raises(params, key):
    """No leaf accepts an empty mapping, nor what is of another type."""
    right = {str: "'1.0'", bool: "true", type(None): "null"}.get(type(LEAVES[key]))
    for value in {"{}", "true", "null", "'1.0'"} - {right}:
        message = rejection(params, f"{key}={value}")
        missing = key == "control.observer" and value == "{}"
        assert message.startswith(f"override '{key}={value}': {key}{'.' if missing else f' = {value}: must be '}")


@pytest.mark.parametrize("key", [key for key, leaf in LEAVES.items() if isinstance(leaf, float)])
def test_numbers_accept_integers_and_reject_nonfinite(params, key):
    """A float may be written as an integer; NaN and infinity are rejected everywhere."""
    assert f"{key} = nan: must be finite" in rejection(params, f"{key}=.nan")
    assert f"{key} = inf: must be finite" in rejection(params, f"{key}=.inf")
    assert f"{key} = inf: must be finite" in rejection(params, f"{key}=1e400")
    assert "must be a number" not in message_or_nothing(params, f"{key}=1")


def test_integer_and_float_give_the_same_object(params):
    """25 and 25.0 are one value, with one hash."""
    whole, real = params.with_overrides("panel.EI=25"), params.with_overrides("panel.EI=25.0")
    assert whole == real
    assert whole.hash() == real.hash()
    assert isinstance(whole.panel.EI, float)


def test_objects_are_immutable_hashable_and_pickle(params):
    """No attribute can be set, sequences are tuples, equal objects hash alike."""
    with pytest.raises(ValidationError, match="frozen"):
        params.panel.EI = 3.0
    with pytest.raises(ValidationError, match="frozen"):
        params.object = None
    with pytest.raises(ValidationError, match="extra_forbidden"):
        Base(mass=1.0, inertia=1.0, side=1.0, colour=1.0)
    again = load_params("sffr")
    assert again is not params
    assert hash(again) == hash(params) != hash(params.with_overrides("panel.EI=21"))
    assert pickle.loads(pickle.dumps(params)) == params
    assert isinstance(params.arms, tuple)
    assert isinstance(params.initial.q, tuple)


def test_the_shipped_parameters_are_those_of_their_file(params, tmp_path, monkeypatch):
    """As it is now: they are kept for as long as it stays the same, and no longer."""
    text = (config_dir() / SHIPPED).read_text(encoding="utf-8")
    monkeypatch.setattr("sffr_gym.config.params.config_dir", lambda: tmp_path)
    (tmp_path / SHIPPED).write_text(text, encoding="utf-8")
    assert load_params() == params and load_params() is load_params()
    (tmp_path / SHIPPED).write_text(text.replace("mass: 50", "mass: 51"), encoding="utf-8")
    assert load_params() == params.with_overrides("base.mass=51")


def test_manifest_round_trip(params):
    """The plain form survives JSON, and the short hash depends on the values alone."""
    tree = json.loads(json.dumps(params.to_dict()))
    again = Params.model_validate(dict(reversed(tree.items())))
    assert again == params
    assert again.hash() == params.hash()
    assert re.fullmatch(r"[0-9a-f]{16}", params.hash())


def test_derived_values(params):
    """Counts and the period of the circle follow the stored values."""
    assert (params.n_links, params.n_panels) == (6, 2)
    assert params.path.period == pytest.approx(2 * math.pi * 15.0 / 0.85, rel=1e-15)
    assert "period" not in params.to_dict()["path"]
