"""Evaluation of policies on the episodes of a scenario, and the table of their measures and scores."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from math import floor, inf, isfinite, log10
from typing import Any

import numpy as np
from rich import box
from rich.table import Table
from rich.text import Text

from agents.learned import check_titles, load_policy
from agents.score import REFERENCE, WEIGHTS, Result, costs, ratios
from baselines.policies import ORACLES, Policy, left_out
from baselines.rollout import Trajectory, rollout
from sffr_gym import ConfigError, Params
from sffr_gym.env import ParamsLike, SFFRFlexEnv, resolve_params
from sffr_gym.metrics import MEASURES, measure
from sffr_gym.scenario import Scenario, load_scenario

EVALUATION_SEED = 1_000_000  # seeds from here up are for evaluation alone
EPISODES = 10  # default of a scenario that draws something

# Columns of the table: measure, heading, and whether a terminal of less than WIDE columns shows it.
COLUMNS = (
    ("track_rmse", "track\nrmse", True),
    ("track_max", "track\nmax", True),
    ("vibration", "vibr.\nmean", True),
    ("tip_max", "tip\nmax", True),
    ("settling_time", "settled\nafter", True),
    ("piezo_effort", "piezo\neffort", True),
    ("thruster_impulse", "thrust\nimpulse", False),
)
WIDE = 96
PREFIXES = {"m", "rad", "J", "N", "N m"}  # units that take an SI prefix
SMALL = {0: "", -1: "m", -2: "µ", -3: "n", -4: "p"}

Report = Callable[[str, int, int], Any]  # policy, control periods done and in all


@dataclass(frozen=True)
class Evaluation:
    """Policies on the same episodes.

    Attributes:
        scenario, params: as they were run.
        episodes: of each policy; episode i has the seed ``seed + i`` for all of them.
        results: by policy, in the order of the episodes.
        first: the first episode of each policy, for pictures.
        started: when; elapsed: how long it took [s].
    """

    scenario: Scenario
    params: Params
    episodes: int
    seed: int
    results: dict[str, list[Result]]
    first: dict[str, Trajectory]
    started: datetime
    elapsed: float

    def summary(self) -> dict[str, Any]:
        """Scenario, its hash, episodes, seed, and the mean over the episodes of every policy's measures."""
        policies = {
            policy: {name: float(np.mean([result.measures[name] for result in results])) for name in MEASURES}
            for policy, results in self.results.items()
        }
        what = {"scenario": self.scenario.name, "scenario_hash": self.scenario.hash(self.params)}
        return what | {"episodes": self.episodes, "seed": self.seed, "policies": policies}

    @property
    def reference(self) -> str:
        """The policy that ratios refer to: AHSC if it took part, else the first."""
        return REFERENCE if REFERENCE in self.results else next(iter(self.results))


def evaluate(
    policies: Sequence[str],
    scenario: str | os.PathLike[str] = "nominal",
    episodes: int | None = None,
    seed: int = EVALUATION_SEED,
    params: ParamsLike = None,
    overrides: Sequence[str] = (),
    progress: Report | None = None,
) -> Evaluation:
    """Run policies on the same episodes of a scenario.

    Args:
        policies: names, or ``.npz`` files of learned ones. Where a scenario's plant is not what the controllers
            believe, HSC and AHSC run with the right model as well.
        scenario: a shipped scenario's name or a file.
        episodes: of each policy; None for 10, or for 1 if the scenario draws nothing.
        seed: of the first episode, the next one has the next number.
        params: a ``Params`` object, a file, or None for the case study.
        overrides: assignments such as ``"panel.EI=25"`` on top of them.
        progress: called with policy, control periods done and control periods in all, first with 0 for each policy.

    Raises:
        ConfigError: for anything that is not valid; nothing has run then.
    """
    started, clock = datetime.now(UTC), time.perf_counter()
    progress = progress or (lambda policy, done, total: None)
    resolved, chosen = resolve_params(params, list(overrides)), load_scenario(scenario)
    runners = make_policies(with_right_models(policies, chosen), resolved)
    if seed < 0:
        raise ConfigError(f"seed = {seed}: must be at least 0")
    if episodes is not None and episodes < 1:
        raise ConfigError(f"episodes = {episodes}: must be at least 1")
    progress(runners[0].name, 0, 0)  # what follows may have to compile
    env = SFFRFlexEnv(scenario=scenario, params=resolved)
    _, info = env.reset(seed=seed)
    if episodes is None:
        episodes = EPISODES if info["drawn"] else 1
    ends = np.cumsum([0, *(_length(env, seed + i) for i in range(episodes))]).tolist()
    total = ends[-1] * len(runners)
    results: dict[str, list[Result]] = {policy.name: [] for policy in runners}
    first: dict[str, Trajectory] = {}
    for k, policy in enumerate(runners):
        for i in range(episodes):
            begun = ends[-1] * k + ends[i]
            progress(policy.name, begun, total)
            trajectory = rollout(env, policy, seed + i, counter(progress, policy.name, begun, total))
            first.setdefault(policy.name, trajectory)
            results[policy.name].append(result_of(trajectory))
    progress(runners[-1].name, total, total)
    elapsed = time.perf_counter() - clock
    return Evaluation(chosen, resolved, episodes, seed, results, first, started, elapsed)


def with_right_models(policies: Sequence[str], scenario: Scenario) -> list[str]:
    """The policies, each with its oracle behind it if it has one and the scenario's plant is not what it believes."""
    names: list[str] = []
    for policy in policies:
        names.append(policy)
        oracle = ORACLES.get(policy)
        if scenario.changes_model and oracle is not None and oracle not in policies:
            names.append(oracle)
    return names


