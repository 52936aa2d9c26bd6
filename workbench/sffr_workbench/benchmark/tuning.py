"""Settings of a law that cost least on training episodes, found by an optimiser."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from sffr_baselines import make_policy
from sffr_baselines.laws import LawPolicy, make_law
from sffr_baselines.policies import Policy
from sffr_baselines.rollout import result_of, rollout
from sffr_baselines.settings import TUNED, Settings
from sffr_gym import ConfigError, Params
from sffr_gym.config.arguments import check_arguments
from sffr_gym.config.files import write_whole
from sffr_gym.config.suggestion import did_you_mean
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.scenario import EVALUATION_SEED, EpisodeRange
from sffr_gym.task.score import REFERENCE, Result, costs
from sffr_gym.types import Array

SCENARIO, TRAINING_EPISODES, EVALUATIONS = "excited", 20, 60
FIRST_STEP = 0.2  # of the decimal logarithms
TOLERANCE = 1.0e-3  # of the decimal logarithms, 0.2 %
WORST = 1.0e3  # cost of settings out of their ranges
DIGITS = 4  # of what is written

OnTrial = Callable[[Settings, float], Any]  # called with settings and their cost
S = TypeVar("S", bound=Settings)


@dataclass(frozen=True)
class Tuning:
    """What was found."""

    name: str  #: of the law
    settings: Settings  #: of least cost
    cost: float  #: with them
    start_cost: float  #: with those that the search began from; both relative to AHSC on the same episodes
    evaluations: int  #: how many settings were tried


def tune_law(
    name: str,
    params: Params,
    scenarios: Sequence[str] = (SCENARIO,),
    episodes: int = TRAINING_EPISODES,
    seed: int = 0,
    evaluations: int = EVALUATIONS,
    on_trial: OnTrial = lambda settings, cost: None,
) -> Tuning:
    """Minimise a law's cost over the logarithms of its settings by the simplex method of Nelder and Mead.

    Args:
        name: a key of ``settings.TUNED``.
        params: the robot.
        scenarios: shipped names or files; the costs are averaged over them.
        episodes: of training in each scenario, the same for all settings.
        seed: of the first one.
        evaluations: stop after about as many settings, if not before at 0.2 %.
        on_trial: called with all settings that are tried, and their cost.

    Raises:
        ConfigError: for a law without settings, for seeds that are for evaluation alone, for no episodes, or for
            settings to begin from of which one is zero.
    """
    if name not in TUNED:
        raise ConfigError(f"law {name!r}{did_you_mean(name, TUNED)} has no settings to tune; {', '.join(TUNED)} have")
    check_arguments(EpisodeRange, episodes=episodes, seed=seed)
    if seed + episodes > EVALUATION_SEED:
        raise ConfigError(
            f"seeds {seed} to {seed + episodes - 1}: training takes those from 0 to {EVALUATION_SEED - 1}"
        )
    envs = [SFFRFlexEnv(scenario=scenario, params=params) for scenario in scenarios]
    start = TUNED[name].start(params)
    first = searched(start)
    if not first.all():
        raise ConfigError(f"{', '.join(start.SEARCHED)} = {first.tolist()}: must be positive to start from")
    references = [_episodes(env, make_policy(REFERENCE, env), seed, episodes) for env in envs]

    def cost(settings: Settings) -> float:
        terms = []
        for env, reference in zip(envs, references, strict=True):
            own = _episodes(env, LawPolicy(name, make_law(name, env.params, settings)), seed, episodes)
            terms.append(costs({REFERENCE: reference, name: own})[name])
        value = float(np.mean(terms))
        on_trial(settings, value)
        return value

    def trial(logarithms: Array) -> float:
        try:
            return cost(with_searched(start, 10.0**logarithms))
        except ValidationError:  # of the ranges
            return WORST

    from scipy.optimize import minimize  # here, since it takes longer to load than all else

    simplex = np.log10(first) + FIRST_STEP * np.vstack([np.zeros(len(first)), np.eye(len(first))])
    found = minimize(
        trial, simplex[0], method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": TOLERANCE, "fatol": 1.0e-5, "maxfev": evaluations},
    )  # fmt: skip
    best = with_searched(start, [float(f"{value:.{DIGITS}g}") for value in 10.0**found.x])
    return Tuning(name, best, cost(best), cost(start), int(found.nfev))


def searched(settings: Settings) -> Array:
    """Return the numbers that are searched, one after another."""
    return np.concatenate([np.atleast_1d(getattr(settings, name)) for name in settings.SEARCHED])


def with_searched(settings: S, numbers: Sequence[float] | Array) -> S:
    """Return the settings with other numbers in place of those that are searched.

    Raises:
        ValidationError: for numbers out of their ranges.
    """
    values, rest = settings.model_dump(), [float(number) for number in numbers]
    for name in settings.SEARCHED:
        if isinstance(values[name], tuple):
            count = len(values[name])
            values[name], rest = tuple(rest[:count]), rest[count:]
        else:
            values[name], rest = rest[0], rest[1:]
    return type(settings).model_validate(values)


def write_settings(file: Path, tuning: Tuning, command: str) -> Path:
    """Write what was found as the settings of the law, with where it comes from."""
    lines = [
        f"# Settings of {tuning.name}, written by the command below. Costs are relative to AHSC's on the same episodes",
        f"# of training; the optimiser tried {tuning.evaluations} settings.",
    ]
    for name, field in type(tuning.settings).model_fields.items():
        if name != "found":
            lines.append(f"{name}: {json.dumps(getattr(tuning.settings, name))}   # {field.description}")
    lines += [
        "found:",
        f"  cost: {tuning.cost:.5f}",
        f"  start_cost: {tuning.start_cost:.5f}",
        f"  command: {json.dumps(command)}",
        f"  date: {datetime.now(UTC):%Y-%m-%d}",
    ]
    file.parent.mkdir(parents=True, exist_ok=True)
    return write_whole(file, ("\n".join(lines) + "\n").encode())


def _episodes(env: SFFRFlexEnv, policy: Policy, seed: int, count: int) -> list[Result]:
    """Run episodes of a policy."""
    return [result_of(rollout(env, policy, seed + i)) for i in range(count)]
