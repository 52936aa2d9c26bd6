"""Ends of numbers in scenarios, trainings and searches: both are allowed, what lies next to them is not; and defaults.

A file that is valid today stays so, and a mistaken unit is refused, only while these ends stay where they are.
"""

import json
import math

import pytest
from plain_params import put

from sffr_agents.config import CONFIGS
from sffr_agents.tune_config import TuneConfig
from sffr_gym import ConfigError
from sffr_gym.config.sections import MOST_ELEMENTS
from sffr_gym.config.strict_yaml import build
from sffr_gym.task.scenario import EpisodeRange, Scenario, load_scenario

MODE, FAULT = {"mode": 1, "amplitude": [0.0, 0.1]}, {"actuators": "joint", "remaining": 0.5}
FILES = {
    "scenario": (Scenario, {
        "name": "s", "description": "d", "panel_modes": [MODE], "faults": [FAULT],
        "impulses": {"count": 1, "linear": 1.0, "angular": 1.0},
        "plant": {"each_panel": {}, "lag": {}, "quantisation": {}}, "sensors": {"quantisation": {}},
    }),
    "episodes": (EpisodeRange, {}),
    "search": (TuneConfig, {"train": "ppo", "space": [{"key": "steps", "low": 1, "high": 2}]}),
    **{
        algo: (model, {"algo": algo, **{part: {} for part in (
            "environment", "network", "validation", "checkpoints", "learning",
        )}})
        for algo, model in CONFIGS.items()
    },
}  # fmt: skip
MODES = 2 * MOST_ELEMENTS  # each Hermite element of a clamped panel adds a deflection and a slope
STEPS, SAMPLES, WEIGHT = (1, 10**10), (2, 10**7), (0.0, 1e6)
NUMBERS = {
    "scenario": {
        "duration": (1e-6, 1e7), "offset_position": (0.0, 1.0), "offset_angle": (0.0, 1.0),
        "panel_modes.0.mode": (1, MODES), "faults.0.remaining": (0.0, 1.0), "plant.on_off": (0.0, 1.0),
        "impulses.count": (1, 8), "impulses.linear": (0.0, 1e6), "impulses.angular": (0.0, 1e6),
        "sensors.position": (0.0, 100.0), "sensors.angle": (0.0, 1.0), "sensors.velocity": (0.0, 100.0),
        "sensors.rate": (0.0, 100.0), "sensors.delay": (0.0, 1.0),
    },
    "episodes": {"episodes": (1, 100_000), "seed": (0, 2**32 - 1)},
    "search": {"seeds": (1, 1000), "trials": (1, 100_000)},
    "ppo": {
        "steps": STEPS, "n_envs": (1, 100_000), "validation.episodes": (1, 1000), "validation.every": STEPS,
        "checkpoints.every": STEPS, "checkpoints.keep": (1, 1000), "environment.rho": (1.0, 1000.0),
        "environment.agent_period": (1e-6, 10.0), "environment.base_tolerance": (1e-9, 1000.0),
        "environment.stack_size": (1, 100),
        "learning.learning_rate": (1e-12, 1.0), "learning.final_learning_rate": (0.0, 1.0),
        "learning.gamma": (1e-9, 1.0), "learning.n_steps": SAMPLES, "learning.batch_size": SAMPLES,
        "learning.n_epochs": (1, 1000), "learning.gae_lambda": (0.0, 1.0), "learning.clip_range": (1e-6, 10.0),
        "learning.ent_coef": WEIGHT, "learning.vf_coef": WEIGHT, "learning.max_grad_norm": (1e-9, 1e9),
        "learning.log_std_init": (-20.0, 2.0),
    },
    "sac": {
        "learning.buffer_size": (1, 10**7), "learning.learning_starts": STEPS, "learning.batch_size": SAMPLES,
        "learning.train_freq": (1, 100_000), "learning.gradient_steps": (1, 100_000), "learning.tau": (1e-9, 1.0),
        "learning.ent_coef": (1e-9, 1e6),
    },
    "td3": {
        "learning.policy_delay": (1, 1000), "learning.target_policy_noise": (0.0, 2.0),
        "learning.action_noise": (0.0, 2.0),
    },
    "tqc": {"learning.top_quantiles_to_drop_per_net": (0, 24)},
    "crossq": {"learning.ent_coef": (1e-9, 1e6)},
}  # fmt: skip
FACTOR, LAG, STEP = (0.01, 100.0), (0.0, 100.0), (0.0, 1e6)
DRAWN = {
    "panel_modes.0.amplitude": (0.0, 1000.0), "speed": (0.01, 10.0), "plant.minimum_on_time": LAG,
    **dict.fromkeys((f"plant.{name}" for name in ("object", "EI", "panel_mass", "link_mass", "piezo")), FACTOR),
    **dict.fromkeys((f"plant.each_panel.{name}" for name in ("mass", "length", "EI")), FACTOR),
    **dict.fromkeys((f"plant.lag.{name}" for name in ("piezo", "thruster", "joint")), LAG),
    **dict.fromkeys((f"plant.quantisation.{name}" for name in ("piezo", "thruster_force", "joint")), STEP),
    **dict.fromkeys((f"sensors.quantisation.{name}" for name in ("position", "velocity", "rate")), STEP),
    "plant.quantisation.thruster_torque": STEP, "sensors.quantisation.angle": (0.0, 1.0),
    "plant.thruster": FACTOR,
}  # fmt: skip
LENGTHS = [
    ("scenario", "panel_modes", MODE, MODES), ("scenario", "faults", FAULT, 100),
    ("scenario", "robot", "path.speed=1.0", 32), ("scenario", "plant.settings", "panel.EI=30.0", 32),
    ("ppo", "network.hidden", 8, 16),
]  # fmt: skip
NOT_EMPTY = [
    ("ppo", "network.hidden"), ("ppo", "validation.scenarios"), ("search", "space"), ("scenario", "name"),
]  # fmt: skip
DEFAULTS = {
    "scenario": {
        "duration": None, "panel_modes": (), "offset_position": 0.0, "offset_angle": 0.0, "speed": None,
        "random_phase": False, "robot": (), "faults": (), "impulses": None, "sensors.position": 0.0,
        "sensors.angle": 0.0, "sensors.velocity": 0.0, "sensors.rate": 0.0, "sensors.delay": 0.0,
    },
    "episodes": {"episodes": None, "seed": 0},
    "search": {"seeds": 3, "trials": 30, "set": (), "space.0.log": False},
    "ppo": {
        "steps": 4_000_000, "n_envs": 64, "validation.episodes": 8, "validation.every": 500_000,
        "checkpoints.every": 100_000, "checkpoints.keep": 2, "environment.rho": 10.0, "environment.agent_period": 0.1,
        "environment.random_phase": True, "network.hidden": (64, 64), "network.per_panel": True,
        "learning.learning_rate": 1e-3, "learning.final_learning_rate": 1e-4, "learning.gamma": 0.98,
        "learning.energy_scaling": True, "learning.n_steps": 64, "learning.batch_size": 1024, "learning.n_epochs": 6,
        "learning.gae_lambda": 0.95, "learning.clip_range": 0.2, "learning.ent_coef": 0.0, "learning.vf_coef": 0.5,
        "learning.max_grad_norm": 0.5, "learning.log_std_init": -0.5, "learning.learn_spread": False,
        "network.actor": None,
    },
    "sac": {
        "learning.buffer_size": 1_000_000, "learning.learning_starts": 10_000, "learning.batch_size": 512,
        "learning.train_freq": 1, "learning.gradient_steps": 8, "learning.tau": 0.005, "learning.ent_coef": 0.02,
    },
    "td3": {"learning.policy_delay": 2, "learning.target_policy_noise": 0.2, "learning.action_noise": 0.2},
    "tqc": {"learning.top_quantiles_to_drop_per_net": 2},
    "crossq": {"learning.ent_coef": 0.02},
}  # fmt: skip