def result_of(trajectory: Trajectory) -> Result:
    """Measure an episode."""
    measures = measure(trajectory.signals, trajectory.period, trajectory.failure)
    return Result(
        trajectory.scenario, trajectory.policy, trajectory.seed, measures, trajectory.failure, trajectory.drawn
    )


def table(evaluation: Evaluation, width: int = 100) -> Table:
    """The result for a terminal of ``width`` columns: a row for each policy, the means over the episodes."""
    means, results, reference = evaluation.summary()["policies"], evaluation.results, evaluation.reference
    failures = {policy: sum(bool(result.failure) for result in own) for policy, own in results.items()}
    whole = [policy for policy, failed in failures.items() if not failed] or list(results)
    many = "episode" if evaluation.episodes == 1 else "episodes"
    title = f"{evaluation.scenario.name}: {evaluation.episodes} {many} {_span(evaluation)}, from seed {evaluation.seed}"
    out = Table(title=Text(title), box=box.SIMPLE_HEAD, show_edge=False, padding=(0, int(width >= WIDE), 0, 0))
    out.title_style, out.title_justify = "bold", "left"
    out.add_column("\n\npolicy", style="bold", no_wrap=True)
    columns: list[dict[str, str]] = []
    for name, heading, always in COLUMNS:
        if always or width >= WIDE:
            unit, scale = unit_for(MEASURES[name], max(abs(means[policy][name]) for policy in whole))
            out.add_column(f"{heading}\n{unit}", justify="right", no_wrap=True)
            columns.append({policy: number(means[policy][name] / scale) for policy in results})
    for name, heading in ("vibration", "vibr.\nratio"), ("track_rmse", "track\nratio"):
        out.add_column(heading, justify="right", no_wrap=True)
        columns.append({policy: number(value) for policy, value in ratios(results, name, reference).items()})
    if REFERENCE in results:
        out.add_column("\ncost", justify="right", style="bold", no_wrap=True)
        columns.append({policy: number(value) for policy, value in costs(results).items()})
    out.add_column("\nfailed", justify="right", no_wrap=True)
    columns.append({policy: f"{failed}/{evaluation.episodes}" for policy, failed in failures.items()})
    for policy in results:
        out.add_row(Text(policy), *(column[policy] for column in columns), style="red" if failures[policy] else None)
    return out


def remarks(evaluation: Evaluation) -> list[str]:
    """What a reader of the table has to know besides: failures, saturation, what the laws leave undamped."""
    lines = []
    for policy, results in evaluation.results.items():
        reasons = [result.failure for result in results if result.failure]
        for reason in dict.fromkeys(reasons):
            lines.append(f"{policy} failed in {reasons.count(reason)} of {len(results)}: {reason}")
    means = evaluation.summary()["policies"]
    for policy, values in means.items():
        busy = {group: values[f"{group}_saturation"] for group in ("piezo", "thruster", "joint")}
        parts = [f"{group} {number(100.0 * share)} % of the time" for group, share in busy.items() if share > 0.0]
        if parts:
            lines.append(f"{policy} saturates: {', '.join(parts)}")
    if not any(values[name] for values in means.values() for name in values if name.endswith("_saturation")):
        lines.append("no actuator saturates")
    scored = ", ".join(f"{weight:.2f} {name}" for name, weight in WEIGHTS.items())
    cost = f"; cost = {scored}, lower is better" if evaluation.reference == REFERENCE else ""
    lines.append(f"ratios are to {evaluation.reference}{cost}")
    if evaluation.scenario.changes_model:
        lines.append("oracles know each episode's plant; the others take it for the robot of the parameters")
    if undamped := left_out(evaluation.params):
        lines.append(f"hsc and ahsc leave {', '.join(undamped)} undamped at this control period")
    return lines


def number(value: float) -> str:
    """Three significant digits, with an exponent only where the number would be too long to read."""
    if not isfinite(value):
        return "-" if value != value else str(value)
    if value == 0.0:
        return "0"
    if not 1e-3 <= abs(value) < 99_999.5:
        return f"{value:.0e}".replace("e+0", "e").replace("e-0", "e-")
    value = float(f"{value:.3g}") if abs(value) < 1000.0 else value  # so that 0.9996 is 1.00
    return f"{value:.{max(0, 2 - floor(log10(abs(value))))}f}"


def unit_for(unit: str, largest: float) -> tuple[str, float]:
    """The unit with the SI prefix that suits a column's largest value, and how many of the plain one it is."""
    power = floor(log10(largest) / 3) if unit in PREFIXES and 0.0 < largest < inf else 0
    power = min(0, max(power, min(SMALL)))
    return SMALL[power] + unit.replace("2", "²"), 1000.0**power


def counter(progress: Report, policy: str, begun: int, total: int) -> Callable[[int], None]:
    """Turn the increments of an episode into the progress of the whole evaluation."""
    done = begun

    def count(ticks: int) -> None:
        nonlocal done
        done += ticks
        progress(policy, done, total)

    return count


def make_policies(names: Sequence[str], params: Params) -> list[Policy]:
    """Build the policies; raises ConfigError if there is none, for an unknown one and for one that is given twice."""
    if not names:
        raise ConfigError("no policy given")
    check_titles(names)
    return [load_policy(name, params) for name in names]


def _length(env: SFFRFlexEnv, seed: int) -> int:
    """Control periods of an episode."""
    env.reset(seed=seed)
    return env.ticks


def _span(evaluation: Evaluation) -> str:
    """How long the episodes are, for people."""
    scenario, params = evaluation.scenario, evaluation.params
    if scenario.duration is None and scenario.speed is not None:
        return "once around"
    return f"of {scenario.ticks(params) * params.control.period:.4g} s"
