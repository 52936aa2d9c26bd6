"""Robots that nobody has built: each for some periods alone, in a batch and under every policy."""

from __future__ import annotations

import json
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st
from odd import dumped
from robots import configs
from states import step
from trial import REFUSED, WORKED, Trial, Violation, check_refusal

from sffr_baselines import POLICIES, make_policy
from sffr_gym import ConfigError, load_params
from sffr_gym.config.params import Params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv

STEPS, ROWS = 100, 9
RANGES = {
    "base.mass": (5.0, 5000.0), "base.inertia": (1.0, 1000.0), "panel.mass": (0.5, 50.0), "panel.length": (0.5, 10.0),
    "panel.EI": (0.5, 500.0), "panel.strain_rate_damping": (1e-7, 1e-2), "panel.bending_cut": (20.0, 400.0),
    "object.mass": (0.1, 200.0), "object.inertia": (0.01, 50.0), "actuators.thruster_force": (1.0, 1000.0),
    "actuators.joint_torque": (0.5, 100.0), "actuators.piezo.voltage": (10.0, 1000.0), "path.radius": (0.5, 100.0),
    "path.speed": (0.05, 3.0), "control.period": (3e-4, 6e-3), "simulation.max_step": (2e-4, 1e-2),
    "simulation.baumgarte": (0.1, 100.0), "arms.0.links.0.mass": (0.5, 30.0), "arms.1.links.1.inertia": (0.05, 5.0),
}  # fmt: skip
CHOICES = {
    "panel.elements": [1, 1, 2, 3, 5], "actuators.piezo.array": ["generalized", "patches", "tip"],
    "simulation.integrator": ["etdrk4", "rk4"], "simulation.coupling": ["exact", "exact", "staggered"],
    "path.heading": ["fixed", "tangent"], "suppression.coordinates": ["auto", "all", "[q5]"], "object": ["null"],
    "panel.mounts": ["[]", *(
        "[" + ", ".join(f"{{name: p{k}, root: [0.0, {0.3 * k}], angle: {0.9 * k}}}" for k in range(count)) + "]"
        for count in (1, 3, 4)
    )],
}  # fmt: skip


@st.composite
def overrides(draw: st.DrawFn) -> list[str]:
    """Draw what makes another robot of the case study."""
    made = []
    for key in draw(st.lists(st.sampled_from(sorted(RANGES)), unique=True, max_size=6)):
        low, high = RANGES[key]
        made.append(f"{key}={math.exp(draw(st.floats(math.log(low), math.log(high)))):.6g}")
    for key in draw(st.lists(st.sampled_from(sorted(CHOICES)), unique=True, max_size=3)):
        made.append(f"{key}={draw(st.sampled_from(CHOICES[key]))}")
    return sorted(made, key=lambda each: each != "object=null", reverse=True)  # else the object's keys would come back


class Machines:
    """Robots of others."""

    name = "machines"
    most_seconds, most_memory = 10.0, 1e9

    def make_exemplars(self, folder: Path) -> None:
        """None are needed."""

    def load(self, folder: Path) -> None:
        """Let everything be compiled."""
        for change in ([], ["simulation.coupling=staggered"]):
            self._run(load_params().with_overrides(*change))

    def trials(self) -> st.SearchStrategy[Trial]:
        """Draw a robot, of a file or of overrides."""
        files = configs().map(lambda made: Trial(json.dumps(made), "file", {"robot.yaml": dumped(made)}))
        changes = overrides().map(
            lambda made: Trial(" ".join(made), "overrides", {"robot.json": json.dumps(made).encode()})
        )
        return st.one_of(files, files, changes)

    def attempt(self, trial: Trial, folder: Path) -> tuple[str, dict[str, int]]:
        """Build it and step it."""
        try:
            if trial.target == "file":
                return WORKED, self._run(load_params(folder / "robot.yaml"))
            return WORKED, self._run(load_params().with_overrides(*json.loads((folder / "robot.json").read_text())))
        except ConfigError as error:
            check_refusal(str(error), [str(folder), "override", *(f"{section}." for section in Params.model_fields)])
            return REFUSED, {}

    def _run(self, params: Params) -> dict[str, int]:
        """Step a robot alone and in a batch, which must agree bit for bit, and under every policy."""
        env, batch = SFFRFlexEnv(params=params), SFFRFlexVectorEnv(ROWS, params=params, autoreset_mode="Disabled")
        rng, counts = np.random.default_rng(0), {"periods": 0}
        seen, rows = env.reset(seed=0)[0], batch.reset(seed=0)[0]
        for _ in range(STEPS):
            if not (rows[0] == seen).all():
                raise Violation("the batch is another one than the single environment")
            actions = rng.uniform(-1.0, 1.0, batch.action_space.shape)
            seen, done = step(env, actions[0])
            rows, over = step(batch, actions)
            counts["periods"] += 1 + ROWS
            if done or over:
                break
        for name in POLICIES:
            counts[f"policy {name}"] = self._under(name, env)
        return counts

    def _under(self, name: str, env: Any) -> int:
        """Step a robot under a policy, and say whether it has that one."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that a law is unstable there
            try:
                policy = make_policy(name, env)
            except ConfigError as error:
                check_refusal(str(error), [name, "policy", *(f"{section}." for section in Params.model_fields)])
                return 0
        obs, _ = env.reset(seed=1)
        policy.reset(seed=1)
        if hasattr(policy, "set_plant"):
            policy.set_plant(env.plant)
        for _ in range(STEPS):
            action = policy(obs)
            if np.isnan(
                action
            ).any():  # the law has no answer where its robot is singular, and environments refuse that
                break
            obs, done = step(env, action)
            if done:
                break
        return 1
