"""What the files of a finished run say, read and checked: its summary or plan, its manifest, its episodes.

Whatever a file holds, it is either one that a run leaves, or an error that names file, line or key, and what is right.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import nan
from pathlib import Path
from typing import Any, Self

from pydantic import ConfigDict, Field, create_model, field_validator, model_validator

from sffr_gym import ConfigError
from sffr_gym.config.field_errors import error_at, raise_errors
from sffr_gym.config.provenance import MANIFEST
from sffr_gym.config.reading import read_csv, read_json
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.config.sections import Section
from sffr_gym.config.strict_yaml import ModelT, build, check_error
from sffr_gym.task.metrics import ARRIVAL_MEASURES, MEASURES
from sffr_gym.task.score import Result
from sffr_gym.task.status import REASONS

SUMMARY_FILE, PLAN_FILE, EPISODES_FILE = "summary.json", "plan.json", "episodes.csv"
KEYS = ("scenario", "policy", "seed")  # of an episode
FILE = "policy_file"  # column of the hash of a policy's file, where one has a file
OWN = (*KEYS, *MEASURES, *ARRIVAL_MEASURES, "failure", FILE)  # columns of an episode; the others were drawn
LONGEST_NAME = 520  # characters, of a policy: those of its file and its folder
FAILURES = tuple(REASONS.values())
_WHOLE, _NUMBER = re.compile(r"-?[0-9]{1,20}"), re.compile(r"-?[0-9]+(\.[0-9]+)?(e[-+]?[0-9]+)?")  # as Python writes

# A measure that was not finite is null; each is a size or, without a unit, a share.
_FIELDS: dict[str, Any] = {
    name: (float | None, Field(ge=0.0, le=1.0 if unit == "1" else None, description=f"[{unit}]"))
    for name, unit in MEASURES.items()
}
_ON_ARRIVAL: dict[str, Any] = {
    name: (float | None, Field(default=None, ge=0.0, description=f"[{unit}]"))
    for name, unit in ARRIVAL_MEASURES.items()
}
Measures = create_model("Measures", __base__=Section, **_FIELDS, **_ON_ARRIVAL)


class Episode(Section):
    """One episode of a policy."""

    scenario: str = Field(min_length=1, max_length=LONGEST_NAME, description="name")
    policy: str = Field(min_length=1, max_length=LONGEST_NAME, description="name")
    seed: int = Field(ge=0, description="of the episode")
    measures: Measures = Field(description="of the episode")
    failure: str = Field(description="why it ended early")
    drawn: dict[str, float] = Field(description="what the scenario drew")
    file: str = Field(default="", pattern="[0-9a-f]*", description="hash of the policy's file")

    @field_validator("scenario", "policy")
    @classmethod
    def _check_name(cls, name: str) -> str:
        if not name.isprintable():
            raise check_error("must be text on one line")
        return name

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.failure not in FAILURES:
            raise_errors([error_at(("failure",), self.failure, f"must be one of {', '.join(map(repr, FAILURES))}")])
        failed, own = float(self.failure != ""), dict(self.measures)
        if own["failed"] != failed:
            reason = f"must be {failed:g} with the failure {self.failure!r}"
            raise_errors([error_at(("measures", "failed"), own["failed"], reason)])
        reason = "must be a number where the episode did not fail"
        lost = [name for name in MEASURES if own[name] is None and not failed]
        raise_errors([error_at(("measures", name), None, reason) for name in lost])
        return self

    def result(self) -> Result:
        """Return the episode; a measure that was not finite is NaN."""
        own = dict(self.measures)
        arrived = [name for name in ARRIVAL_MEASURES if own[name] is not None]
        measures = {name: nan if own[name] is None else own[name] for name in (*MEASURES, *arrived)}
        return Result(self.scenario, self.policy, self.seed, measures, self.failure, self.drawn, self.file)


class Summary(Section):
    """What ``summary.json`` says of an evaluation."""

    scenario: str = Field(min_length=1, description="name")
    scenario_hash: str = Field(description="of the scenario and the parameters")
    episodes: int = Field(ge=1, description="of each policy")
    seed: int = Field(ge=0, description="of the first one")
    policies: dict[str, dict[str, float | None]] = Field(description="means of each policy's measures")


class Identity(Section):
    """What episodes must agree in to stand in one table; ``plan.json`` of a benchmark."""

    version: str | None = Field(description="of sffr-gym")
    code: str = Field(description="hash of all code and settings that decide an episode")
    config_hash: str = Field(description="of the parameters")
    scenarios: dict[str, str] = Field(description="hashes by name")
    policies: dict[str, str] = Field(description="hashes of learned ones, by name")


class Git(Section):
    """The code of a run."""

    commit: str = Field(description="that was checked out")
    dirty: bool = Field(description="whether anything differed from it")


class Manifest(Section):
    """What all manifests say; each command adds what it takes to repeat its run."""

    model_config = ConfigDict(extra="ignore")

    command: str = Field(description="as typed")
    started: str = Field(description="when")
    duration_s: float = Field(ge=0.0, description="[s]")
    versions: dict[str, str | None] = Field(description="of packages")
    platform: str = Field(description="system")
    machine: str = Field(description="processor's kind")
    cpus: int | None = Field(description="how many")
    git: Git | None = Field(description="commit of the code")
    policies: tuple[str, ...] = Field(description="names")


def read_record(model: type[ModelT], file: Path) -> ModelT:
    """Return what a JSON file says.

    Raises:
        ConfigError: if it cannot be read, or says anything else.
    """
    return check_record(model, read_json(file), str(file))


def check_record(model: type[ModelT], data: Any, where: str) -> ModelT:
    """Return the model with data of any kind, or raise ConfigError with the place where they stand."""
    if not isinstance(data, dict):
        raise ConfigError(f"{where}: must hold a mapping of keys to values")
    return build(model, data, lambda key: where)


def open_run(path: Path) -> RunFolder:
    """Return the folder of a finished evaluation or benchmark; raises ConfigError if it is none."""
    return RunFolder.open(path, "evaluation", "benchmark")


def scenario_hashes(run: RunFolder) -> dict[str, str]:
    """Return the hash of each scenario of a run; raises ConfigError for a damaged file."""
    if run.kind == "benchmark":
        return dict(read_record(Identity, run.file(PLAN_FILE)).scenarios)
    summary = read_record(Summary, run.file(SUMMARY_FILE))
    return {summary.scenario: summary.scenario_hash}


def read_manifest(run: RunFolder) -> tuple[Manifest, dict[str, Any]]:
    """Return the manifest of a run, and all that its file says; raises ConfigError for a damaged file."""
    file = run.file(MANIFEST)
    data = read_json(file)
    return check_record(Manifest, data, str(file)), data


def read_episodes(run: RunFolder | Path) -> list[Result]:
    """Return the episodes of a finished run.

    Raises:
        ConfigError: if the folder holds no finished run, or its file is damaged: other columns, an episode that cannot
            be, one that is there twice, of a scenario that is not the run's, or missing for one of the policies.
    """
    if isinstance(run, Path):
        run = open_run(run)
    file, scenarios = run.file(EPISODES_FILE), scenario_hashes(run)
    rows = read_csv(file, (*KEYS, *MEASURES, "failure"))
    if not rows:
        raise ConfigError(f"{file}: holds no episode")
    lines: dict[tuple[str, str, int], int] = {}
    results = []
    for line, row in enumerate(rows, 2):
        result = _read_row(row, f"{file}:{line}")
        if result.scenario not in scenarios:
            name = result.scenario[:60]
            raise ConfigError(f"{file}:{line}: scenario = {name!r}: must be one of {', '.join(scenarios)[:300]}")
        key = (result.scenario, result.policy, result.seed)
        if (before := lines.setdefault(key, line)) != line:
            raise ConfigError(f"{file}:{line}: seed = {result.seed}: this policy's episode stands in line {before}")
        results.append(result)
    _check_complete(results, file)
    return results


def _check_complete(results: list[Result], file: Path) -> None:
    """Raise ConfigError unless the policies of each scenario ran on the same episodes."""
    seeds: dict[str, dict[str, set[int]]] = {}
    for result in results:
        seeds.setdefault(result.scenario, {}).setdefault(result.policy, set()).add(result.seed)
    for scenario, group in seeds.items():
        every = set.union(*group.values())
        for policy, own in group.items():
            if missing := every - own:
                raise ConfigError(f"{file}: {scenario}: has no episode of {policy} with seed {min(missing)}")


def _read_row(row: Mapping[str, str], where: str) -> Result:
    """Return the result of a row of the episodes' file."""
    names = (*MEASURES, *(name for name in ARRIVAL_MEASURES if name in row))
    drawn = {name: text for name, text in row.items() if name not in OWN and text}
    data = {
        "scenario": row["scenario"],
        "policy": row["policy"],
        "seed": _value(row["seed"]),
        "measures": {name: _value(row[name]) if row[name] else None for name in names},
        "failure": row["failure"],
        "drawn": {name: _value(text) for name, text in drawn.items()},
        "file": row.get(FILE, ""),
    }
    return build(Episode, data, lambda key: where).result()


def _value(text: str) -> int | float | str:
    """Return the number that a cell holds; a text that is none as it is."""
    if _WHOLE.fullmatch(text):
        return int(text)
    return float(text) if _NUMBER.fullmatch(text) else text
