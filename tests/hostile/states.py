"""Tampered states of environments: of other robots and sizes, with other shapes, types, layouts and numbers."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from hypothesis import strategies as st
from odd import values
from trial import REFUSED, WORKED, Trial, Violation, check_refusal

from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv

STEPS = 200
FREE, THREE, ONE_PANEL = ("object=null",), ("panel.elements=3", "panel.bending_cut=200.0"), (
    "panel.mounts=[{name: left, root: [0.0, 0.5], angle: 1.5}]",
)  # fmt: skip
MAKERS: dict[str, Callable[[], Any]] = {
    "single": SFFRFlexEnv,
    "free": lambda: SFFRFlexEnv(overrides=FREE),
    "three elements": lambda: SFFRFlexEnv(scenario="noise", overrides=THREE),
    "one panel": lambda: SFFRFlexEnv(scenario="impulse", overrides=ONE_PANEL),
    "other plant": lambda: SFFRFlexEnv(scenario="mismatch"),
    "pictures": lambda: SFFRFlexEnv(render_mode="rgb_array"),
    "damping": SFFRFlexDampingEnv,
    "damping free": lambda: SFFRFlexDampingEnv(overrides=FREE, law="hsc"),
    "batch of 3": lambda: SFFRFlexVectorEnv(3),
    "batch of 9": lambda: SFFRFlexVectorEnv(9, scenario="noise"),
    "batch of 9, free": lambda: SFFRFlexVectorEnv(9, scenario="fast", overrides=FREE, autoreset_mode="SameStep"),
    "batch of plants": lambda: SFFRFlexVectorEnv(5, scenario="mismatch", max_episode_steps=50),
    "damping batch": lambda: SFFRFlexDampingVectorEnv(9, scenario="practice/mixed"),
}


def parts(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the path of everything within a state: keys, indices, and names of named tuples' fields."""
    found = [path]
    for key, entry in _entries(value):
        found += parts(entry, (*path, key))
    return found


def _entries(value: Any) -> list[tuple[Any, Any]]:
    if isinstance(value, dict):
        return list(value.items())
    if hasattr(value, "_fields"):
        return list(zip(value._fields, value, strict=True))
    if isinstance(value, list | tuple) and len(value) <= 100:
        return list(enumerate(value))
    return []


def get(value: Any, path: tuple[Any, ...]) -> Any:
    """Return what is at a path."""
    for key in path:
        value = getattr(value, key) if hasattr(value, "_fields") else value[key]
    return value


def replaced(value: Any, path: tuple[Any, ...], new: Any) -> Any:
    """Return a state with something else at a path."""
    if not path:
        return new
    inner = replaced(get(value, path[:1]), path[1:], new)
    if isinstance(value, dict):
        return {**value, path[0]: inner}
    if hasattr(value, "_fields"):
        return value._replace(**{path[0]: inner})
    return type(value)([*value[: path[0]], inner, *value[path[0] + 1 :]])


@st.composite
def other_array(draw: st.DrawFn, array: np.ndarray) -> Any:
    """Draw another array."""
    way = draw(st.sampled_from(["shape", "type", "layout", "number", "number", "numbers"]))
    if way == "shape":
        size = draw(st.sampled_from([0, 1, max(array.size - 1, 0), array.size + 1]))
        forms: list[Any] = [np.resize(array, size), array.ravel(), array[None], array.T, array.tolist(), np.array(0.0)]
        return forms[draw(st.integers(0, len(forms) - 1))]
    if way == "type":
        with np.errstate(all="ignore"):
            return array.astype(draw(st.sampled_from(["f4", "f8", "i8", "i4", "?", "c16", "O", ">f8", "U8"])))
    if way == "layout":
        wide = np.repeat(array, 2, axis=-1) if array.ndim else array
        locked = array.copy()
        locked.flags.writeable = False
        return draw(st.sampled_from([np.asfortranarray(array), wide[..., ::2] if array.ndim else array, locked]))
    new = array.copy()
    if new.dtype.kind == "f":
        number: Any = draw(st.sampled_from([np.nan, np.inf, -np.inf, 1e300, -1e300, 1e6, -1.0, 0.0, 1e-320]))
    else:
        number = draw(st.sampled_from([-1, 0, 1, 7, 10**6, 2**31, 2**62, -(2**62)]))
    with np.errstate(all="ignore"):
        if way == "numbers" or not new.size:
            new[...] = np.array(number).astype(new.dtype)
        else:
            new.flat[draw(st.integers(0, new.size - 1))] = np.array(number).astype(new.dtype)
    return new


