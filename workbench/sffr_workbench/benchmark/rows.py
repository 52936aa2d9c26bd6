"""Finished episodes of a benchmark, each in a file of its own below ``rows`` of the run folder."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

from sffr_baselines.policies import policy_title
from sffr_gym import ConfigError
from sffr_gym.config.files import to_json, write_whole
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.task.score import Result
from sffr_workbench.common import file_name
from sffr_workbench.evaluation import Episode, read_record

ROWS = "rows"
NAME = re.compile(r"([0-9]+)\.json")  # of an episode's file: its seed
PART = re.compile(r"\.[0-9]+\.json\.[0-9]+")  # of what a killed process left of one


class Task(NamedTuple):
    """One episode to run."""

    scenario: str
    policy: str
    seed: int


def row_files(run: RunFolder, tasks: Sequence[Task]) -> dict[Task, Path]:
    """Return where each finished episode lies; names of scenarios and policies may be paths.

    Raises:
        ConfigError: if a link leads out of the run folder.
    """
    folders: dict[tuple[str, str], Path] = {}
    for scenario, policy, _ in tasks:
        if (scenario, policy) not in folders:
            name = f"{ROWS}/{file_name(scenario)}/{file_name(policy_title(policy))}"
            folders[scenario, policy] = run.place(f"{name}/0.json").parent
    return {task: folders[task.scenario, task.policy] / f"{task.seed}.json" for task in tasks}


def write_row(file: Path, result: Result) -> None:
    """Write the file of a finished episode, whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    write_whole(file, to_json(asdict(result)).encode())


def read_row(file: Path, task: Task, scenario: str) -> Result:
    """Return the episode of a file.

    Args:
        file: to read.
        task: whose episode it must be.
        scenario: name of the task's scenario.

    Raises:
        ConfigError: if the file is damaged, or holds another episode: not what a benchmark wrote, which writes whole
            files.
    """
    advice = "remove the file, and the same command runs this episode again"
    try:
        found = read_record(Episode, file).result()
    except ConfigError as error:
        raise ConfigError("\n".join(f"{line}; {advice}" for line in str(error).split("\n"))) from None
    wanted = scenario, policy_title(task.policy), task.seed
    if (found.scenario, found.policy, found.seed) != wanted:
        raise ConfigError(f"{file}: holds another episode than that of {', '.join(map(str, wanted))}; {advice}")
    return found


def remove_rows(run: RunFolder) -> None:
    """Remove all finished episodes of a run, and the folders that are empty then; what is no episode stays."""
    for folder, names in _folders(run):
        for name in names:
            if (match := NAME.fullmatch(name)) and _is_row(folder / name, int(match[1])):
                (folder / name).unlink()
        for emptied in (folder, folder.parent):
            if not any(emptied.iterdir()):
                emptied.rmdir()


def remove_parts(run: RunFolder) -> None:
    """Remove what killed processes left of files that they had not finished."""
    for folder, names in _folders(run):
        for name in filter(PART.fullmatch, names):
            (folder / name).unlink(missing_ok=True)  # a process that is about to end may be faster


def _folders(run: RunFolder) -> Iterator[tuple[Path, list[str]]]:
    """Yield the folders of episodes with the names in them; none is a link."""
    top = run.place(f"{ROWS}/x").parent
    for scenario in sorted(top.iterdir()) if top.is_dir() else ():
        for policy in sorted(scenario.iterdir()) if _is_folder(scenario) else ():
            if _is_folder(policy):
                yield policy, sorted(entry.name for entry in policy.iterdir())


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()


def _is_row(file: Path, seed: int) -> bool:
    """Say whether a file holds an episode of a seed."""
    try:
        return not file.is_symlink() and read_record(Episode, file).seed == seed
    except ConfigError:
        return False
