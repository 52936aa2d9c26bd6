"""Where the time of a control period goes, and its arithmetic floor: operations counted, over the machine's rate."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from statistics import median
from typing import Any

import gymnasium as gym
import numpy as np

import sffr_gym
from agents.bench.circle import Course, close_loop, drive, make_course, make_record
from agents.bench.kernels.loops import observe_often, solve_motion
from agents.bench.measure import Contender, Row, Section, one_core, rounds, seconds
from agents.bench.rates import PASSES, operation_times
from baselines import make_policy
from baselines.closed_loop import act
from sffr_gym.batch import make_batch, start_episode, step_batch
from sffr_gym.episode import draw, nominal
from sffr_gym.fleet import make_fleet
from sffr_gym.scenario import load_scenario
from sffr_gym.task import N_SIGNALS, make_buffers

UNIT = "us/period"
PERIODS, QUICK_PERIODS = 5000, 50
STAGES = 4  # evaluations of the equations in an integration step
TIMES = {"add": "multiply_add", "multiply": "multiply_add", "divide": "divide", "sqrt": "sqrt", "transcendental": "cos"}
PARTS = {
    "equations": f"equations of motion, {STAGES} times",
    "integrator": "integrator besides",
    "law": "AHSC",
    "view": "observation and signals",
    "rest": "limits, forces, ends, copies",
    "loop": "the closed loop, all of it",
}


def profile(repeats: int, quick: bool) -> Section:
    """Time of the parts of a control period with operations and floor, and of a step through Gymnasium, on one core."""
    periods = QUICK_PERIODS if quick else PERIODS
    course = make_course(periods * 2.0e-3)
    with one_core():
        samples = rounds(_kernels(course) | _interface(quick), repeats)
        rates = operation_times(PASSES // 100 if quick else PASSES)
    samples |= {
        "integrator": _less(samples, "step", "equations"),
        "rest": _less(samples, "loop", "step", "law", "view"),
    }
    counts = _counts(course.robot.steps)
    rows = []
    for key, what in PARTS.items():
        extra = floor(counts[key], rates) | counts[key]
        note = (
            f"{extra['operations']:.0f} operations: at least {extra['floor_us']:.2f} us, "
            f"one after the other {extra['serial_us']:.2f} us"
        )
        rows.append(Row(key, what, UNIT, samples[key], note=note, extra=extra))
    rows += [
        Row("batch", "Gymnasium: compiled step of one environment, called from Python", UNIT, samples["batch"]),
        Row("env", "Gymnasium: step of the bare environment", UNIT, samples["env"]),
        Row("made", "Gymnasium: step with the wrappers of gym.make", UNIT, samples["made"]),
    ]
    rate = ", ".join(f"{name} {time:.2f} ns" for name, time in rates.items())
    return Section("profile", "Where the time goes, one core", rows, [
        f"Machine: {rate} per operation, many at once (chain: each waits for the one before).",
        "The floor takes every operation at the machine's best rate, many at once; `one after the other` takes "
        "additions and multiplications at the rate of the chain. Operations are counted on the source as written.",
    ])  # fmt: skip


def floor(count: Mapping[str, float], rates: Mapping[str, float]) -> dict[str, float]:
    """Operations, and their time [us] at the machine's best rate and with additions and multiplications in a chain."""
    slow = sum(count[kind] * rates[TIMES[kind]] for kind in ("divide", "sqrt", "transcendental"))
    cheap = count["add"] + count["multiply"]
    return {
        "operations": cheap + count["divide"] + count["sqrt"] + count["transcendental"],
        "floor_us": 1e-3 * (cheap * rates["multiply_add"] + slow),
        "serial_us": 1e-3 * (cheap * rates["chain"] + slow),
    }


