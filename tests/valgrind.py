"""Run every compiled entry under valgrind: no read or write of ours may lie outside of what was allocated.

    python tests/valgrind.py

Builds a library for a level that valgrind knows, and steps environments, batches, laws and the simulator with it. What
Python and its libraries do is left aside. A call with arrays that are too short has to be found, or nothing is proved.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

LEVEL, PATIENCE = "x86-64-v3", 900  # s
CLEAN = """
import numpy as np
from sffr_baselines import make_policy
from sffr_baselines.damping_env import SFFRFlexDampingVectorEnv
from sffr_baselines.rollout import rollout, true_observations
from sffr_gym import Simulator
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv

rng = np.random.default_rng(0)
for scenario in "nominal", "mismatch", "noise", "impulse", "degraded", "truth", "patches":
    for change in [], ["panel.elements=2"], ["simulation.coupling=staggered", "simulation.max_step=2.5e-4"]:
        batch = SFFRFlexVectorEnv(11, scenario=scenario, overrides=change)
        batch.reset(seed=0)
        for _ in range(3):
            batch.step(rng.uniform(-1, 1, batch.action_space.shape))
damping = SFFRFlexDampingVectorEnv(9)
damping.reset(seed=0)
damping.step(rng.uniform(-1, 1, damping.action_space.shape))
sensors = {"position": 1e-6, "delay": 1.0}
env = SFFRFlexEnv({"name": "short", "description": "a test's", "duration": 0.02, "sensors": sensors})
for name in "ahsc", "lqr", "lqr-kf", "sac":
    policy = make_policy(name, env)
    true_observations(rollout(env, policy, 0))
    obs, _ = env.reset(seed=0)
    policy.reset()
    for _ in range(3):
        obs = env.step(policy(obs))[0]
simulator = Simulator()
state = simulator.step(simulator.initial_state(), base=[1, 2, 3])
simulator.acceleration(state)
"""
FAULTY = """
import numpy as np
from sffr_gym.compile.arguments import Structures
from sffr_gym.compile.workspace import new_workspace
from sffr_gym.envs.batch import observe_range
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.control_period import period_shapes

env = SFFRFlexEnv()
env.reset(seed=0)
short = env._batch._replace(p=np.zeros((1, 7)), signals=np.zeros((1, 5)))
plants, chosen = Structures([env.plant_task]), np.ones(1, dtype=np.bool_)
observe_range(plants, short, chosen, new_workspace(period_shapes(env.plant_task)), 0, 1)
"""


def found_in(code: str, library: Path) -> int:
    """Return how many lines of valgrind's report name our library."""
    log = library / "valgrind.log"
    environment = os.environ | {
        "PYTHONMALLOC": "malloc", "SFFR_LIBRARY": str(library), "SFFR_LEVEL": LEVEL, "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }  # fmt: skip
    command = ["valgrind", "--error-limit=no", f"--log-file={log}", sys.executable, "-c", code]
    subprocess.run(command, check=True, env=environment, timeout=PATIENCE)
    return log.read_text().count(f"kernels-{LEVEL}.so")


def main() -> int:
    """Run both programs, and say what was found."""
    if shutil.which("valgrind") is None:
        print("valgrind is not installed", file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder)
        subprocess.run([sys.executable, "-m", "sffr_gym.compile.builder", folder, LEVEL], check=True)
        clean, faulty = found_in(CLEAN, library), found_in(FAULTY, library)
    print(f"{clean} lines on our library in what must be clean, {faulty} in what must be found")
    return int(clean > 0 or faulty == 0)


if __name__ == "__main__":
    sys.exit(main())
