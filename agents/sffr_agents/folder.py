"""The folder of a training: what its files are called, what was trained, where it comes from, and how far it got."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import Field

from sffr_agents.config import VALIDATION_SEED, TrainConfig, from_dict
from sffr_gym.config.files import to_json
from sffr_gym.config.provenance import MANIFEST
from sffr_gym.config.reading import read_json
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.config.sections import Section
from sffr_gym.config.strict_yaml import ConfigError, build
from sffr_gym.task.scenario import EVALUATION_SEED

CONFIG, PROGRESS, CHECKPOINTS, TENSORBOARD = "train.json", "progress.csv", "checkpoints", "tensorboard"
STEPS, SECONDS = "steps", "time/seconds"  # columns of the progress file
BEST, LAST = "best.npz", "last.npz"
KIND = "training"  # of the run folder

Tell = Callable[[str], Any]  # called with a line for the user


class Begun(Section):
    """What ``train.json`` says."""

    seed: int = Field(description="of everything random")
    config: dict[str, Any] = Field(description="what is trained; see config.TrainConfig")


def check_seed(config: TrainConfig, seed: int, where: str = "") -> None:
    """Raise ConfigError for a seed that training must not take; its message begins with where the seed is from."""
    largest = VALIDATION_SEED - config.n_envs
    if not 0 <= seed <= largest:
        raise ConfigError(
            f"{where}seed = {seed}: training takes 0 to {largest}; the seeds from {VALIDATION_SEED} up choose the best "
            f"model, and those from {EVALUATION_SEED} up are for evaluation alone"
        )


def holds_run(out: Path) -> bool:
    """Say whether a training has begun in a folder, finished or not."""
    return (out / CONFIG).is_file()


def begin_run(run: RunFolder, config: TrainConfig, seed: int, facts: dict[str, Any]) -> None:
    """Write where a training comes from and what it is, as the sign that the folder holds one.

    Raises:
        ConfigError: if the folder holds a training, or a file of another's under a name that this one needs.
    """
    if holds_run(run.path):
        raise ConfigError(f"{run.path}: holds a training; resume it with --resume, or choose another folder with --out")
    run.own(PROGRESS, CHECKPOINTS, TENSORBOARD, BEST, LAST)
    begun = Begun(seed=seed, config=config.model_dump(mode="json"))
    texts = {MANIFEST: to_json(facts), CONFIG: to_json(begun.model_dump(mode="json"))}
    run.replace({name: text.encode() for name, text in texts.items()}, finished=False)


def finish_run(run: RunFolder, facts: dict[str, Any], elapsed: float) -> None:
    """Note how long a training took in all [s], and that it is finished."""
    run.write(MANIFEST, to_json(facts | {"duration_s": elapsed}).encode())
    run.finish()


def read_run(out: Path) -> tuple[TrainConfig, int]:
    """Return configuration and seed of a run folder.

    Raises:
        ConfigError: if it holds no training, or a damaged file.
    """
    file = RunFolder.open(out, KIND, finished=False).file(CONFIG)
    if not file.exists():
        raise ConfigError(f"{out}: has a training that has not begun ({CONFIG} is missing); leave out --resume")

    def where(key: object) -> str:
        return str(file)

    begun = build(Begun, _mapping(file), where)
    config = from_dict(begun.config, where)
    check_seed(config, begun.seed, f"{file}: ")
    return config, begun.seed


def read_facts(run: RunFolder) -> dict[str, Any]:
    """Return where a training comes from; raises ConfigError for a damaged file."""
    return _mapping(run.file(MANIFEST))


def first_difference(held: Any, asked: Any, key: str = "") -> tuple[str, Any, Any] | None:
    """Return the first key at which plain values differ, with both of its values; None if they are the same."""
    if not (isinstance(held, dict) and isinstance(asked, dict)):
        return None if held == asked else (key, held, asked)
    for name in dict.fromkeys([*held, *asked]):
        inner = f"{key}.{name}" if key else str(name)
        if found := first_difference(held.get(name), asked.get(name), inner):
            return found
    return None


@contextmanager
def writing(folder: Path, kept: Callable[[], str]) -> Iterator[None]:
    """Turn a folder that cannot be written to any more, such as a full disk, into an error that says what was kept.

    Raises:
        ConfigError: for an OSError inside.
    """
    try:
        yield
    except OSError as error:
        raise ConfigError(f"{error.filename or folder}: {error.strerror or error}; {kept()}") from None


def _mapping(file: Path) -> dict[str, Any]:
    """Return the mapping in a JSON file; raises ConfigError if it holds anything else."""
    data = read_json(file)
    if not isinstance(data, dict):
        raise ConfigError(f"{file}: must hold a mapping of keys to values")
    return data
