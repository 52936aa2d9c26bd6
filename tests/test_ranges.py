"""Ranges: every number of every kind of file has two ends, names can be shown, and nobody confuses units unnoticed."""

import math
import re

import numpy as np
import pytest
from plain_params import LEAVES, flatten, put, rejection

from sffr_agents.config import CONFIGS, load_config
from sffr_agents.tune_config import TuneConfig
from sffr_gym import ConfigError, load_params
from sffr_gym.config.actuator_sections import MOST_SPANS
from sffr_gym.config.arguments import check_arguments
from sffr_gym.config.sections import MOST_ARMS, MOST_LINKS, MOST_PANELS
from sffr_gym.config.strict_yaml import build
from sffr_gym.task.scenario import MOST_FAULTS, MOST_MODES, EpisodeRange, Scenario, load_scenario

SCENARIO = {
    "name": "all", "description": "draws everything", "duration": 2.0, "offset_position": 0.1, "offset_angle": 0.1,
    "panel_modes": [{"mode": 1, "amplitude": [0.0, 0.1]}], "speed": [0.6, 1.2],
    "plant": {name: [0.5, 2.0] for name in ("object", "EI", "panel_mass", "link_mass")},
    "sensors": dict.fromkeys(("position", "angle", "velocity", "rate", "delay"), 0.5),
    "faults": [{"actuators": "piezo", "remaining": 0.5}], "impulses": {"count": 1, "linear": 1.0, "angular": 1.0},
}  # fmt: skip
SEARCH = {"train": "ppo", "seeds": 3, "trials": 30, "space": [{"key": "learning.gamma", "low": 0.1, "high": 0.9}]}
ARGUMENTS = {"episodes": 1, "seed": 0}
FILES = {
    "params": (type(load_params()), load_params().to_dict()),
    "scenario": (Scenario, SCENARIO),
    "search": (TuneConfig, SEARCH),
    "episodes": (EpisodeRange, ARGUMENTS),
    **{algo: (CONFIGS[algo], load_config(algo).model_dump(mode="json")) for algo in CONFIGS},
}
ENDLESS = ("space.0.low", "space.0.high")  # ends of a search, which the training's own ranges check
NUMBERS = [
    (kind, key)
    for kind, (_, tree) in FILES.items()
    for key, leaf in flatten(tree).items()
    if isinstance(leaf, int | float) and not isinstance(leaf, bool) and key not in ENDLESS
]
ANGLES = [
    *(f"initial.q.{k}" for k in range(2, 9)), "initial.qf.2", "limits.angle", "panel.mounts.1.angle",
    "arms.3.mount_angle",
]  # fmt: skip
DEGREES = {"offset_angle": 3.0, "sensors.angle": 2.0}


def message_of(kind, key, value):
    """Return the message that rejects a value."""
    model, tree = FILES[kind]
    with pytest.raises(ConfigError) as caught:
        build(model, put(tree, key, value), lambda key: "file")
    return str(caught.value)


def test_all_kinds_of_files_are_valid_as_they_are():
    """Else nothing below would show anything; and there are the numbers of all of them."""
    for model, tree in FILES.values():
        build(model, tree, lambda key: "file")
    assert len(NUMBERS) > 150 and {kind for kind, _ in NUMBERS} == set(FILES)


@pytest.mark.parametrize(("kind", "key"), NUMBERS)
def test_every_number_has_two_ends(kind, key):
    """What is huge either way, more than a float holds, and no number at all is refused by the key's name."""
    is_whole = isinstance(flatten(FILES[kind][1])[key], int)
    name = re.sub(r"(\.\d+)+$", "", key)  # an interval is refused as one
    sizes = (10**18, -(10**18), 10**400) if is_whole else (1e300, -1e300, 10**400, math.nan, math.inf)
    for value in (*sizes, True, "1", [1], 1j, *([1.0] if is_whole else [])):
        assert f"file: {name}" in message_of(kind, key, value)


@pytest.mark.parametrize("key", ANGLES)
def test_degrees_are_not_taken_for_radians(params, key):
    """More than a turn, or more than a beam's slope, is no angle in radians."""
    assert f"{key} = 90.0: must be at most" in rejection(params, f"{key}=90.0")


