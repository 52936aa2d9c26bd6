"""How long it takes to import the package, and from starting Python to the first step, with and without a cache."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from time import perf_counter

from sffr_workbench.speed.measure import Row, Section

IMPORT = "import time; start = time.perf_counter(); import sffr_gym; print(time.perf_counter() - start)"
STEP = (
    "import gymnasium, sffr_gym; env = gymnasium.make('SFFRFlex-v0'); env.reset(seed=0); "
    "env.step(env.action_space.sample()); print('stepped', flush=True)"
)


def starts(repeats: int, quick: bool) -> Section:
    """Measure the import, and the first and later starts to the first step of ``gym.make("SFFRFlex-v0")`` [s].

    ``quick`` leaves out the first start, which compiles the simulator.
    """
    with tempfile.TemporaryDirectory() as empty:
        # numba's cache where the package puts it
        environment = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
        rows = []
        if not quick:
            environment["XDG_CACHE_HOME"] = empty
            rows.append(Row("first", "first start to first step, nothing compiled", "s", (_until_step(environment),)))
        _until_step(environment)  # reads from disk what the next ones find in memory
        later = tuple(_until_step(environment) for _ in range(repeats))
        imports = tuple(float(_run(IMPORT, environment)) for _ in range(repeats))
    rows += [Row("second", "second start to first step", "s", later), Row("import", "import sffr_gym", "s", imports)]
    return Section("starts", "Starts, each in a new process", rows)


def _until_step(environment: dict[str, str]) -> float:
    """Measure the seconds from the start of a process to the end of its first step."""
    start = perf_counter()
    with subprocess.Popen([sys.executable, "-c", STEP], env=environment, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        elapsed = perf_counter() - start
    if line != "stepped\n" or process.returncode:
        raise RuntimeError(f"the new process failed with exit code {process.returncode}")
    return elapsed


def _run(code: str, environment: dict[str, str]) -> str:
    return subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    ).stdout
