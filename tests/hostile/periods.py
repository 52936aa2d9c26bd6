"""Millions of control periods: drawn robots, all scenarios and ways to end, any actions that are numbers."""

from __future__ import annotations

import json
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from command import write_scenario
from hypothesis import strategies as st
from machines import overrides
from odd import dumped
from robots import configs
from trial import REFUSED, WORKED, Trial, Violation, check_refusal

from sffr_baselines.damping_env import SFFRFlexDampingVectorEnv
from sffr_gym import ConfigError, load_params
from sffr_gym.config.params import Params
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.task.scenario import scenario_names
from sffr_gym.task.status import REASONS

PERIODS = 250_000  # of a trial, about
SECONDS = 30.0  # of a trial: episodes that end at once are drawn anew by the hundred thousand
MODES = ("NextStep", "SameStep", "Disabled")
STYLES = ("uniform", "bang", "constant", "zero", "resonant", "huge", "small", "single")
SOMETIMES = {"final_obs", "_final_obs", "final_info", "_final_info"}  # keys of infos


@st.composite
def plans(draw: st.DrawFn) -> dict[str, Any]:
    """Draw a batch, how it is driven and when its episodes end."""
    damping = draw(st.sampled_from([False, False, False, True]))
    return {
        "damping": damping,
        "robot": draw(st.one_of(st.just({}), configs(), st.just({}))),
        "overrides": draw(st.one_of(st.just([]), overrides())),
        "scenario": draw(st.sampled_from([*scenario_names(), "practice/mixed", "brief", "all at once"])),
        "mode": draw(st.sampled_from(MODES)),
        "style": draw(st.sampled_from(STYLES)),
        "envs": draw(st.sampled_from([16, 64, 512, 512, 509])),
        "most_steps": draw(st.sampled_from([None, None, 1, 7, 100, 500, 2000])) if not damping else draw(
            st.sampled_from([None, None, 1, 5, 40])
        ),
        "law": draw(st.sampled_from(["hsc", "ahsc"])),
        "seed": draw(st.integers(0, 10**6)),
    }  # fmt: skip


def driver(style: str, params: Params, shape: tuple[int, int], rng: np.random.Generator) -> Any:
    """Return what gives the actions (n, n_u) of each step."""
    n, n_u = shape
    held = rng.uniform(-1.0, 1.0, shape)
    phase = rng.uniform(0.0, 2.0 * np.pi, shape)
    panel = params.panel
    lowest = 3.516 * np.sqrt(panel.EI / (panel.mass * panel.length**3))  # rad/s, of a clamped panel
    rates = lowest * rng.choice([0.5, 1.0, 1.0, 1.2, 6.27], (n, 1))
    one = np.where(np.arange(n_u) == rng.integers(n_u, size=(n, 1)), 1.0, 0.0) * np.sign(held)
    return {
        "uniform": lambda k: rng.uniform(-1.0, 1.0, shape),
        "bang": lambda k: np.where(rng.random(shape) < 0.5, -1.0, 1.0),
        "constant": lambda k: held,
        "zero": lambda k: np.zeros(shape),
        "resonant": lambda k: np.sin(rates * params.control.period * k + phase),
        "huge": lambda k: rng.choice([1e30, -1e30, 1e300, np.inf, -np.inf, 5.0], shape),
        "small": lambda k: 0.02 * rng.normal(size=shape),
        "single": lambda k: one,
    }[style]