@pytest.mark.parametrize("key", DEGREES)
def test_degrees_of_a_scenario_are_not_taken_for_radians(key):
    """As in the parameters."""
    assert f"{key} = {DEGREES[key]}: must be at most 1" in message_of("scenario", key, DEGREES[key])


@pytest.mark.parametrize(
    ("kind", "key", "most"),
    [
        ("params", "arms", MOST_ARMS), ("params", "arms.0.links", MOST_LINKS), ("params", "panel.mounts", MOST_PANELS),
        ("params", "actuators.piezo.patches", MOST_SPANS), ("scenario", "panel_modes", MOST_MODES),
        ("scenario", "faults", MOST_FAULTS), ("ppo", "network.hidden", 16),
    ],
)  # fmt: skip
def test_lists_have_an_end(kind, key, most):
    """With the reason."""
    tree = FILES[kind][1]
    for part in key.split("."):
        tree = tree[int(part) if part.isdecimal() else part]
    said = message_of(kind, key, [tree[0]] * (most + 1))
    assert f"{key} = [" in said and f"must have at most {most} entries, has {most + 1}: " in said


@pytest.mark.parametrize("name", ["", "a\nb", "a\x1b[31m", "\ud800", "x" * 65])
def test_names_can_be_shown(name):
    """In a table, a file name and a terminal."""
    assert "name = " in message_of("scenario", "name", name)
    assert "arms.3.name = " in message_of("params", "arms.3.name", name)


def test_every_number_of_the_parameters_is_among_the_tested_ones():
    """The shipped file has all keys."""
    assert {key for kind, key in NUMBERS if kind == "params"} == {
        key for key, leaf in LEAVES.items() if isinstance(leaf, int | float) and not isinstance(leaf, bool)
    }


def test_numbers_of_numpy_are_numbers():
    """And are checked as such."""
    assert check_arguments(EpisodeRange, episodes=np.int64(3), seed=np.uint8(7)) == EpisodeRange(episodes=3, seed=7)
    for wrong in (np.bool_(True), np.float64(3.0), np.int64(0)):
        with pytest.raises(ConfigError, match=r"argument: episodes = "):
            check_arguments(EpisodeRange, episodes=wrong)


@pytest.mark.parametrize(
    ("algo", "changes", "message"),
    [
        ("ppo", ["learning.batch_size=8193"], r"batch_size = 8193: must be at most the 8192 samples of an update"),
        (
            "ppo",
            ["learning.n_steps=100000"],
            r"n_steps = 100000: an update would take 1.3e\+07 samples, at most 1e\+07",
        ),
        ("ppo", ["network.hidden=[2048, 2048]"], r"hidden = .* makes a network of 33.9 MB, at most 16"),
        ("ppo", ["environment.overrides=[panel.EI=-1]"], r"override 'panel.EI=-1': panel.EI = -1: must be at least"),
        (
            "ppo",
            ["network.hidden=[1000, 1000]", "environment.stack_size=100", "network.per_panel=false"],
            r"hidden = .* makes a network of 36.8 MB, at most 16",
        ),
        (
            "ppo",
            ["environment.stack_size=100", "learning.n_steps=1000"],
            r"an update would take 1.3e\+05 samples, at most 1e\+05 with environment.stack_size = 100",
        ),
        (
            "sac",
            ["environment.stack_size=11"],
            r"buffer_size = 1000000: must be at most 909090 with environment.stack_size = 11",
        ),
        ("sac", ["steps=10000"], r"learning_starts = 10000: must be less than steps = 10000, or nothing is learned"),
    ],
)
def test_trainings_that_cannot_learn_or_be_kept_are_refused(algo, changes, message):
    """Before anything is imported or run; what they cost is said."""
    with pytest.raises(ConfigError, match=message):
        load_config(algo, changes)


def test_shipped_scenarios_change_into_others():
    """Changes are checked as a file's values are."""
    scenario = load_scenario("nominal")
    assert scenario.with_changes(duration=2.0) == scenario.model_copy(update={"duration": 2.0})
    with pytest.raises(ConfigError, match=r"^scenario nominal: duration = nan: must be finite"):
        scenario.with_changes(duration=float("nan"))
