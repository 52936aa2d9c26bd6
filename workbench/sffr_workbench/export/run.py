"""Histories of a run's episodes, at any rate: each is run again from the run's manifest, and must measure the same."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sffr_baselines.policies import POLICIES, make_policy, policy_title
from sffr_baselines.rollout import STRIDE, Trajectory, result_of, rollout
from sffr_gym import ConfigError, Params
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.config.strict_yaml import build
from sffr_gym.config.suggestion import did_you_mean
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.scenario import Scenario
from sffr_gym.task.score import Result
from sffr_workbench.common import Progress, file_name, ignore
from sffr_workbench.evaluation import file_hashes, given_files, open_run, read_episodes, read_manifest
from sffr_workbench.export.histories import history
from sffr_workbench.export.tables import SCHEMA_FILE, schema, table_bytes


class Choice(NamedTuple):
    """Which episodes of a run are exported."""

    policies: Sequence[str] = ()  #: titles; none for all
    seeds: Sequence[int] = ()  #: none for the first of each scenario
    every: bool = False  #: all episodes


class History(NamedTuple):
    """One episode of a run."""

    name: str  #: of its file, without ending
    result: Result  #: as the run has it


def export_run(
    source: Path, target: RunFolder, form: str, rate: float | None, choice: Choice, progress: Progress = ignore
) -> list[Path]:
    """Write the histories of a run's episodes, and what their columns are.

    Args:
        source: folder of ``sffr evaluate`` or ``sffr benchmark``.
        target: folder of the files.
        form: one of ``tables.FORMS``.
        rate: rows a second [Hz]; None for that of recordings.
        choice: which episodes.
        progress: called with the episode, how many are done, and how many there are.

    Raises:
        ConfigError: for a run that is none or damaged, no such episode, a rate that is no whole part of the control
            rate, or an episode that does not come out as the run has it.
    """
    run = open_run(source)
    _, facts = read_manifest(run)
    params = build(Params, facts["config"], lambda key: f"{source}: config")
    stored = facts["scenarios"] if run.kind == "benchmark" else [facts["scenario"]]
    scenarios = {each["name"]: build(Scenario, each, lambda key: f"{source}: scenario") for each in stored}
    names = {policy_title(name): name for name in facts.get("policy_names", facts["policies"])}
    chosen = choose(read_episodes(run), choice, source)
    contents: dict[str, bytes] = {}
    schemas: dict[str, str] = {}
    for done, (name, result) in enumerate(chosen):
        progress(name, done, len(chosen))
        scenario = scenarios[result.scenario]
        trajectory = run_again(scenario, params, _name(names, result, source), result, rate)
        columns = history(trajectory)
        contents[f"{name}.{form}"] = table_bytes(columns, form)
        schemas.setdefault(schema(columns), name)
    for text, name in schemas.items():
        contents[SCHEMA_FILE if len(schemas) == 1 else f"{name}.{SCHEMA_FILE}"] = text.encode()
    target.check_names(list(contents))
    return target.replace(contents, remove=target.files)


def choose(results: Sequence[Result], choice: Choice, source: Path) -> list[History]:
    """Return the episodes that are asked for; raises ConfigError if there is none."""
    titles = list(dict.fromkeys(result.policy for result in results))
    for policy in choice.policies:
        if policy not in titles:
            raise ConfigError(f"{source}: has no {policy!r}{did_you_mean(policy, titles)} (has {', '.join(titles)})")
    several = len({result.scenario for result in results}) > 1
    found: list[History] = []
    begun: set[tuple[str, str]] = set()
    for result in results:
        key = result.scenario, result.policy
        wanted = result.seed in choice.seeds if choice.seeds else choice.every or key not in begun
        if wanted and (not choice.policies or result.policy in choice.policies):
            begun.add(key)
            parts = [*([result.scenario] if several else []), result.policy, str(result.seed)]
            found.append(History("-".join(map(file_name, parts)), result))
    if not found:
        raise ConfigError(f"{source}: has no episode with the seed {', '.join(map(str, choice.seeds))}")
    return found


def run_again(scenario: Scenario, params: Params, name: str, result: Result, rate: float | None) -> Trajectory:
    """Return an episode of a run, recorded at a rate; see :func:`export_run`."""
    env = SFFRFlexEnv(scenario=scenario, params=params)
    policy: Any = make_policy(name, env.params)
    trajectory = rollout(env, policy, result.seed, stride=stride_of(rate, env.params.control.period))
    again = result_of(trajectory)
    if again.measures != result.measures:
        raise ConfigError(
            f"{result.policy}, seed {result.seed}: comes out otherwise than the run has it; run it again with the code "
            "of now: sffr evaluate"
        )
    return trajectory


def stride_of(rate: float | None, period: float) -> int:
    """Return the control periods between two rows; raises ConfigError for a rate that does not fit."""
    if rate is None:
        return STRIDE
    stride = 1.0 / (rate * period)
    if round(stride) < 1 or abs(stride - round(stride)) > 1e-6 * stride:
        most = 1.0 / period
        near = most / max(round(stride), 1)
        raise ConfigError(f"rate = {rate:g}: must be {most:g} Hz divided by a whole number, such as {near:g}")
    return round(stride)


def _name(names: dict[str, str], result: Result, source: Path) -> str:
    """Return the name by which a policy is made; raises ConfigError if its file is another one now."""
    name = names.get(result.policy, result.policy)
    if name not in POLICIES and not given_files([name]):
        raise ConfigError(f"{source}: {result.policy}: the run does not say by which name it was made")
    if result.file and (now := file_hashes([name]).get(result.policy)) != result.file:
        raise ConfigError(f"{name}: is not the file that the run was made with ({now} now, {result.file} then)")
    return name