def _counts(steps: int) -> dict[str, dict[str, float]]:
    """Operations of every part of a control period, counted in a process without compilation."""
    package = str(Path(sffr_gym.__file__).parents[1])
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, [package, environment.get("PYTHONPATH")]))
    done = subprocess.run(
        [sys.executable, "-m", "agents.bench.count"], env=environment, capture_output=True, text=True, check=True
    )
    raw = {name: np.array(list(kinds.values())) for name, kinds in json.loads(done.stdout).items()}
    parts = {
        "equations": STAGES * steps * raw["equations"],
        "integrator": steps * (raw["step"] - STAGES * raw["equations"]),
        "law": raw["law"],
        "view": raw["view"],
        "rest": raw["plant"] - raw["step"] - raw["view"],
        "loop": raw["plant"] + (steps - 1) * raw["step"] + raw["law"],
    }
    kinds = list(TIMES)
    return {name: dict(zip(kinds, map(float, part), strict=True)) for name, part in parts.items()}


def _kernels(course: Course) -> dict[str, Contender]:
    """The parts of the closed loop [us per control period], each as many times as the course has periods."""
    robot, reference, periods, n = course.robot, course.reference, course.ticks, len(course.p)
    policy: Any = make_policy("ahsc", course.params)
    forces, buffers, record = close_loop(course), make_buffers(robot), make_record(course)
    observations, B_hat = np.tile(course.obs, (periods, 1)), np.tile(policy.initial_damping(), (periods, 1, 1))
    actions, out, signals = np.empty((periods, len(robot.scale))), np.empty(n), np.zeros(N_SIGNALS)

    def equations() -> None:
        count = STAGES * robot.steps * periods
        solve_motion(robot.model, course.p.copy(), course.v, forces[0], buffers.step.dynamics, out, count)

    timed: dict[str, Callable[[], Any]] = {
        "equations": equations,
        "law": lambda: act(policy.law, 0, observations, B_hat, np.ones_like(B_hat), actions),
        "view": lambda: observe_often(
            robot, reference, course.p, course.v, buffers, course.obs.copy(), signals, periods
        ),
        "loop": lambda: course.control(robot, policy.law, buffers, record),
    }  # fmt: skip
    contenders: dict[str, Contender] = {name: _per_period(part, periods) for name, part in timed.items()}
    contenders["step"] = lambda: 1e6 * drive(course, forces, robot.integrator, robot.steps).seconds / periods
    return contenders


def _interface(quick: bool) -> dict[str, Contender]:
    """A step through the layers of the Gymnasium interface [us], no actions."""
    periods = QUICK_PERIODS if quick else PERIODS
    made = gym.make("SFFRFlex-v0")
    bare: Any = made.unwrapped
    made.reset(seed=0)
    robot, still = bare.robot, np.zeros(len(bare.robot.scale), dtype=np.float32)
    fleet, batch = make_fleet(robot), make_batch(robot, 1)
    actions, active = still[None].astype(np.float64), np.ones(1, dtype=np.bool_)
    episode = draw(load_scenario("nominal"), nominal(bare.params), np.random.default_rng(0))
    start_episode(fleet, batch, 0, episode)
    steps: dict[str, Callable[[], Any]] = {
        "batch": lambda: step_batch(fleet, batch, actions, active),
        "env": lambda: bare.step(still),
        "made": lambda: made.step(still),
    }
    return {name: _per_period(_repeat(step, periods), periods) for name, step in steps.items()}


def _repeat(step: Callable[[], Any], count: int) -> Callable[[], Any]:
    def many() -> None:
        for _ in range(count):
            step()

    return many


def _per_period(action: Callable[[], Any], periods: int) -> Contender:
    return lambda: 1e6 * seconds(action) / periods


def _less(samples: Mapping[str, tuple[float, ...]], whole: str, *parts: str) -> tuple[float, ...]:
    """What remains of the whole, by the medians; a single figure, which may be slightly negative for noise."""
    return (median(samples[whole]) - sum(median(samples[part]) for part in parts),)
