"""Policies of several runs on the episodes that they have in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from sffr_gym import ConfigError
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.task.score import Result
from sffr_workbench.evaluation import open_run, read_episodes, scenario_hashes

Episode = tuple[str, int]  # scenario and seed


def common_episodes(folders: Sequence[Path]) -> list[Result]:
    """Return episodes of all policies of some runs, cut down to those that every one of them ran.

    A policy that several runs have keeps its name where its episodes are bitwise identical, and is told apart as
    ``policy@run`` where they are not. Scenarios that draw something keep the same number of episodes.

    Raises:
        ConfigError: if a folder holds no finished run, or a damaged one, a scenario is not the same in all, or there is
            no such episode.
    """
    runs = [open_run(folder) for folder in folders]
    _check_scenarios(runs)
    entries: dict[str, dict[Episode, Result]] = {}
    for run in runs:
        policies: dict[str, dict[Episode, Result]] = {}
        for result in read_episodes(run):
            policies.setdefault(result.policy, {})[result.scenario, result.seed] = result
        title = run.path.resolve().name
        for policy, own in policies.items():
            known = entries.get(policy)
            same = known is not None and all(known[key] == own[key] for key in known.keys() & own.keys())
            name = policy if known is None or same else f"{policy}@{title}"
            if name in entries and not same:
                raise ConfigError(f"two runs are named {title!r}; rename one")
            entries[name] = (known or {}) | own if same else own
    common = set.intersection(*(set(own) for own in entries.values()))
    if not common:
        raise ConfigError(f"no episode was run by all of {', '.join(entries)}")
    kept = _even(common)
    return [replace(own[key], policy=name) for name, own in entries.items() for key in own if key in kept]


def _even(episodes: set[Episode]) -> set[Episode]:
    """Return the same number of seeds, the lowest ones, of each scenario that has more than one."""
    seeds: dict[str, list[int]] = {}
    for scenario, seed in sorted(episodes):
        seeds.setdefault(scenario, []).append(seed)
    fewest = min((len(own) for own in seeds.values() if len(own) > 1), default=1)
    return {(scenario, seed) for scenario, own in seeds.items() for seed in own[:fewest]}


def _check_scenarios(runs: Sequence[RunFolder]) -> None:
    """Make sure that a scenario of the same name is the same one, plant included; raises ConfigError."""
    seen: dict[str, tuple[str, Path]] = {}
    for run in runs:
        for scenario, digest in scenario_hashes(run).items():
            other, where = seen.setdefault(scenario, (digest, run.path))
            if digest != other:
                raise ConfigError(f"{run.path}: scenario {scenario!r} or its parameters are not those of {where}")
