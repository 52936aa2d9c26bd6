"""The golden record: what every policy, environment and table gave when the record was made, as digests.

``python tests/golden.py`` makes it again, for a change that is meant to change results; ``test_golden.py`` compares. A
case is a name and a dictionary of arrays or texts. Its record has the SHA-256 of all of them, and a few plain numbers
for machines whose elementary functions have other last bits.
"""

from __future__ import annotations

import functools
import hashlib
import json
import math
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from sffr_baselines import POLICIES, Policy, make_policy
from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv
from sffr_baselines.rollout import rollout
from sffr_gym import Params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.task.scenario import scenario_names
from sffr_gym.task.status import Failure
from sffr_workbench.evaluation import episodes_csv, evaluate, summary_remarks, summary_table

PERIODS = 3000  # of each episode
SEEDS = (1_000_000, 1_000_001)
ENVIRONMENTS = 11  # of a batch: a group in lanes, and three one by one
VARIANTS = {  # robots and settings that take other ways through the kernels
    "elements": ("panel.elements=4",),
    "rk4": ("simulation.integrator=rk4",),
    "staggered": ("simulation.coupling=staggered",),
    "free": ("object=null",),
    "tangent": ("path.heading=tangent", "initial.qd=[0.85, 0, 0, 0, 0, 0, 0, 0, 0]"),  # else it begins turning
    "patches": ("actuators.piezo.array=patches",),
    "undamped": ("panel.strain_rate_damping=0", "suppression.coordinates=[q5, q6]"),
}
TABLES = {"nominal": (["none", "hsc", "ahsc", "ppo", "sac"], 1), "mismatch": (["hsc", "ahsc"], 2)}
HOLD = 50  # control periods of a decision
RECORD = Path(__file__).with_name("golden.json")
Case = dict[str, Any]


