"""``SFFRFlex-v0`` against Gymnasium's ``HalfCheetah-v5``: one by ``gym.make``, many as vector environments."""

from __future__ import annotations

from collections.abc import Callable, Iterable
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
ACTIONS = 512  # different ones, drawn beforehand
STRETCH, QUICK_STRETCH = 1.0, 0.01  # s of stepping in a round
MEMORY_PER_PROCESS = 64 * 2**20  # bytes, room that a process of the asynchronous environment must have


def single(repeats: int, quick: bool) -> Section:
    """Steps per second of ``gym.make(id)`` with its default wrappers under random actions, on one core."""
    _silence_mujoco()
    with ExitStack() as stack, one_core():
        contenders = {}
        for env_id in OURS, PEER:
            env = gym.make(env_id)
            stack.callback(env.close)
            contenders[env_id] = _stepping(env, QUICK_STRETCH if quick else STRETCH)
        samples = rounds(contenders, repeats)
    rows = [
        Row("ours", OURS, "steps/s", samples[OURS]),
        Row("peer", PEER, "steps/s", samples[PEER], versus="ours"),
    ]
    return Section("gym", "gym.make with its default wrappers, random actions, one core", rows, [
        "The resets of episodes that end are in the time.",
    ])  # fmt: skip


def vector(repeats: int, quick: bool, sizes: Iterable[int] | None = None) -> Section:
    """Environment steps per second of vector environments of several sizes under random actions, on all cores."""
    _silence_mujoco()
    rows: list[Row] = []
    remarks = [f"Ours uses up to {THREADS} threads; one environment step is one control period of 2 ms."]
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
        contenders = {}
        for mode in ["ours", *modes]:
            if mode == "ours":
                env = gym.make_vec(OURS, num_envs=n)
            else:
                env = gym.make_vec(PEER, num_envs=n, vectorization_mode=mode)
            stack.callback(env.close)
            contenders[mode] = _vector_stepping(env, stretch)
        samples = rounds(contenders, repeats)
    return [
        Row(
            f"{mode}-{n}",
            f"{OURS if mode == 'ours' else f'{PEER}, {mode}'}, {n}",
            "env steps/s",
            samples[mode],
            versus="" if mode == "ours" else f"ours-{n}",
        )
        for mode in contenders
    ]


def _stepping(env: gym.Env[Any, Any], stretch: float) -> Callable[[], float]:
    """A contender that steps an environment for ``stretch`` [s]."""
    actions = _actions(env.action_space)
    env.reset(seed=0)

    def once() -> float:
        steps, start = 0, perf_counter()
        while perf_counter() - start < stretch:
            for action in actions:
                _, _, terminated, truncated, _ = env.step(action)
                if terminated or truncated:
                    env.reset()
            steps += len(actions)
        return steps / (perf_counter() - start)

    return once


def _vector_stepping(env: gym.vector.VectorEnv[Any, Any, Any], stretch: float) -> Callable[[], float]:
    """A contender that steps a vector environment for ``stretch`` [s]."""
    actions = _actions(env.action_space, count=8)
    env.reset(seed=0)

    def once() -> float:
        steps, start = 0, perf_counter()
        while perf_counter() - start < stretch:
            for action in actions:
                env.step(action)
            steps += len(actions)
        return steps * env.num_envs / (perf_counter() - start)

    return once


def _actions(space: Any, count: int = ACTIONS) -> list[Any]:
    """Uniform actions of a space."""
    rng = np.random.default_rng(0)
    return [rng.uniform(space.low, space.high).astype(space.dtype) for _ in range(count)]


def _silence_mujoco() -> None:
    """Keep MuJoCo from printing, and logging into the working folder, that Gymnasium's model uses an old attribute."""
    mujoco.set_mju_user_warning(lambda text: None)
