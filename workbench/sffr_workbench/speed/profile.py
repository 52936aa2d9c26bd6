"""Where the time of a control period goes, and its arithmetic floor: operations counted, over the machine's rate."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Mapping
from statistics import median
from typing import Any

import gymnasium as gym
import numpy as np

from sffr_baselines import make_policy
from sffr_baselines.closed_loop import act, make_record
from sffr_baselines.control_law import law_shapes, make_states
from sffr_gym.compile.arguments import Structures
from sffr_gym.compile.workspace import new_workspace
from sffr_gym.envs.batch import Stepper, group_shapes, make_batch, put_episode, step_range
from sffr_gym.task.control_period import observe_states, period_shapes
from sffr_gym.task.episode import draw, nominal
from sffr_gym.task.scenario import load_scenario
from sffr_gym.task.signals import N_SIGNALS
from sffr_workbench.speed.circle import Course, Loop, close_loop, drive, make_course
from sffr_workbench.speed.kernels.loops import solve_motion
from sffr_workbench.speed.measure import Contender, Row, Section, one_core, rounds, seconds
from sffr_workbench.speed.rates import PASSES, operation_times

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
    """Measure the parts of a control period, with operations and floor, and a step through Gymnasium, on one core."""
    periods = QUICK_PERIODS if quick else PERIODS
    course = make_course(periods * 2.0e-3)
    with one_core():
        samples = rounds(_kernels(course) | _interface(quick), repeats)
        rates = operation_times(PASSES // 100 if quick else PASSES)
    samples |= {
        "integrator": _less(samples, "step", "equations"),
        "rest": _less(samples, "loop", "step", "law", "view"),
    }
    counts = _counts(course.plant.steps)
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
    """Return operations and their time [us] at the machine's best rate, and with sums and products in a chain."""
    slow = sum(count[kind] * rates[TIMES[kind]] for kind in ("divide", "sqrt", "transcendental"))
    cheap = count["add"] + count["multiply"]
    return {
        "operations": cheap + count["divide"] + count["sqrt"] + count["transcendental"],
        "floor_us": 1e-3 * (cheap * rates["multiply_add"] + slow),
        "serial_us": 1e-3 * (cheap * rates["chain"] + slow),
    }


def _counts(steps: int) -> dict[str, dict[str, float]]:
    """Count the operations of every part of a control period, in a process whose kernels count."""
    command = [sys.executable, "-m", "sffr_workbench.speed.count"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
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
    """Return the parts of the closed loop [us per control period], each as often as the course has periods."""
    plant, periods, p, v = course.plant, course.ticks, course.p.copy(), course.v
    policy: Any = make_policy("ahsc", course.params)
    law, forces, work = policy.law, close_loop(course), new_workspace(period_shapes(plant))
    observations, states = np.tile(course.obs, (periods, 1)), make_states(law, periods)
    actions, tick, signals = np.empty((periods, len(plant.scale))), np.zeros(1, dtype=np.int64), np.zeros(N_SIGNALS)
    timed: dict[str, Callable[[], Any]] = {
        "equations": solve_motion.bind(
            plant.model, p, v, forces[0], work.step.dynamics, np.empty_like(p), STAGES * plant.steps * periods
        ),
        "law": act.bind(law, tick, observations, states, actions, new_workspace(law_shapes(law))),
        "view": observe_states.bind(  # each in a place of its own, so that nothing can be left out
            plant, course.reference, plant.period * np.arange(periods), np.tile(p, (periods, 1)),
            np.tile(v, (periods, 1)), work, observations.copy(), signals,
        ),
        "loop": Loop(course, plant, law, make_record(plant, periods, 1)),
    }  # fmt: skip
    contenders: dict[str, Contender] = {name: _per_period(part, periods) for name, part in timed.items()}
    contenders["step"] = lambda: 1e6 * drive(course, forces, plant.integrator, plant.steps).seconds / periods
    return contenders


def _interface(quick: bool) -> dict[str, Contender]:
    """Return steps through the layers of the Gymnasium interface [us], no actions."""
    periods = QUICK_PERIODS if quick else PERIODS
    made = gym.make("SFFRFlex-v0")
    bare: Any = made.unwrapped
    made.reset(seed=0)
    plant, still = bare.plant_task, np.zeros(len(bare.plant_task.scale), dtype=np.float32)
    batch = make_batch(plant, 1)
    put_episode(batch, 0, draw(load_scenario("nominal"), nominal(bare.params), np.random.default_rng(0)))
    stepper = Stepper(step_range, Structures([plant]), batch, len(still), group_shapes(plant))
    stepper.observe()
    steps: dict[str, Callable[[], Any]] = {
        "batch": stepper.step,
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
    """Return what remains of the whole, by the medians; noise may make it slightly negative."""
    return (median(samples[whole]) - sum(median(samples[part]) for part in parts),)
