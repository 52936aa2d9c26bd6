"""``SFFRFlex-v0`` against Gymnasium's ``HalfCheetah-v5``: one by ``gym.make``, many as vector environments."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import ExitStack
from time import perf_counter
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import psutil

import sffr_gym  # noqa: F401  (registers SFFRFlex-v0)
from sffr_gym.envs.batch import THREADS
from sffr_workbench.speed.measure import Row, Section, one_core, rounds

OURS, PEER = "SFFRFlex-v0", "HalfCheetah-v5"
SIZES, QUICK_SIZES = (1, 16, 256, 1024, 4096), (1, 2)
RESETS = "The resets of episodes that end are in the time."
ACTIONS, MOST_NUMBERS = 512, 10_000_000  # different ones, drawn beforehand, and of how many numbers in all
BATCH, LARGE = 1024, 65_536  # environments
DURATION, QUICK_DURATION = 1.0, 0.01  # s of stepping in a round
MEMORY_PER_PROCESS = 32 * 2**20  # bytes that a process of the asynchronous environment has for itself, at most


def single(repeats: int, quick: bool) -> Section:
    """Measure steps per second of ``gym.make(id)`` with its default wrappers, random actions, one core."""
    _silence_mujoco()
    with ExitStack() as stack, one_core():
        steppers = {}
        for env_id in OURS, PEER:
            env = gym.make(env_id)
            stack.callback(env.close)
            steppers[env_id] = _Stepper(env, QUICK_DURATION if quick else DURATION)
        samples = rounds(steppers, repeats)
    rows = [
        Row("ours", OURS, "steps/s", samples[OURS], note=steppers[OURS].ends()),
        Row("peer", PEER, "steps/s", samples[PEER], versus="ours", note=steppers[PEER].ends()),
    ]
    return Section("gym", "gym.make with its default wrappers, random actions, one core", rows, [RESETS])


def vector(repeats: int, quick: bool, sizes: Iterable[int] | None = None) -> Section:
    """Measure environment steps per second of vector environments of several sizes, random actions, all cores."""
    _silence_mujoco()
    rows: list[Row] = []
    remarks = [RESETS, f"Ours uses up to {THREADS} threads; one environment step is one control period of 2 ms."]
    for n in sizes or (QUICK_SIZES if quick else SIZES):
        modes = ["sync", "async"]
        if n * MEMORY_PER_PROCESS > psutil.virtual_memory().available / 2:
            modes.remove("async")
            remarks.append(f"No asynchronous {PEER} with {n} environments: as many processes do not fit into memory.")
        rows += _vector_rows(n, modes, repeats, QUICK_DURATION if quick else DURATION)
    return Section("vector", "Vector environments, random actions, all cores", rows, remarks)


def batches(repeats: int, quick: bool) -> Section:
    """Measure steps per second of our batches: of two sizes, without resets, and of robots that differ, all cores."""
    small, large = QUICK_SIZES if quick else (BATCH, LARGE)
    contenders: dict[str, tuple[str, int, dict[str, Any], float]] = {
        "random": ("random actions and their resets", small, {}, 1.0),
        "still": ("no actions, no resets", small, {}, 0.0),
        "mismatch": ("robots that differ, no actions, no resets", small, {"scenario": "mismatch"}, 0.0),
        "large-random": ("random actions and their resets", large, {}, 1.0),
        "large-still": ("no actions, no resets", large, {}, 0.0),
    }
    with ExitStack() as stack:
        steppers: dict[str, _VectorStepper] = {}
        for key, (_, n, kind, size) in contenders.items():
            env = gym.make_vec(OURS, num_envs=n, **kind)
            stack.callback(env.close)
            steppers[key] = _VectorStepper(env, QUICK_DURATION if quick else DURATION, size)
        samples = rounds(steppers, repeats)
    rows = [
        Row(key, f"{n}, {what}", "env steps/s", samples[key], "" if key == "still" else "still", steppers[key].ends())
        for key, (what, n, _, _) in contenders.items()
    ]
    return Section("batches", f"Batches of {OURS}, all cores", rows)


def _vector_rows(n: int, modes: list[str], repeats: int, duration: float) -> list[Row]:
    """Measure all contenders of one size."""
    with ExitStack() as stack:
        steppers = {}
        for mode in ["ours", *modes]:
            kind: dict[str, Any] = {} if mode == "ours" else {"vectorization_mode": mode}
            env = gym.make_vec(OURS if mode == "ours" else PEER, num_envs=n, **kind)
            stack.callback(env.close)
            steppers[mode] = _VectorStepper(env, duration)
        samples = rounds(steppers, repeats)
    rows = []
    for mode, stepper in steppers.items():
        what, versus = (f"{OURS}, {n}", "") if mode == "ours" else (f"{PEER}, {mode}, {n}", f"ours-{n}")
        rows.append(Row(f"{mode}-{n}", what, "env steps/s", samples[mode], versus, stepper.ends()))
    return rows


class _Stepper:
    """A contender that steps an environment for ``duration`` [s] and gives its steps per second."""

    def __init__(self, env: Any, duration: float, size: float = 1.0) -> None:
        self._env, self._duration, self._actions = env, duration, _actions(env.action_space, size)
        self._steps = self._ends = 0
        env.reset(seed=0)

    def __call__(self) -> float:
        steps, start = 0, perf_counter()
        while perf_counter() - start < self._duration:
            for action in self._actions:
                _, _, terminated, truncated, _ = self._env.step(action)
                if terminated or truncated:
                    self._env.reset()
                    self._ends += 1
            steps += len(self._actions)
        self._steps += steps
        return steps / (perf_counter() - start)

    def ends(self) -> str:
        """Return how often episodes ended, in words."""
        return f"an episode's end every {self._steps / self._ends:.0f} steps" if self._ends else "no episode ended"


class _VectorStepper(_Stepper):
    """A contender that steps a vector environment and gives its environments' steps per second."""

    _at = 0

    def __call__(self) -> float:
        steps, n, start = 0, self._env.num_envs, perf_counter()
        while perf_counter() - start < self._duration:
            self._at = (self._at + 1) % len(self._actions)
            _, _, terminated, truncated, _ = self._env.step(self._actions[self._at])
            self._ends += int((terminated | truncated).sum())
            steps += n
        self._steps += steps
        return steps / (perf_counter() - start)


def _actions(space: Any, size: float) -> list[Any]:
    """Draw uniform actions of a space, times ``size``; few for a batch that draws many itself."""
    rng, count = np.random.default_rng(0), max(4, min(ACTIONS, MOST_NUMBERS // space.low.size))
    return [size * rng.uniform(space.low, space.high).astype(space.dtype) for _ in range(count)]


def _silence_mujoco() -> None:
    """Keep MuJoCo from printing, and logging into the working folder, that Gymnasium's model uses an old attribute."""
    mujoco.set_mju_user_warning(lambda text: None)