class Periods:
    """Control periods in batches."""

    name = "periods"
    most_seconds, most_memory = 60.0, 1e9

    def make_exemplars(self, folder: Path) -> None:
        """Write a scenario whose episodes end soon, and one that draws everything."""
        write_scenario(folder, "brief", duration=0.2)
        write_scenario(
            folder, "all at once", duration=1.0, speed=[0.3, 3.0], random_phase=True, offset_position=0.2,
            offset_angle=0.2, panel_modes=[{"mode": 1, "amplitude": [0.0, 0.5]}],
            plant={"EI": [0.5, 2.0], "link_mass": [0.5, 2.0]},
            sensors={"position": 0.01, "angle": 0.01, "velocity": 0.1, "rate": 0.1, "delay": 0.5},
            faults=[{"actuators": "piezo", "remaining": 0.0}, {"actuators": "thruster", "remaining": 0.1}],
            impulses={"count": 8, "linear": 50.0, "angular": 20.0},
        )  # fmt: skip

    def load(self, folder: Path) -> None:
        """Let everything be compiled."""
        self._folder = folder
        for damping in (False, True):
            for changes in ([], ["simulation.coupling=staggered"]):
                for scenario in ("nominal", "all at once"):
                    plan = {"damping": damping, "overrides": changes, "scenario": scenario, "mode": "NextStep"}
                    plan |= {"robot": {}, "envs": 9, "style": "zero", "most_steps": 3, "law": "ahsc", "seed": 0}
                    self._run(plan, 100)

    def trials(self) -> st.SearchStrategy[Trial]:
        """Draw a batch."""
        return plans().map(lambda plan: Trial(json.dumps(plan), "batch", {"plan.json": json.dumps(plan).encode()}))

    def attempt(self, trial: Trial, folder: Path) -> tuple[str, dict[str, int]]:
        """Step it."""
        plan = json.loads((folder / "plan.json").read_text())
        try:
            return WORKED, self._run(plan, PERIODS)
        except ConfigError as error:
            places = ["robot.yaml", "override", *(f"{section}." for section in Params.model_fields), "law", "damping"]
            check_refusal(str(error), [*places, plan["scenario"]])
            return REFUSED, {}

    def _run(self, plan: dict[str, Any], periods: int) -> dict[str, int]:
        Path("robot.yaml").write_bytes(dumped(plan["robot"]))
        params = load_params("./robot.yaml").with_overrides(*(() if plan["robot"] else plan["overrides"]))
        file = self._folder / f"{plan['scenario']}.yaml"
        settings = {
            "scenario": file if file.exists() else plan["scenario"], "params": params, "autoreset_mode": plan["mode"],
            "max_episode_steps": plan["most_steps"],
        }  # fmt: skip
        made = SFFRFlexDampingVectorEnv if plan["damping"] else SFFRFlexVectorEnv
        env = made(plan["envs"], **settings, **({"law": plan["law"]} if plan["damping"] else {}))
        hold = env.law.schedule.hold if isinstance(env, SFFRFlexDampingVectorEnv) else 1
        watched = Watched(env, plan["most_steps"])
        actions = driver(plan["style"], params, env.action_space.shape, np.random.default_rng(plan["seed"]))
        watched.reset(plan["seed"])
        begun = time.monotonic()
        for k in range(max(1, periods // (plan["envs"] * hold))):
            if k == 5:
                watched.refuses_nan()
            watched.step(actions(k))
            if time.monotonic() - begun > SECONDS:
                break
        counts = {f"end: {reason}": count for reason, count in watched.ends.items()}
        return counts | {"periods": watched.steps * hold, "episodes": watched.episodes, plan["scenario"]: 1}


class Watched:
    """A batch whose every output is checked."""

    def __init__(self, env: Any, most_steps: int | None) -> None:
        self._env, self._most, n = env, most_steps, env.num_envs
        self._low, self._high = env.observation_space.low, env.observation_space.high
        self._done, self._age = np.zeros(n, bool), np.zeros(n, int)
        self._keys: set[str] | None = None
        self.ends: Counter[str] = Counter()
        self.steps = self.episodes = 0

    def reset(self, seed: int) -> None:
        """Begin."""
        obs, infos = self._env.reset(seed=seed)
        self._check(obs, infos)
        self.episodes += self._env.num_envs

    def refuses_nan(self) -> None:
        """See that an action with NaN is refused, and changes nothing."""
        actions = np.zeros(self._env.action_space.shape)
        actions[-1, 0] = np.nan
        try:
            self._env.step(actions)
        except ValueError:
            return
        raise Violation("an action with NaN was taken")

    def step(self, actions: np.ndarray) -> None:
        """Step, and check what comes of it."""
        mode, n = self._env.autoreset_mode.value, self._env.num_envs
        again = self._done if mode == "NextStep" else np.zeros(n, bool)
        obs, reward, terminated, truncated, infos = self._env.step(actions)
        self._check(obs, infos)
        if not np.isfinite(reward).all():
            raise Violation("a reward that is not finite")
        self._age = np.where(again, 0, self._age + 1)
        self.steps += int(n - again.sum())
        if self._most is not None and ((self._age >= self._most) & ~(terminated | truncated)).any():
            raise Violation("an episode went on beyond max_episode_steps")
        ended = terminated | truncated
        if (ended & again).any():
            raise Violation("an episode ended at its reset")
        self._done = ended
        if not ended.any():
            return
        failure = (infos["final_info"] if mode == "SameStep" else infos)["failure"][ended]
        if [bool(each) for each in failure] != terminated[ended].tolist():
            raise Violation("a failure without an end, or the other way round")
        self.ends.update(REASONS[float(each)] for each in failure if each)
        self.ends["time is over"] += int((truncated & ~terminated).sum())
        self.episodes += int(ended.sum())
        if mode == "SameStep":
            self._age[ended] = 0
            for row in np.flatnonzero(ended):
                if not self._env.single_observation_space.contains(infos["final_obs"][row]):
                    raise Violation("a last observation outside of its space")
        elif mode == "Disabled":
            obs, infos = self._env.reset(options={"reset_mask": ended})
            self._check(obs, infos)
            self._age[ended] = 0
            self._done = np.zeros(n, bool)

    def _check(self, obs: np.ndarray, infos: dict[str, Any]) -> None:
        if not ((self._low <= obs) & (obs <= self._high)).all():  # neither is NaN
            row, column = np.argwhere(~((self._low <= obs) & (obs <= self._high)))[0]
            raise Violation(f"an observation outside of its space: number {column} is {obs[row, column]}")
        keys = {key for key in infos if not key.startswith(("drawn_", "_drawn_"))} - SOMETIMES
        if self._keys is None:
            self._keys = keys
        if keys != self._keys:
            raise Violation(f"infos with other keys: {sorted(keys ^ self._keys)}")
