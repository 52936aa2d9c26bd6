"""How long the import takes, and from starting Python to the first step of one environment and of many."""

from __future__ import annotations

import subprocess
import sys
from time import perf_counter

from sffr_workbench.speed.measure import Row, Section, rounds

NUM_ENVS = 64  # of SFFRFlexDamping-v0
IMPORT = "import time; start = time.perf_counter(); import sffr_gym; print(time.perf_counter() - start)"
STEP = (
    "import gymnasium, sffr_gym; env = {}; env.reset(seed=0); "
    "env.step(env.action_space.sample()); print('stepped', flush=True)"
)
SINGLE = STEP.format("gymnasium.make('SFFRFlex-v0')")
DAMPING = STEP.format(f"gymnasium.make_vec('SFFRFlexDamping-v0', num_envs={NUM_ENVS})")


def starts(repeats: int, quick: bool) -> Section:
    """Measure the import, and starts to the first step of one environment and of a batch with a law inside [s].

    Nothing is compiled then: the package brings its kernels compiled. It takes seconds, so ``quick`` changes nothing.
    """
    contenders = {"single": lambda: _until_step(SINGLE), "damping": lambda: _until_step(DAMPING), "import": _import}
    names = {
        "single": "start to first step of gym.make",
        "damping": f"start to first step of {NUM_ENVS} environments with a law inside",
        "import": "import sffr_gym",
    }
    samples = rounds(contenders, repeats)
    return Section(
        "starts", "Starts, each in a new process", [Row(key, names[key], "s", samples[key]) for key in names]
    )


def _until_step(code: str) -> float:
    """Measure the seconds from the start of a process to the end of its first step."""
    start = perf_counter()
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        elapsed = perf_counter() - start
    if line != "stepped\n" or process.returncode:
        raise RuntimeError(f"the new process failed with exit code {process.returncode}")
    return elapsed


def _import() -> float:
    """Measure the seconds that the import takes in a process."""
    done = subprocess.run([sys.executable, "-c", IMPORT], capture_output=True, text=True, check=True)
    return float(done.stdout)