def read(kind, tree, key):
    """Return the value at a dotted key of a file's content, as it is read."""
    found = build(FILES[kind][0], tree, lambda key: "file")
    for part in key.split("."):
        found = found[int(part)] if part.isdecimal() else getattr(found, part)
    return found


def refused(kind, key, value):
    """Say whether a value is refused by its key's name."""
    try:
        read(kind, put(FILES[kind][1], key, value), key)
    except ConfigError as error:
        return f"file: {key} = " in str(error)
    return False


def beside(end, way):
    """Return the number next to an end."""
    return end + way if isinstance(end, int) else math.nextafter(end, way * math.inf)


@pytest.mark.parametrize(("kind", "key"), [(kind, key) for kind, keys in NUMBERS.items() for key in keys])
def test_numbers_end_where_they_are_said_to(kind, key):
    low, high = NUMBERS[kind][key]
    assert [read(kind, put(FILES[kind][1], key, end), key) for end in (low, high)] == [low, high]
    assert refused(kind, key, beside(low, -1)) and refused(kind, key, beside(high, 1))


@pytest.mark.parametrize("key", DRAWN)
def test_intervals_end_where_they_are_said_to(key):
    """Either end may be either number, in their order."""
    low, high = DRAWN[key]
    for ends in (low, low), (low, high), (high, high):
        assert read("scenario", put(FILES["scenario"][1], key, ends), key) == ends
    for ends in (beside(low, -1), high), (low, beside(high, 1)), (high, low):
        assert refused("scenario", key, ends)


@pytest.mark.parametrize(("kind", "key", "entry", "most"), LENGTHS)
def test_lists_end_where_they_are_said_to(kind, key, entry, most):
    assert len(read(kind, put(FILES[kind][1], key, [entry] * most), key)) == most
    assert refused(kind, key, [entry] * (most + 1))


@pytest.mark.parametrize(("kind", "key"), NOT_EMPTY)
def test_what_must_hold_something_is_not_empty(kind, key):
    assert refused(kind, key, "" if key == "name" else [])


@pytest.mark.parametrize("kind", DEFAULTS)
def test_what_a_file_leaves_out_is_as_documented(kind):
    plain = json.loads(json.dumps(FILES[kind][1]))
    if kind == "scenario":
        plain = {"name": "s", "description": "d"}
    assert {key: read(kind, plain, key) for key in DEFAULTS[kind]} == DEFAULTS[kind]


def test_episodes_end_at_a_billion_control_periods(params):
    """A tenth of a period more rounds up to one more."""
    fast = params.with_overrides("control.period=0.001")
    scenario = load_scenario("nominal")
    assert scenario.with_changes(duration=1e6).ticks(fast) == 10**9
    assert scenario.with_changes(duration=1.0001).ticks(fast) == 1001
    with pytest.raises(ConfigError, match=r"nominal: duration: .* at most 1e\+09"):
        scenario.with_changes(duration=1e6 + 0.001).ticks(fast)
