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
from agents.bench.measure import Row, Section, one_core, rounds
from sffr_gym.batch import THREADS

OURS, PEER = "SFFRFlex-v0", "HalfCheetah-v5"
SIZES, QUICK_SIZES = (1, 16, 256, 1024, 4096), (1, 2)
RESETS = "The resets of episodes that end are in the time."
ACTIONS = 512  # different ones, drawn beforehand
STRETCH, QUICK_STRETCH = 1.0, 0.01  # s of stepping in a round
MEMORY_PER_PROCESS = 32 * 2**20  # bytes that a process of the asynchronous environment has for itself, at most


def single(repeats: int, quick: bool) -> Section:
    """Steps per second of ``gym.make(id)`` with its default wrappers under random actions, on one core."""
    _silence_mujoco()
    with ExitStack() as stack, one_core():
        steppers = {}
        for env_id in OURS, PEER:
            env = gym.make(env_id)
            stack.callback(env.close)
            steppers[env_id] = _Stepper(env, QUICK_STRETCH if quick else STRETCH)
        samples = rounds(steppers, repeats)
    rows = [
        Row("ours", OURS, "steps/s", samples[OURS], note=steppers[OURS].ends()),
        Row("peer", PEER, "steps/s", samples[PEER], versus="ours", note=steppers[PEER].ends()),
    ]
    return Section("gym", "gym.make with its default wrappers, random actions, one core", rows, [RESETS])


def vector(repeats: int, quick: bool, sizes: Iterable[int] | None = None) -> Section:
    """Environment steps per second of vector environments of several sizes under random actions, on all cores."""
    _silence_mujoco()
    rows: list[Row] = []
    remarks = [RESETS, f"Ours uses up to {THREADS} threads; one environment step is one control period of 2 ms."]
    for n in sizes or (QUICK_SIZES if quick else SIZES):
        modes = ["sync", "async"]
        if n * MEMORY_PER_PROCESS > psutil.virtual_memory().available / 2:
            modes.remove("async")
            remarks.append(f"No asynchronous {PEER} with {n} environments: as many processes do not fit into memory.")
        rows += _vector_rows(n, modes, repeats, QUICK_STRETCH if quick else STRETCH)
    return Section("vector", "Vector environments, random actions, all cores", rows, remarks)


def _vector_rows(n: int, modes: list[str], repeats: int, stretch: float) -> list[Row]:
    """All contenders of one size."""
    with ExitStack() as stack:
        steppers = {}
        for mode in ["ours", *modes]:
            if mode == "ours":
                env = gym.make_vec(OURS, num_envs=n)
            else:
                env = gym.make_vec(PEER, num_envs=n, vectorization_mode=mode)
            stack.callback(env.close)
            steppers[mode] = _VectorStepper(env, stretch)
        samples = rounds(steppers, repeats)
    return [
        Row(
            f"{mode}-{n}",
            f"{OURS if mode == 'ours' else f'{PEER}, {mode}'}, {n}",
            "env steps/s",
            samples[mode],
            versus="" if mode == "ours" else f"ours-{n}",
            note=stepper.ends(),
        )
        for mode, stepper in steppers.items()
    ]


class _Stepper:
    """A contender that steps an environment for ``stretch`` [s] and gives its steps per second."""

    def __init__(self, env: Any, stretch: float) -> None:
        self._env, self._stretch, self._actions = env, stretch, _actions(env.action_space)
        self._steps = self._ends = 0
        env.reset(seed=0)

    def __call__(self) -> float:
        steps, start = 0, perf_counter()
        while perf_counter() - start < self._stretch:
            for action in self._actions:
                _, _, terminated, truncated, _ = self._env.step(action)
                if terminated or truncated:
                    self._env.reset()
                    self._ends += 1
            steps += len(self._actions)
        self._steps += steps
        return steps / (perf_counter() - start)

    def ends(self) -> str:
        """How often episodes ended, in words."""
        return f"an episode's end every {self._steps / self._ends:.0f} steps" if self._ends else "no episode ended"


class _VectorStepper(_Stepper):
    """A contender that steps a vector environment and gives its environments' steps per second."""

    _at = 0

    def __call__(self) -> float:
        steps, n, start = 0, self._env.num_envs, perf_counter()
        while perf_counter() - start < self._stretch:
            self._at = (self._at + 1) % len(self._actions)
            _, _, terminated, truncated, _ = self._env.step(self._actions[self._at])
            self._ends += int((terminated | truncated).sum())
            steps += n
        self._steps += steps
        return steps / (perf_counter() - start)


def _actions(space: Any) -> list[Any]:
    """Uniform actions of a space."""
    rng = np.random.default_rng(0)
    return [rng.uniform(space.low, space.high).astype(space.dtype) for _ in range(ACTIONS)]


def _silence_mujoco() -> None:
    """Keep MuJoCo from printing, and logging into the working folder, that Gymnasium's model uses an old attribute."""
    mujoco.set_mju_user_warning(lambda text: None)