@st.composite
def changed_state(draw: st.DrawFn, states: dict[str, Any]) -> tuple[str, bytes, str]:
    """Draw an environment, a state for it, and what is wrong with that."""
    target, source = draw(st.sampled_from(sorted(states))), draw(st.sampled_from(sorted(states)))
    state, way = (
        states[target],
        draw(st.sampled_from(["array"] * 8 + ["swap", "part", "part", "value", "key", "tuple"])),
    )
    if way == "swap":
        return target, pickle.dumps(states[source]), f"the state of {source}"
    paths = parts(state)
    arrays = [path for path in paths if isinstance(get(state, path), np.ndarray)]
    path = draw(st.sampled_from(arrays if way == "array" else paths))
    old = get(state, path)
    story = f"{'.'.join(map(str, path))}: {way}"
    if way == "array":
        new = draw(other_array(old))
        story = f"{'.'.join(map(str, path))}: {getattr(old, 'dtype', '')}{np.shape(old)} -> {describe(new)}"
    elif way == "part":
        try:
            new = get(states[source], path)
        except (KeyError, AttributeError, IndexError, TypeError):
            new = None
        story += f" of {source}"
    elif way == "value":
        new = draw(values)
        story += f" {str(new)[:60]}"
    elif way == "key":
        new = {key: entry for key, entry in (old if isinstance(old, dict) else {}).items()} | {"more": 1}
        if draw(st.booleans()) and isinstance(old, dict) and old:
            del new[draw(st.sampled_from(sorted(old)))]
    else:
        new = list(old) if isinstance(old, tuple) else (old,)
    return target, pickle.dumps(replaced(state, path, new)), story


def describe(value: Any) -> str:
    """Return what an array is like, in short."""
    if not isinstance(value, np.ndarray):
        return type(value).__name__
    return f"{value.dtype}{value.shape} {str(value.ravel()[:3].tolist())[:60]}"


def same(one: Any, other: Any) -> bool:
    """Say whether two states are the same, bit for bit."""
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and one.dtype == other.dtype and one.tobytes() == other.tobytes()
    if isinstance(one, np.random.Generator):
        return repr(one.bit_generator.state) == repr(other.bit_generator.state)
    if isinstance(one, dict) or hasattr(one, "_fields") or isinstance(one, list | tuple):
        mine, others = _entries(one), _entries(other)
        return [key for key, _ in mine] == [key for key, _ in others] and all(
            same(each, own) for (_, each), (_, own) in zip(mine, others, strict=True)
        )
    return bool(one == other)


class States:
    """States of others."""

    name = "states"
    most_seconds, most_memory = 10.0, 1e9

    def make_exemplars(self, folder: Path) -> None:
        """Every worker makes its environments."""

    def load(self, folder: Path) -> None:
        """Make the environments; keep a state of each in the middle of an episode, and what its first steps give."""
        self._envs = {name: make() for name, make in MAKERS.items()}
        self._states, self._starts = {}, {}
        for name, env in self._envs.items():
            self._starts[name] = start(env)
            for _ in range(20):
                step(env, np.zeros(env.action_space.shape))
            self._states[name] = env.get_state()
            run(env)

    def trials(self) -> st.SearchStrategy[Trial]:
        """Draw an environment and a state."""
        return changed_state(self._states).map(
            lambda made: Trial(f"{made[0]}: {made[2]}", made[0], {"state.pickle": made[1]})
        )

    def attempt(self, trial: Trial, folder: Path) -> tuple[str, dict[str, int]]:
        """Put the environment there and step it; afterwards it must be as good as new."""
        env, content = self._envs[trial.target], trial.tree["state.pickle"]
        assert isinstance(content, bytes)
        env.set_state(self._states[trial.target])
        before, outcome = env.get_state(), WORKED
        try:
            env.set_state(pickle.loads(content))
        except ValueError as error:
            check_refusal(str(error), ["state"])
            outcome = REFUSED
            if not same(before, env.get_state()):
                raise Violation("refused, and yet a part of it was taken") from None
        else:
            run(env)
        env.set_state(self._states[trial.target])  # a scenario is a part of a state
        if start(env) != self._starts[trial.target]:
            raise Violation(f"an episode after it is not what it always was ({outcome})")
        return outcome, {}


def start(env: Any) -> list[bytes]:
    """Return what a reset and three steps give."""
    obs, _ = env.reset(seed=0)
    rng = np.random.default_rng(0)
    return [obs.tobytes(), *(step(env, rng.uniform(-1.0, 1.0, env.action_space.shape))[0].tobytes() for _ in range(3))]


def step(env: Any, action: np.ndarray) -> tuple[np.ndarray, bool]:
    """Take a step; raises Violation for an observation or reward that none can be."""
    obs, reward, terminated, truncated, _ = env.step(action)
    if not np.isfinite(reward).all():
        raise Violation("a reward that is not finite")
    if not env.observation_space.contains(obs):
        raise Violation("an observation outside of its space")
    return obs, bool(np.any(terminated | truncated))


def run(env: Any) -> None:
    """Take some steps, with new episodes where they are due."""
    rng, single = np.random.default_rng(0), not isinstance(env, gym.vector.VectorEnv)
    for _ in range(STEPS):
        try:
            _, done = step(env, rng.uniform(-1.0, 1.0, env.action_space.shape))
        except gym.error.ResetNeeded:
            done, single = True, True
        if done and single:
            env.reset()
        if env.render_mode:
            break
    if env.render_mode:
        env.render()
