"""The trials of a search, kept by Optuna in a journal or in SQLite: finished ones alone, each added in one piece.

What a killed process was busy with is not kept: the next trial follows from the finished ones and the seed, so that it
is found again as it was, and its trainings resume.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from math import isfinite
from pathlib import Path
from typing import Any
from urllib.parse import quote

import optuna
from filelock import FileLock, Timeout
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution
from optuna.storages import BaseStorage, JournalStorage, RDBStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial, TrialState, create_trial

from sffr_agents.folder import first_difference
from sffr_agents.tune_config import Dimension, Value
from sffr_gym.config.reading import parse_json, read_bytes
from sffr_gym.config.strict_yaml import ConfigError

NAME, SEARCH = "sffr", "search"  # of the study, and of its attribute that says which search it is
DATABASES = (".db", ".sqlite", ".sqlite3")
MOST_TRIALS = 32_000_000  # bytes; a trial has about a thousand
SQLITE_HEAD = b"SQLite format 3\0"


class Trials:
    """The finished trials of one search.

    Args:
        file: that keeps them, or what messages call the database.
        study: of Optuna.
        space: what is searched.
    """

    def __init__(self, file: Path | str, study: optuna.Study, space: tuple[Dimension, ...]) -> None:
        self._file, self._study = file, study
        self._space = {dimension.key: _distribution(dimension) for dimension in space}

    def finished(self) -> list[FrozenTrial]:
        """Return the trials in their order; raises ConfigError if one is not of this search."""
        with _reading(self._file):
            trials = self._study.get_trials(states=(TrialState.COMPLETE,))
            for trial in trials:
                create_trial(params=trial.params, distributions=self._space, values=trial.values)  # raises ValueError
                if not isfinite(trial.values[0]):
                    raise ValueError(f"trial {trial.number} has the cost {trial.values[0]}")
        return trials

    def propose(self, untuned: dict[str, Value], seed: int) -> dict[str, Value]:
        """Return the values of the next trial: at first the untuned ones, then what Optuna's TPE samples.

        Args:
            untuned: values of the first trial; those that are missing are sampled.
            seed: of the search.
        """
        known = self.finished()
        study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed + len(known)))
        study.add_trials(known)
        if not known:
            study.enqueue_trial(untuned)
        return study.ask(fixed_distributions=self._space).params

    def add(self, values: dict[str, Value], cost: float) -> None:
        """Keep a finished trial."""
        self._study.add_trial(create_trial(params=values, distributions=self._space, value=cost))

    def best(self) -> FrozenTrial:
        """Return the trial that costs least, the first of several; there must be one."""
        return min(self.finished(), key=lambda trial: float(trial.values[0]))


@contextmanager
def open_trials(file: Path, search: dict[str, Any], space: tuple[Dimension, ...]) -> Iterator[Trials]:
    """Open the trials of a search, which are made if there are none.

    Args:
        file: an SQLite database if its suffix says so, else a journal; nobody else may write to it meanwhile.
        search: what tells the search from others, of plain values.
        space: what is searched.

    Raises:
        ConfigError: if the file is damaged, or holds anything but the trials of this search.
    """
    file.absolute().parent.mkdir(parents=True, exist_ok=True)
    if not os.path.lexists(file) or (file.is_file() and file.stat().st_size == 0):
        _create(file, search)
    else:
        _check_ours(file)
    with _reading(file):
        storage = _storage(file, file.suffix)
        study = optuna.load_study(study_name=NAME, storage=storage)
        held = study.user_attrs.get(SEARCH)
    try:
        if found := first_difference(held, search):
            key, own, asked = found
            raise ConfigError(f"{file}: holds the trials of another search: {key} = {own!r}, not {asked!r}")
        yield Trials(file, study, space)
    finally:
        _close(storage)


@contextmanager
def locked(file: Path) -> Iterator[None]:
    """Keep other processes of this program from a file of trials; raises ConfigError if one has it."""
    try:
        file.absolute().parent.mkdir(parents=True, exist_ok=True)
        lock = FileLock(file.with_name(f".{file.name}.lock"))
        lock.acquire(timeout=0)
    except Timeout:
        raise ConfigError(f"{file}: another process is writing to it; wait, or choose another --storage") from None
    except OSError as error:
        raise ConfigError(f"{file}: cannot be written: {error.strerror or error}") from None
    try:
        yield
    finally:
        lock.release()


class _Held:
    """A lock of Optuna's journal that needs none: the folder or the file is locked already, and for no longer than us.

    Optuna's own ones outlive a process that is killed.
    """

    def acquire(self) -> bool:
        return True

    def release(self) -> None:
        pass


def _distribution(dimension: Dimension) -> BaseDistribution:
    """Return what Optuna calls the values that a setting may take."""
    if dimension.choices is not None:
        return CategoricalDistribution(dimension.choices)
    low, high = dimension.low, dimension.high
    assert low is not None and high is not None  # the model has checked it
    if dimension.whole:
        return IntDistribution(int(low), int(high), log=dimension.log)
    return FloatDistribution(low, high, log=dimension.log)


def _storage(file: Path, suffix: str) -> BaseStorage:
    """Return a database for the suffixes of one, else a journal."""
    if suffix in DATABASES:
        return RDBStorage(f"sqlite:///{file.absolute()}")
    return JournalStorage(JournalFileBackend(str(file), _Held()))  # type: ignore[arg-type]


def _close(storage: BaseStorage) -> None:
    if isinstance(storage, RDBStorage):
        storage.remove_session()
        storage.engine.dispose()


def _create(file: Path, search: dict[str, Any]) -> None:
    """Make a file without trials, whole or not at all."""
    part = file.with_name(f".{file.name}.new")
    for left in part, part.with_name(f"{part.name}-journal"):  # of a process that was killed
        left.unlink(missing_ok=True)
    storage = _storage(part, file.suffix)
    optuna.create_study(storage=storage, study_name=NAME).set_user_attr(SEARCH, search)
    _close(storage)
    os.replace(part, file)


def _check_ours(file: Path) -> None:
    """Make sure that a file holds a study of ours, and cut off what a killed process had begun to write.

    Raises:
        ConfigError: if it is anything else, or is damaged; nothing in it has changed then.
    """
    content = read_bytes(file, MOST_TRIALS)
    if file.suffix in DATABASES:
        names = _names_in_database(file) if content.startswith(SQLITE_HEAD) else []
        whole = len(content)
    else:
        whole = content.rfind(b"\n") + 1
        names = _names_in_journal(file, content[:whole])
    if NAME not in names:
        raise ConfigError(f"{file}: is there, and holds no trials of sffr tune; choose another --storage")
    if whole < len(content):
        os.truncate(file, whole)


def _names_in_journal(file: Path, content: bytes) -> list[Any]:
    """Return the names of a journal's studies; raises ConfigError if one of its lines is none of a journal."""
    names = []
    for number, line in enumerate(content.decode(errors="replace").splitlines(), 1):
        entry = parse_json(line, f"{file}:{number}")
        if not isinstance(entry, dict):
            raise ConfigError(f"{file}:{number}: must hold a mapping of keys to values")
        names.append(entry.get("study_name"))
    return names


def _names_in_database(file: Path) -> list[Any]:
    """Return the names of a database's studies; none if it is no database of Optuna's."""
    try:
        with closing(sqlite3.connect(f"file:{quote(str(file.absolute()))}?mode=ro", uri=True)) as database:
            return [name for (name,) in database.execute("SELECT study_name FROM studies LIMIT 100")]
    except sqlite3.Error:
        return []


@contextmanager
def _reading(file: Path | str) -> Iterator[None]:
    """Turn whatever Optuna raises on damaged trials into a line; raises ConfigError."""
    try:
        yield
    except ConfigError:
        raise
    except Exception as error:  # its parsers and SQLAlchemy have no common error for damaged content
        reason = (str(error).splitlines() or [""])[0][:200]
        raise ConfigError(f"{file}: its trials are damaged: {type(error).__name__}: {reason}") from None
