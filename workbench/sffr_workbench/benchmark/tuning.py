"""The best constant virtual damping of HSC, found by an optimiser on training episodes: the policy ``hsc-tuned``."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from sffr_baselines import make_policy
from sffr_baselines.rollout import result_of, rollout
from sffr_baselines.settings import TunedDamping
from sffr_gym import ConfigError, Params
from sffr_gym.config.arguments import check_arguments
from sffr_gym.config.files import write_whole
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.scenario import EVALUATION_SEED, EpisodeRange
from sffr_gym.task.score import REFERENCE, Result, costs
from sffr_gym.types import Array

SCENARIO, TRAINING_EPISODES, EVALUATIONS = "excited", 20, 60
FIRST_STEP = 0.2  # of the decimal logarithms
TOLERANCE = 1.0e-3  # of the decimal logarithms, 0.2 %

OnPair = Callable[[float, float, float], Any]  # called with q5, q6 and their cost


@dataclass(frozen=True)
class Tuning:
    """What was found."""

    q5: float  #: virtual damping of the bending coordinates [N s/m, N m s/rad]
    q6: float
    cost: float  #: with it
    hsc_cost: float  #: with B0; both relative to AHSC on the same episodes
    evaluations: int  #: how many pairs were tried


def tune_hsc(
    params: Params,
    scenario: str = SCENARIO,
    episodes: int = TRAINING_EPISODES,
    seed: int = 0,
    evaluations: int = EVALUATIONS,
    on_pair: OnPair = lambda q5, q6, cost: None,
) -> Tuning:
    """Minimise HSC's cost over its two bending dampings by the simplex method of Nelder and Mead, from B0 on.

    Args:
        params: the robot.
        scenario: shipped name or file.
        episodes: of training, the same for every pair.
        seed: of the first one.
        evaluations: stop after about as many pairs, if not before at 0.2 %.
        on_pair: called with every pair and its cost.

    Raises:
        ConfigError: for seeds that are for evaluation alone, for no episodes, or if B0 has a zero.
    """
    check_arguments(EpisodeRange, episodes=episodes, seed=seed)
    if seed + episodes > EVALUATION_SEED:
        raise ConfigError(
            f"seeds {seed} to {seed + episodes - 1}: training takes those from 0 to {EVALUATION_SEED - 1}"
        )
    env = SFFRFlexEnv(scenario=scenario, params=params)
    prior = env.params
    start = np.array(prior.suppression.B0[1:])
    if not start.all():
        raise ConfigError(f"suppression.B0 = {list(prior.suppression.B0)}: q5 and q6 must be positive to start from")
    reference = _episodes(env, REFERENCE, prior, seed, episodes)

    def cost(logarithms: Array) -> float:
        q5, q6 = (float(value) for value in 10.0**logarithms)
        damping = TunedDamping(q5=q5, q6=q6, cost=0.0, hsc_cost=0.0, command="", date="")
        own = _episodes(env, "hsc", damping.applied_to(prior), seed, episodes)
        value = costs({REFERENCE: reference, "hsc": own})["hsc"]
        on_pair(q5, q6, value)
        return value

    from scipy.optimize import minimize  # here, since it takes longer to load than all else

    simplex = np.log10(start) + FIRST_STEP * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    found = minimize(
        cost, simplex[0], method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": TOLERANCE, "fatol": 1.0e-5, "maxfev": evaluations},
    )  # fmt: skip
    q5, q6 = (float(f"{value:.4g}") for value in 10.0**found.x)
    return Tuning(q5, q6, cost(np.log10([q5, q6])), cost(simplex[0]), int(found.nfev))


def write_damping(file: Path, tuning: Tuning, command: str) -> Path:
    """Write what was found as the settings of ``hsc-tuned``."""
    text = (
        "# Constant virtual damping of hsc-tuned, written by the command below. Costs are relative to AHSC's on the\n"
        f"# same episodes of training; the optimiser tried {tuning.evaluations} pairs.\n"
        f"q5: {tuning.q5!r}   # N s/m, the tip's transverse displacement\n"
        f"q6: {tuning.q6!r}   # N m s/rad, its slope\n"
        f"cost: {tuning.cost:.5f}\n"
        f"hsc_cost: {tuning.hsc_cost:.5f}   # of the paper's B(0)\n"
        f"command: {json.dumps(command)}\n"
        f"date: {datetime.now(UTC):%Y-%m-%d}\n"
    )
    file.parent.mkdir(parents=True, exist_ok=True)
    return write_whole(file, text.encode())


def _episodes(env: SFFRFlexEnv, policy: str, prior: Params, seed: int, count: int) -> list[Result]:
    """Run episodes of a policy that believes in ``prior``."""
    runner = make_policy(policy, prior)
    return [result_of(rollout(env, runner, seed + i)) for i in range(count)]
