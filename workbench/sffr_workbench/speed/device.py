"""How fast a GPU is: ``python -m sffr_workbench.speed.device`` prints rates in millions of control periods a second.

Of the environments as they are stepped, of a law inside, and of the physics alone, for several numbers of environments.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from time import perf_counter
from typing import Any, NamedTuple

import gymnasium as gym

from sffr_gym.compile.cuda.described import FIRST, LAST, Memory, Rows, Thread, rows
from sffr_gym.compile.kernels import kernel
from sffr_gym.config.params import load_params
from sffr_gym.envs.backends import find_gpu
from sffr_gym.physics.initial import initial_positions
from sffr_gym.physics.integrator import StepWork, advance, step_shapes
from sffr_gym.task.task_model import make_task_model
from sffr_gym.types import Array

SIZES = 2**14, 2**17, 2**19
SECONDS = 1.0  # of each measurement
DECISIONS: dict[str, Any] = {"agent_period": 0.1, "scenario": "nominal", "random_phase": False, "duration": None}


class PlantWork(NamedTuple):
    """Memory of a plant that is advanced in a thread."""

    step: StepWork
    p: Array  #: (n,)
    v: Array  #: (n,)
    tau: Array  #: (n,)


@kernel
def plant_range(model, p, v, tau, duration, steps, integrator, work, first, last):
    """Advance the plants from ``first`` up to ``last``; p, v, tau: (n, n_q); see :func:`integrator.advance`."""
    for i in range(first, last):
        for k in range(len(work.p)):
            work.p[k], work.v[k], work.tau[k] = p[i, k], v[i, k], tau[i, k]
        advance(model, work.p, work.v, work.tau, duration, steps, integrator, work.step)
        for k in range(len(work.p)):
            p[i, k], v[i, k] = work.p[k], work.v[k]


def environments(n: int) -> float:
    """Return control periods of ``SFFRFlex-v0`` a second, actions 0, no episode ends."""
    return n * _steps_per_second(gym.make_vec("SFFRFlex-v0", num_envs=n, backend="cuda"))


def laws(n: int) -> float:
    """Return control periods a second of ``SFFRFlexDamping-v0``: AHSC, plant, observation and reward, 50 in a call."""
    envs: Any = gym.make_vec("SFFRFlexDamping-v0", num_envs=n, backend="cuda", **DECISIONS)
    return n * envs.host.law.schedule.hold * _steps_per_second(envs)


def plants(n: int) -> float:
    """Return steps of 2 ms of the physics alone a second, from the configured start, without forces."""
    gpu, params = find_gpu(), load_params()
    task, xp = make_task_model(params), gpu.xp
    size: Any = (task.model.at.end,)
    p, v, tau = (rows(xp, n, size, "f") for _ in range(3))
    for array, start in zip((p, v), initial_positions(params, task.model), strict=True):
        array[...] = xp.asarray(start)
    work = Memory(PlantWork(step_shapes(task.model), size, size, size))
    thread = Thread("plant", plant_range, (
        task.model, Rows(p), Rows(v), Rows(tau), task.period, task.steps, task.integrator, work, FIRST, LAST,
    ))  # fmt: skip
    return n * _per_second(xp, gpu.launches(n, [thread])["plant"])


def _steps_per_second(envs: Any) -> float:
    xp = envs.device.xp
    envs.reset(seed=0)
    still = xp.zeros(envs.action_space.shape)
    return _per_second(xp, lambda: envs.step(still))


def _per_second(xp: Any, call: Callable[[], Any]) -> float:
    """Return how often something can be done in a second."""
    count, elapsed = 1, 0.0
    call()
    while elapsed < SECONDS:
        count *= 4
        xp.cuda.Device().synchronize()
        begun = perf_counter()
        for _ in range(count):
            call()
        xp.cuda.Device().synchronize()
        elapsed = perf_counter() - begun
    return count / elapsed


def main() -> None:
    """Print the rates."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sizes", type=int, nargs="*", default=SIZES, metavar="N", help="numbers of environments")
    for n in parser.parse_args().sizes:
        for measure in environments, laws, plants:
            print(f"{n:8d} {measure.__name__:12s} {measure(n) / 1.0e6:8.1f} million periods/s", flush=True)


if __name__ == "__main__":
    main()
