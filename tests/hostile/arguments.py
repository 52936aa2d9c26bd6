"""Odd arguments of what users call, and odd options of commands."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from click.testing import Result
from command import WRONG, failure, invoke, write_scenario
from hypothesis import strategies as st
from odd import NUMBERS, TEXTS, plain, values
from states import run
from trial import CONTROL, MOST_LINE, REFUSED, WORKED, Trial, Violation, check_refusal

from sffr_baselines import make_policy
from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv
from sffr_gym import Simulator
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv

ENVS: dict[str, Callable[..., Any]] = {
    "env": SFFRFlexEnv, "batch": SFFRFlexVectorEnv, "damping": SFFRFlexDampingEnv,
    "damping batch": SFFRFlexDampingVectorEnv,
}  # fmt: skip
OF_ALL = ("scenario", "params", "overrides", "render_mode", "dtype")
OF_BATCH = ("num_envs", "max_episode_steps", "autoreset_mode")
OF_LAW = ("law", "rho", "agent_period", "duration", "random_phase", "base_tolerance", "stack_size")
OF_STEP = ("state", "base", "joints", "piezo_tau", "piezo_volts", "wrench", "dt")
OPTIONS = {  # of commands, each with what makes it short
    "evaluate": ("POLICY", "-n", "--seed", "-s", "-o", "--params", "--set"),
    "benchmark": ("POLICY", "-n", "--seed", "-s", "-o", "-j", "--params", "--set"),
    "animate": ("POLICY", "--seed", "-s", "-o", "--speed", "--fps", "--duration", "--size", "--exaggeration", "--set"),
    "train": ("--algo", "--seed", "--n-envs", "--set"),
    "report": ("POLICY", "-o"),
    "phase": ("POLICY", "-o"),
}  # fmt: skip
EXPECTED = (ValueError, TypeError, gym.error.Error)  # of Python's, NumPy's and Gymnasium's conventions
SPACES = {"action": "action_space"}


def odd_array(shape: tuple[int, ...]) -> st.SearchStrategy[Any]:
    """Draw something in the place of an array of a shape."""
    zeros = np.zeros(shape)
    forms = [
        zeros, zeros.tolist(), zeros.astype("f4"), zeros.astype("f2"), zeros.astype(">f8"), zeros.astype(complex) + 1j,
        zeros.astype(int), zeros.astype(bool), zeros.astype(object), zeros.astype(str), zeros.astype("M8[s]"),
        zeros[..., :-1], zeros[None], zeros.ravel(), np.asfortranarray(zeros), np.full(shape, np.nan),
        np.full(shape, np.inf), np.full(shape, 1e308), np.full(shape, 5e-324), np.ma.masked_array(zeros, True),
        zeros.T, np.zeros(0), [[]],
        [None], np.zeros(shape, [("a", "f8")]), np.broadcast_to(0.0, shape), zeros[..., ::-1],
    ]  # fmt: skip
    return st.one_of(st.sampled_from(range(len(forms))).map(lambda k: forms[k]), values)


class Arguments:
    """Arguments that nobody should give."""

    name = "arguments"
    most_seconds, most_memory = 10.0, 1e9

    def make_exemplars(self, folder: Path) -> None:
        """Write a scenario for commands."""
        write_scenario(folder, duration=0.1)

    def load(self, folder: Path) -> None:
        """Make one of each."""
        self._scenario = folder / "short.yaml"
        self._envs = {name: make() for name, make in ENVS.items()}
        for env in self._envs.values():
            env.reset(seed=0)
            run(env)
        self._sim = Simulator()
        self._state = self._sim.initial_state()
        self._sim.step(self._state)
        self._policy = make_policy("ahsc", self._envs["env"])

    def trials(self) -> st.SearchStrategy[Trial]:
        """Draw a call and a value."""
        return st.one_of(self._calls(), self._calls(), self._commands())

    def _calls(self) -> st.SearchStrategy[Trial]:
        anything = st.one_of(
            st.sampled_from([(), [], {}, b"x", 1j, object, np.float32(1), np.int8(-1), range(3)]), values
        )
        made = [("make", name, key, anything) for name in ENVS for key in self._keys(name)]
        for name, env in self._envs.items():
            made += [("reset", name, key, anything) for key in ("seed", "options")] * 3
            made += [("step", name, "action", odd_array(env.action_space.shape))] * 4
        made += [("simulate", "", key, odd_array(np.shape(self._given(key)))) for key in OF_STEP]
        made += [
            ("policy", "", "name", anything),
            ("act", "", "obs", odd_array(self._envs["env"].observation_space.shape)),
        ]

        def of(drawn: tuple[str, str, str, st.SearchStrategy[Any]]) -> st.SearchStrategy[Trial]:
            call, name, key, strategy = drawn
            return strategy.map(
                lambda value: Trial(
                    f"{call} {name} {key}={repr(value)[:150]}", call, {"value.pickle": pickle.dumps((name, key, value))}
                )
            )

        return st.sampled_from(range(len(made))).flatmap(lambda k: of(made[k]))

    def _keys(self, name: str) -> tuple[str, ...]:
        own = OF_ALL[:-1] if "damping" in name else OF_ALL
        return own + (OF_BATCH if "batch" in name else ()) + (OF_LAW if "damping" in name else ())

    def _commands(self) -> st.SearchStrategy[Trial]:
        texts = st.one_of(
            st.sampled_from([text for text in TEXTS if "\x00" not in text]), st.sampled_from(NUMBERS),
            plain.map(lambda value: str(value).encode("utf-8", "replace").decode().replace("\x00", "")),
        )  # fmt: skip
        # A place for results is a name alone: whoever runs this may be allowed to write to other people's files.
        names = texts.filter(lambda text: "/" not in text and not text.startswith((".", "~")))
        pairs = [(command, option) for command, options in OPTIONS.items() for option in options]
        drawn = st.sampled_from(pairs).flatmap(
            lambda pair: st.tuples(st.just(pair), names if pair[1] == "-o" else texts)
        )
        return drawn.map(
            lambda drawn: Trial(
                f"{drawn[0][0]} {drawn[0][1]} {drawn[1][:150]!r}", "command",
                {"value.pickle": pickle.dumps((*drawn[0], drawn[1]))},
            )
        )  # fmt: skip

    def _given(self, key: str) -> Any:
        """Return a value of a simulator's argument that is right."""
        actuators, links = self._sim.actuators, self._envs["env"].params.n_links
        n_p, n_c = actuators.K_PZ.shape[::2]
        return {
            "state": self._state, "base": np.zeros(3), "joints": np.zeros(links), "piezo_tau": np.zeros((n_p, 3)),
            "piezo_volts": np.zeros((n_p, n_c)), "wrench": np.zeros(3), "dt": 0.002,
        }[key]  # fmt: skip

    def attempt(self, trial: Trial, folder: Path) -> tuple[str, dict[str, int]]:
        """Call it."""
        content = trial.tree["value.pickle"]
        assert isinstance(content, bytes)
        name, key, value = pickle.loads(content)
        if trial.target == "command":
            outcome = self._command(name, key, value, folder)
            return outcome, {f"command {outcome}": 1}
        try:
            self._call(trial.target, name, key, value)
        except EXPECTED as error:
            text = str(error)
            if len(text.splitlines()) != 1 and "ConfigError" not in type(error).__name__:
                raise Violation(f"{type(error).__name__} of {len(text.splitlines())} lines: {text[:200]!r}") from None
            words = {key, key.rstrip("s"), {"name": "policy"}.get(key, key), key.capitalize(), "argument", "override"}
            check_refusal(text, words)
            return REFUSED, {f"{trial.target} refused": 1}
        return WORKED, {f"{trial.target} worked": 1}

    def _call(self, call: str, name: str, key: str, value: Any) -> None:
        if call == "make":
            env = ENVS[name](**{key: value})
            env.reset(seed=0)
            env.step(np.zeros(env.action_space.shape))
        elif call == "reset":
            env = self._envs[name]
            obs, _ = env.reset(**{key: value})
            if not env.observation_space.contains(obs):
                raise Violation("an observation outside of its space")
        elif call == "step":
            env = self._envs[name]
            env.reset(seed=0)
            obs, reward, *_ = env.step(value)
            if not (env.observation_space.contains(obs) and np.isfinite(reward).all()):
                raise Violation("an observation outside of its space")
        elif call == "simulate":
            found = self._sim.step(**({"state": self._state} | {key: value}))
            if not all(np.isfinite(part).all() for part in found if isinstance(part, np.ndarray)):
                raise Violation("a state that is not finite")
        elif call == "policy":
            make_policy(value, self._envs["env"])
        else:
            self._policy.reset(seed=0)
            self._policy(value)

    def _command(self, command: str, option: str, value: str, folder: Path) -> str:
        """Run a command with an odd option."""
        short = ["-s", self._scenario] if option != "-s" else []
        policy = value if option == "POLICY" else "ahsc"
        rest = {
            "evaluate": [policy, *short, *(() if option == "-n" else ("-n", 1)), "--no-figures"],
            "benchmark": ["ahsc", policy if policy != "ahsc" else "none", *short, "--no-figures",
                          *(() if option == "-n" else ("-n", 1)), *(() if option == "-j" else ("-j", 1))],
            "animate": [policy, *short, "--size", 64] if option != "--size" else [policy, *short],
            "train": ["--set", "steps=1", "--set", "n_envs=x"],  # never begins: the options are looked at before
            "report": [policy], "phase": [policy],
        }[command]  # fmt: skip
        given = [] if option in ("POLICY", "-o") else [option, value]
        files = {"animate": "out.gif", "phase": "out.png", "report": "out.html"}
        place = folder / (value if option == "-o" else files.get(command, "out"))
        result = invoke(command, *rest, *given, "-o", place, "--quiet" if command != "phase" else "--overwrite")
        if found := failure(command, result):
            raise Violation(found)
        if result.exit_code == 0:
            return WORKED
        _check_usage(result, [value[:40] or "''", option, str(folder), command])
        return REFUSED


def _check_usage(result: Result, places: list[str]) -> None:
    """Raise Violation unless a command said what is wrong: in our lines, or in Typer's box about an option."""
    if result.exit_code != WRONG:
        raise Violation(f"exit code {result.exit_code}: {result.stderr[-300:]}")
    if "Usage:" in result.stderr:
        if CONTROL.search(result.stderr) or max(map(len, result.stderr.splitlines())) > MOST_LINE:
            raise Violation(f"refused by what steers the terminal or has no end: {result.stderr[:300]!r}")
        return
    check_refusal(result.stderr, places, prefix="error: ")
