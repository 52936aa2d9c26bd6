"""The trials of a search in a database that several machines reach: each takes the next one, and sees all.

Unlike those in a file they depend on which machine asks first: the same search again finds other settings.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import optuna
from optuna.storages import RDBStorage
from sqlalchemy.engine import make_url
from sqlalchemy.exc import DatabaseError, IntegrityError, ProgrammingError, SQLAlchemyError

from sffr_agents.folder import first_difference
from sffr_agents.study import SEARCH, Trials
from sffr_agents.tune_config import Dimension, Value
from sffr_gym.config.files import short_hash
from sffr_gym.config.strict_yaml import ConfigError

PREFIX = "sffr-"  # of a study's name, the hash of its search behind
ATTEMPTS, PAUSE = 10, 0.5  # to find what others are making, tables or the first trial, s between them


def is_database(storage: object) -> bool:
    """Say whether a storage is a database's address, such as ``postgresql+psycopg://user@host/trials``, not a file."""
    return isinstance(storage, str) and "://" in storage


class SharedTrials(Trials):
    """The trials of one search, of which others may be running elsewhere; see :class:`study.Trials`.

    Args:
        arguments: of :class:`study.Trials`.
        begun_here: this process made the study, of several that may have begun together.
    """

    _running: optuna.Trial | None = None

    def __init__(self, *arguments: Any, begun_here: bool) -> None:
        super().__init__(*arguments)
        self._begun_here = begun_here

    def propose(self, untuned: dict[str, Value], seed: int) -> dict[str, Value]:
        """Return the values of the next trial: the untuned ones for whoever comes first, then what TPE samples.

        Args:
            untuned: values of the first trial; those that are missing are sampled.
            seed: of the search; of no effect, since trials depend on what other machines have finished.
        """
        for _ in range(0 if self._begun_here else ATTEMPTS):  # whoever made the study begins, or was killed before
            if self._study.get_trials(deepcopy=False):
                break
            time.sleep(PAUSE)
        if not self._study.get_trials(deepcopy=False):
            self._study.enqueue_trial(untuned)
        self._running = self._study.ask(fixed_distributions=self._space)
        return self._running.params

    def add(self, values: dict[str, Value], cost: float) -> None:
        """Finish the trial that was proposed."""
        assert self._running is not None and self._running.params == values
        self._study.tell(self._running, cost)


@contextmanager
def open_shared(url: str, search: dict[str, Any], space: tuple[Dimension, ...]) -> Iterator[SharedTrials]:
    """Open the trials of a search in a database, which are made if there are none.

    Args:
        url: of the database; nothing else in it is touched.
        search: what tells the search from others, of plain values.
        space: what is searched.

    Raises:
        ConfigError: if the database cannot be reached or used; the message has no password.
    """
    try:
        shown = make_url(url).render_as_string(hide_password=True)
        storage = _storage_at(url)
    except (SQLAlchemyError, ImportError, RuntimeError, ValueError) as error:
        what = url.partition("://")[0]
        raise ConfigError(f"storage of {what}: cannot be used: {_first_line(error, url)}") from None
    try:
        sampler = optuna.samplers.TPESampler(constant_liar=True)  # keeps away from what others are trying
        name = f"{PREFIX}{short_hash(search)}"
        try:
            study, begun_here = optuna.create_study(storage=storage, study_name=name, sampler=sampler), True
        except optuna.exceptions.DuplicatedStudyError:
            study, begun_here = optuna.load_study(storage=storage, study_name=name, sampler=sampler), False
        held = study.user_attrs.get(SEARCH)
        if held is None:
            study.set_user_attr(SEARCH, search)
        elif first_difference(held, search):
            raise ConfigError(f"{shown}: its study {name} is of another search")
        yield SharedTrials(shown, study, space, begun_here=begun_here)
    except SQLAlchemyError as error:
        raise ConfigError(f"{shown}: {_first_line(error, url)}") from None
    finally:
        storage.remove_session()
        storage.engine.dispose()


def _storage_at(url: str) -> RDBStorage:
    """Return the storage; machines that begin together make its tables at once, and all but one of them try again."""
    for left in reversed(range(ATTEMPTS)):
        try:
            return RDBStorage(url)
        except DatabaseError as error:
            at_once = isinstance(error, IntegrityError | ProgrammingError) or "already exists" in str(error)
            if not (at_once and left):
                raise
            time.sleep(PAUSE)
    raise AssertionError


def _first_line(error: BaseException, url: str) -> str:
    """Return what is wrong in a line without the address, which may hold a password."""
    return (str(error).splitlines() or [type(error).__name__])[0].replace(url, "...")[:200]