def scenario_cases(scenario: str) -> Iterator[tuple[str, Case]]:
    """Every policy, and both environments, single and batched, on a scenario."""
    env = SFFRFlexEnv(scenario=scenario)
    for policy in POLICIES:
        for seed in SEEDS:
            yield f"policy/{policy}/{scenario}/{seed}", closed_loop(env, policy, seed)
    damping: dict[str, Any] = {"scenario": scenario, "duration": PERIODS * env.params.control.period}
    yield f"single/{scenario}", single(SFFRFlexEnv(scenario=scenario), PERIODS, 0.05)
    yield f"batch/{scenario}", batch(SFFRFlexVectorEnv(ENVIRONMENTS, scenario=scenario), PERIODS, 0.05)
    yield f"damping/{scenario}", single(SFFRFlexDampingEnv(**damping), PERIODS // HOLD, 1.0)
    yield f"damping-batch/{scenario}", batch(SFFRFlexDampingVectorEnv(ENVIRONMENTS, **damping), PERIODS // HOLD, 1.0)


def variant_cases(name: str) -> Iterator[tuple[str, Case]]:
    """AHSC on another robot, or with other settings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of steps that are too long for the staggered coupling
        env = SFFRFlexEnv(scenario="nominal" if name == "staggered" else "excited", overrides=VARIANTS[name])
    yield f"variant/{name}", closed_loop(env, "ahsc", SEEDS[0])


def table_cases(scenario: str) -> Iterator[tuple[str, Case]]:
    """The tables of ``sffr evaluate`` over whole episodes."""
    policies, episodes = TABLES[scenario]
    yield f"evaluate/{scenario}", evaluation(policies, scenario, episodes)


GROUPS: dict[str, Callable[[], Iterator[tuple[str, Case]]]] = {
    **{f"scenario {name}": partial(scenario_cases, name) for name in scenario_names()},
    **{f"variant {name}": partial(variant_cases, name) for name in VARIANTS},
    **{f"table {name}": partial(table_cases, name) for name in TABLES},
}


def closed_loop(env: SFFRFlexEnv, policy: str, seed: int) -> Case:
    """An episode as :func:`rollout` returns it."""
    short = env.scenario.model_copy(update={"duration": PERIODS * env.params.control.period})
    env.reset(options={"scenario": short})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of laws that are unstable with a variant
        trajectory = rollout(env, policy_of(policy, env.params), seed)
    kept = ("signals", "tips", "t", "p", "v", "obs", "applied", "B_hat", "q_flex", "lam", "failure")
    case = {name: getattr(trajectory, name) for name in kept}
    return case | {f"drawn_{name}": value for name, value in trajectory.drawn.items()}


@functools.cache
def policy_of(name: str, params: Params) -> Policy:
    """A policy for all the scenarios of a robot, which each rollout resets."""
    return make_policy(name, params)


def single(env: gym.Env[Any, Any], steps: int, size: float) -> Case:
    """Random actions of a single environment, one episode after the other."""
    rng = np.random.default_rng(7)
    rows = [env.reset(seed=SEEDS[0])]
    for _ in range(steps):
        obs, reward, terminated, truncated, info = env.step(size * rng.uniform(-1.0, 1.0, env.action_space.shape))
        rows.append((obs, info | {"reward": reward, "end": 2 * terminated + truncated}))
        if terminated or truncated:
            rows.append(env.reset())
    return gathered(rows)


def batch(env: gym.vector.VectorEnv[Any, Any, Any], steps: int, size: float) -> Case:
    """Random actions of a batch, with autoresets."""
    rng = np.random.default_rng(8)
    rows = [env.reset(seed=SEEDS[0])]
    for _ in range(steps):
        obs, reward, terminated, truncated, infos = env.step(size * rng.uniform(-1.0, 1.0, env.action_space.shape))
        rows.append((obs, infos | {"reward": reward, "end": 2 * terminated + truncated}))
    return gathered(rows)


def evaluation(policies: list[str], scenario: str, episodes: int) -> Case:
    """The tables of ``sffr evaluate`` over whole episodes."""
    done = evaluate(policies, scenario, episodes)
    rows = [result for results in done.results.values() for result in results]
    shown = summary_table(done)
    cells = [[str(cell) for cell in column.cells] for column in shown.columns]
    headings = [str(column.header) for column in shown.columns]
    printed = json.dumps([str(shown.title), headings, cells])
    return {"csv": episodes_csv(rows), "table": printed, "remarks": "\n".join(summary_remarks(done))}


def gathered(rows: list[tuple[Any, dict[str, Any]]]) -> Case:
    """Observations and infos of many steps, each quantity as one array."""
    case: Case = {"obs": np.array([obs for obs, _ in rows])}
    names = {name for _, info in rows for name in info if not name.startswith(("drawn_", "_drawn_"))}
    for name in sorted(names - {"failure"}):
        case[name] = np.array([info[name] for _, info in rows if name in info], dtype=np.float64).ravel()
    reasons = [np.vectorize(lambda code: str(Failure(code)), otypes=[object])(info["failure"]) for _, info in rows]
    drawn = [{name.replace("drawn_", "", 1): info[name] for name in info if name not in names} for _, info in rows]
    for name, values in ("failure", reasons), ("drawn", drawn):
        case[name] = json.dumps(values, default=lambda value: value.tolist())
    return case


def recorded(case: Case) -> dict[str, Any]:
    """Digest and sample of a case."""
    digest = hashlib.sha256()
    sample: list[float | None] = []
    for name in sorted(case):
        value = case[name]
        digest.update(name.encode())
        if isinstance(value, str):
            digest.update(value.encode())
            continue
        array = np.ascontiguousarray(np.where(np.isnan(value), np.nan, value), dtype=np.float64)
        digest.update(f"{array.shape}".encode() + array.tobytes())
        if array.size:
            last = array.reshape(len(array), -1)[-1] if array.ndim else array.reshape(1)
            sample += [float(number) if math.isfinite(number) else None for number in (last.sum(), np.abs(last).max())]
    return {"digest": digest.hexdigest()[:32], "sample": sample}


def elementary_functions() -> str:
    """Digest of this machine's elementary functions and matrix products, on which the last bits depend."""
    x = np.linspace(-20.0, 20.0, 4001)
    digest = hashlib.sha256()
    for function in math.sin, math.cos, math.exp, math.tanh:
        digest.update(np.array([function(each) for each in x.tolist()]).tobytes())
    A = np.sin(np.arange(4096.0)).reshape(64, 64)
    for array in (
        np.sin(x),
        np.cos(x),
        np.exp(x),
        np.log(np.abs(x) + 0.1),
        A @ A.T,
        np.linalg.inv(A),
        np.linalg.eigh(A @ A.T)[0],
    ):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]


def record() -> dict[str, Any]:
    """The whole record."""
    cases = {name: recorded(case) for group in GROUPS.values() for name, case in group()}
    return {"elementary_functions": elementary_functions(), "cases": cases}


if __name__ == "__main__":
    RECORD.write_text(json.dumps(record(), indent=0) + "\n", encoding="utf-8")
