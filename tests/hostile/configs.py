"""Tampered YAML: parameters, scenarios, trainings, searches and dotted overrides."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from hypothesis import strategies as st
from odd import TEXTS, changed, dumped, numbers, values
from robots import configs
from spoil import changed_bytes, changed_lines
from trial import REFUSED, WORKED, Trial, Violation, check_refusal

from sffr_agents.algorithms import make_model
from sffr_agents.config import TrainConfig, load_config
from sffr_agents.tune_config import load_tune
from sffr_gym import ConfigError, load_params
from sffr_gym.config.params import Params
from sffr_gym.config.strict_yaml import config_dir
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv

STEPS = 5
SECTIONS = (*Params.model_fields, *TrainConfig.model_fields)
FOLDERS = {"params": "", "scenario": "scenarios", "train": "train", "tune": "tune"}
SNIPPETS = (
    "base: &a [*a]", "<<: {base: 1}", "<<: [*x]", "? [1, 2]\n: 3", "? {a: 1}\n: 2", "? |\n  long\n: 1",
    "--- 1\n--- 2", "%YAML 9.9\n---\nbase: 1", "!!binary x: 1", "base: !!set {a, b}", "base: !!omap [a: 1]",
    "base: !!timestamp 2001-01-01", "base: 2001-01-01", "base: !!python/object/apply:os.system [echo]",
    "base: !!float .", "base: !!int 0x", "base: !!bool x", "base: !local x", "base: ! x", "1: 2", "null: 1",
    "true: 1", "1.5: 1", "[]", "{}", "", "text", "base:\n\t- x", "? ", "- - - -", "base: {mass: 50 kg}",
    "panel: {EI: 20_000}", "control: {period: 2ms}", "panel: {EI: 1:30}", "panel: {EI: 0x10}", "path: {heading: 0.5}",
    "initial: {q: [90, 0, 0, 0, 0, 0, 0, 0, 0]}", "base: {mass: 1e400}", "base: {mass: 1.0e+400}",
    "panel: {mounts: []}", "arms: []", "object: null", "object: {}", "base: null", "base: &b {mass: 1}\npanel: *b",
)  # fmt: skip


@st.composite
def bombs(draw: st.DrawFn) -> str:
    """Draw references that stand for more than they seem to."""
    width, depth = draw(st.integers(1, 12)), draw(st.integers(1, 14))
    kind = draw(st.sampled_from(["lists", "merges", "keys"]))
    lines = ["x0: &x0 {a: 1}" if kind == "merges" else "x0: &x0 [1]"]
    for k in range(1, depth):
        inner = ", ".join([f"*x{k - 1}"] * width)
        lines.append(f"x{k}: &x{k} {{<<: [{inner}]}}" if kind == "merges" else f"x{k}: &x{k} [{inner}]")
    return "\n".join([*lines, f"? *x{depth - 1}\n: 1"] if kind == "keys" else lines)


@st.composite
def tampered(draw: st.DrawFn, text: bytes) -> tuple[bytes, str]:
    """Draw a tampered YAML file."""
    way = draw(
        st.sampled_from(["values"] * 10 + ["lines"] * 3 + ["bytes"] * 2 + ["snippet"] * 2 + ["bomb", "many", "deep"])
    )
    if way == "values":
        value, stories = yaml.safe_load(text), []
        for _ in range(draw(st.sampled_from([1, 1, 1, 2, 3]))):
            value, story = draw(changed(value))
            stories.append(story)
        return dumped(value), "; ".join(stories)
    if way in ("lines", "bytes"):
        return draw(changed_lines(text) if way == "lines" else changed_bytes(text))
    if way == "snippet":
        snippet = draw(st.sampled_from(SNIPPETS))
        new = draw(
            st.sampled_from([snippet.encode(), text + b"\n" + snippet.encode(), snippet.encode() + b"\n" + text])
        )
        return new, f"snippet {snippet!r}"
    if way == "bomb":
        return draw(bombs()).encode(), "a bomb"
    count = draw(st.sampled_from([100, 1000, 10_000, 60_000]))
    piece = draw(
        st.sampled_from(["a: {", "- ", "[", "? ", "&a ", "a: 1\n", "# x\n", "'", '"\\u0041', "!!x ", "<<: ", "- a\n"])
    )
    return (piece * count).encode(), f"{count} times {piece!r}"


@st.composite
def assignments(draw: st.DrawFn, keys: list[str]) -> str:
    """Draw an override of one of the keys."""
    key = draw(st.sampled_from(keys))
    way = draw(st.sampled_from(["value", "value", "value", "above", "below", "text", "index"]))
    if way == "above":
        key = key.rpartition(".")[0] or key
    elif way == "below":
        key += draw(st.sampled_from([".x", ".0", ".-1", ".99999999999999999999", "..", "."]))
    elif way == "text":
        return draw(st.one_of(st.sampled_from(TEXTS), st.text(max_size=30), st.just(f"{key}={'[' * 5000}")))
    elif way == "index":
        key = f"arms.{draw(st.integers(-1, 9))}.links.{draw(st.integers(-1, 9))}.mass"
    value = draw(st.one_of(numbers, numbers, numbers, values))
    written = repr(value) if isinstance(value, float) else dumped(value).decode("utf-8", "replace").strip()
    return f"{key}={written.removesuffix('...').strip()}"


class Configs:
    """Files and overrides."""

    name = "configs"
    most_seconds, most_memory = 10.0, 1e9

    def make_exemplars(self, folder: Path) -> None:
        """The shipped files are the exemplars."""

    def load(self, folder: Path) -> None:
        """Read the shipped files, and run what is not tampered with."""
        self._texts = {
            target: [file.read_bytes() for file in sorted((config_dir() / sub).glob("*.yaml"))]
            for target, sub in FOLDERS.items()
        }
        case = load_params()
        free = case.with_overrides("object=null", "panel.elements=3")
        self._texts["params"] += [dumped(case.to_dict()), dumped(free.to_dict()), b"panel: {EI: 25.0}\n"]
        leaves = _leaves(case.to_dict())
        self._overrides = [key for key, _ in leaves]
        for params in (case, case.with_overrides("simulation.coupling=staggered")):
            run_robot(params)
        make_model(load_config("ppo", ["n_envs=2", "learning.batch_size=32"]), 0)

    def trials(self) -> st.SearchStrategy[Trial]:
        """Draw a file or an override."""
        targets = st.sampled_from(["params"] * 6 + ["scenario"] * 4 + ["train"] * 3 + ["tune"] + ["override"] * 4)
        return targets.flatmap(lambda target: self._overridden() if target == "override" else self._file(target))

    def _file(self, target: str) -> st.SearchStrategy[Trial]:
        texts: st.SearchStrategy[bytes] = st.sampled_from(self._texts[target])
        if target == "params":
            texts = st.one_of(texts, texts, configs().map(dumped))
        return texts.flatmap(tampered).map(
            lambda made: Trial(f"{target}: {made[1]}", target, {"hostile.yaml": made[0]})
        )

    def _overridden(self) -> st.SearchStrategy[Trial]:
        made = st.lists(assignments(self._overrides), min_size=1, max_size=2)
        return made.map(
            lambda made: Trial(
                f"override: {made!r}"[:300], "override",
                {f"{k}.txt": text.encode("utf-8", "surrogatepass") for k, text in enumerate(made)},
            )
        )  # fmt: skip

    def attempt(self, trial: Trial, folder: Path) -> tuple[str, dict[str, int]]:
        """Load it, and run what it describes."""
        file = folder / "hostile.yaml"
        places = ["override"] if trial.target == "override" else [str(file)]
        try:
            if trial.target == "override":
                texts = (text for text in trial.tree.values() if isinstance(text, bytes))
                made = [text.decode("utf-8", "surrogatepass") for text in texts]
                run: Any = (run_robot, load_params().with_overrides(*made))
            elif trial.target == "params":
                run = (run_robot, load_params(file))
            elif trial.target == "scenario":
                run = (run_scenario, file)
            elif trial.target == "train":
                run = (make_model, load_config(file), 0)
            else:
                run = (load_tune, file)
            places += [f"{section}." for section in SECTIONS]  # what the values do together is told with their keys
            run[0](*run[1:])
        except ConfigError as error:
            check_refusal(str(error), places)
            return REFUSED, {f"{trial.target} refused": 1}
        return WORKED, {f"{trial.target} worked": 1}


def _leaves(value: Any, key: str = "") -> list[tuple[str, Any]]:
    """Return all dotted keys with their values, lists of numbers as one."""
    entries: list[tuple[Any, Any]] = []
    if isinstance(value, dict):
        entries = list(value.items())
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        entries = list(enumerate(value))
    if not entries:
        return [(key.removeprefix("."), value)]
    return [leaf for name, entry in entries for leaf in _leaves(entry, f"{key}.{name}")]


def run_robot(params: Params) -> None:
    """Step a robot, alone and in a batch; raises Violation for what an environment must not give."""
    env = SFFRFlexEnv(params=params)
    check_observation(env, env.reset(seed=0)[0])
    rng = np.random.default_rng(0)
    for _ in range(STEPS):
        obs, reward, terminated, truncated, _ = env.step(rng.uniform(-1.0, 1.0, env.action_space.shape))
        check_observation(env, obs)
        if not math.isfinite(reward):
            raise Violation(f"a reward of {reward}")
        if terminated or truncated:
            break
    batch = SFFRFlexVectorEnv(9, params=params)
    batch.reset(seed=0)
    for _ in range(2):
        obs, *_ = batch.step(rng.uniform(-1.0, 1.0, batch.action_space.shape))
        if not batch.observation_space.contains(obs):
            raise Violation("an observation of a batch outside of its space")


def run_scenario(file: Path) -> None:
    """Draw some episodes of a scenario and step them."""
    env = SFFRFlexEnv(scenario=file)
    for seed in range(3):
        check_observation(env, env.reset(seed=seed)[0])
        for _ in range(STEPS):
            obs, _, terminated, truncated, _ = env.step(np.zeros(env.action_space.shape))
            check_observation(env, obs)
            if terminated or truncated:
                break
    batch = SFFRFlexVectorEnv(9, scenario=file)
    batch.reset(seed=0)
    batch.step(np.zeros(batch.action_space.shape))


def check_observation(env: SFFRFlexEnv, obs: np.ndarray) -> None:
    """Raise Violation for an observation outside of the space."""
    if not env.observation_space.contains(obs):
        space = env.observation_space
        wrong = [k for k in range(obs.size) if not space.low[k] <= obs[k] <= space.high[k]]
        names = (
            [name for name, field in env.fields.items() if field.slice.start <= wrong[0] < field.slice.stop]
            if wrong
            else []
        )
        raise Violation(f"an observation outside of its space: {names}, {obs[wrong[:3]].tolist()}")
