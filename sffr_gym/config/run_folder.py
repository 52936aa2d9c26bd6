"""The one owner of run folders: which folder a run may write to, and which files in it are its own.

A run folder holds a file ``sffr-run.json`` that says of what kind the run is, whether it is finished and which files it
wrote. A folder that holds anything else is never written to, and no file is replaced or removed that is not in that
list. A process keeps a lock on the folder that it writes to; it ends with the process, however that ends.

Files that belong together are replaced together: they are written beside the old ones, and a list of what replaces what
is put into ``sffr-run.json`` before the first old file goes. Whoever opens the folder next finishes what a killed
process had begun.
"""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Annotated, Self

from filelock import FileLock, Timeout
from pydantic import AfterValidator, Field

from sffr_gym.config.errors import ConfigError
from sffr_gym.config.files import to_json, write_whole
from sffr_gym.config.reading import read_json
from sffr_gym.config.sections import Section
from sffr_gym.config.strict_yaml import build, check_error

CARD, LOCK = "sffr-run.json", ".sffr-run.lock"
FORMAT = 1  # of run folders; a newer one is not touched
KINDS = {  # of runs, and what leaves them
    "evaluation": "sffr evaluate", "benchmark": "sffr benchmark", "training": "sffr train", "search": "sffr tune",
    "verification": "sffr verify", "reproduction": "sffr reproduce", "speed": "sffr bench",
    "pages": "sffr benchmark --docs", "sweep": "sffr sweep", "export": "sffr export-run",
    "trainings": "sffr sweep-train",
}  # fmt: skip
MOST_CARD = 10_000_000  # bytes
MOST_FILES = 10_000  # whose remains are looked for whenever a run begins; files of one kind have a folder on the list


def _inside(name: str) -> str:
    """Return a name as it is; raises an error of pydantic if it leads out of the folder or is none."""
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or "\\" in name or ":" in name or not path.parts:
        raise check_error("leads out of the folder")
    if not name.isprintable():
        raise check_error("is no name of a file")
    return name


Inside = Annotated[str, AfterValidator(_inside)]


class Card(Section):
    """What ``sffr-run.json`` says."""

    kind: str = Field(description="of the run")
    format: int = Field(ge=1, description="of the folder")
    finished: bool = Field(description="whether the run is")
    files: tuple[Inside, ...] = Field(max_length=MOST_FILES, description="that the run wrote, without this one")
    replacing: dict[Inside, Inside | None] = Field(
        default={}, description="what waits to take the place of a file, by its name; null if the file only goes"
    )


class RunFolder:
    """A run folder that this process writes to, or reads.

    Args:
        path: of the folder.
        card: what it says of itself.
    """

    def __init__(self, path: Path, card: Card, lock: FileLock | None = None) -> None:
        self.path, self._card, self._lock = path, card, lock
        self._made = False  # by this process

    @classmethod
    def claim(
        cls, path: Path, kind: str, *, overwrite: bool = False, resume: bool = False, shared: bool = False
    ) -> Self:
        """Take a folder for a run of a kind, and keep others from writing to it until :meth:`release`.

        Args:
            path: made if need be.
            kind: a key of :data:`KINDS`.
            overwrite: a finished run of this kind may be replaced.
            resume: a finished run of this kind may be added to.
            shared: the folder may hold files of others.

        Raises:
            ConfigError: if it holds anything but an unfinished run of this kind, cannot be written, or another process
                writes to it; nothing in it has changed then.
        """
        held, made = _check(path, kind, overwrite or resume, shared), not path.exists()
        try:
            path.mkdir(parents=True, exist_ok=True)
            lock = FileLock(path / LOCK)
            lock.acquire(timeout=0)
        except Timeout:
            raise ConfigError(
                f"{path}: another process is writing to it; wait, or choose another folder with --out"
            ) from None
        except OSError as error:
            raise ConfigError(f"{path}: cannot be written: {error.strerror or error}") from None
        try:
            held = _check(path, kind, overwrite or resume, shared)  # again: now nobody else can change it
            folder = cls(path, held or Card(kind=kind, format=FORMAT, finished=False, files=()), lock)
            folder._made = made
            folder._finish_replacing()
            folder._remove_parts()
            if held is None:
                folder._write_card()
        except BaseException:
            lock.release()
            raise
        return folder

    @classmethod
    def open(cls, path: Path, *kinds: str, finished: bool = True) -> Self:
        """Return a folder to read from; it is not locked.

        Args:
            path: of the folder.
            kinds: that will do; none for all.
            finished: whether the run has to be.

        Raises:
            ConfigError: if it holds no such run, or a damaged one.
        """
        wanted = " or ".join(KINDS[kind] for kind in kinds or KINDS)
        card = _read_card(path)
        if card is None:
            raise ConfigError(f"{path}: holds no run of {wanted} ({CARD} is missing)")
        if kinds and card.kind not in kinds:
            raise ConfigError(f"{path}: holds a run of {_maker(card)}, not of {wanted}")
        if finished and not card.finished:
            raise ConfigError(f"{path}: holds a run of {_maker(card)} that is not finished")
        return cls(path, card)

    @property
    def kind(self) -> str:
        """Return the kind of the run."""
        return self._card.kind

    @property
    def finished(self) -> bool:
        """Say whether the run is finished."""
        return self._card.finished

    @property
    def files(self) -> tuple[str, ...]:
        """Return the names of the files that the run wrote, less those that are to go."""
        return tuple(name for name in self._card.files if self._card.replacing.get(name, name) is not None)

    def file(self, name: str) -> Path:
        """Return where a file of the run is to be read; it need not exist."""
        waiting = self.path / (self._card.replacing.get(name) or name)
        return waiting if waiting.exists() else self.path / name

    def place(self, name: str) -> Path:
        """Return where a file of the run lies.

        Raises:
            ConfigError: if a link leads out of the folder.
        """
        target = self.path / name
        if not target.parent.resolve().is_relative_to(self.path.resolve()):
            raise ConfigError(f"{target.parent}: leads out of the run folder")
        return target

    def check_names(self, names: Collection[str]) -> None:
        """Make sure, before anything runs, that files may be written under these names.

        Raises:
            ConfigError: if one is there that is not of this run.
        """
        for name in names:
            if os.path.lexists(place := self.place(name)) and name not in self._card.files:
                raise ConfigError(f"{place}: is there, and was not written by this run; move it away first")

    def own(self, *names: str) -> None:
        """Put files, or folders by their names, on the list of what the run writes; see :meth:`check_names`."""
        self.check_names(names)
        if set(names) - set(self._card.files):
            self._update(files=tuple(dict.fromkeys([*self._card.files, *names])))

    def write(self, name: str, content: bytes) -> Path:
        """Write a file of the run, whole or not at all.

        Raises:
            ConfigError: see :meth:`check_names`.
        """
        self.own(name)
        target = self.place(name)
        target.parent.mkdir(parents=True, exist_ok=True)
        return write_whole(target, content)

    def replace(self, contents: Mapping[str, bytes], remove: Collection[str] = (), finished: bool = True) -> list[Path]:
        """Write files and remove others, all of it or nothing, and note whether the run is finished now.

        Args:
            contents: of the files, by their names.
            remove: names of files of the run that are no longer true; names in ``contents`` do not matter.
            finished: what the folder says afterwards.

        Raises:
            ConfigError: see :meth:`check_names`.
        """
        self.check_names(contents)
        parts = {name: str(PurePosixPath(name).with_name(f".{PurePosixPath(name).name}.new")) for name in contents}
        self.own(*contents)
        for name, part in parts.items():
            self.place(name).parent.mkdir(parents=True, exist_ok=True)
            write_whole(self.place(part), contents[name])
        gone = dict.fromkeys(name for name in remove if name in self._card.files and name not in contents)
        self._update(replacing=parts | gone, finished=finished)
        self._finish_replacing()
        return [self.path / name for name in contents]

    def finish(self) -> None:
        """Note that the run is finished."""
        self._update(finished=True)

    def begin_again(self) -> None:
        """Note that the run is not finished any more."""
        self._update(finished=False)

    def release(self) -> None:
        """Let others write to the folder."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    def __enter__(self) -> Self:
        """Return the folder; it is released at the end of the block."""
        return self

    def __exit__(self, *error: object) -> None:
        """Release the folder; one that was made for a run that ended before it wrote anything goes."""
        if error[0] is not None and self._made and not self._card.files:
            with suppress(OSError):  # somebody else put something into it
                (self.path / CARD).unlink()
                (self.path / LOCK).unlink()
                self.path.rmdir()
        self.release()

    def _update(self, **changes: object) -> None:
        """Change what the folder says of itself."""
        self._card = self._card.model_copy(update=changes)
        self._write_card()

    def _write_card(self) -> None:
        assert self._lock is not None, "a folder that is only read"
        write_whole(self.path / CARD, to_json(self._card.model_dump(mode="json")).encode())

    def _finish_replacing(self) -> None:
        """Put files into their places whose turn it was when the last process ended."""
        for name, part in self._card.replacing.items():
            if part is None:
                self.place(name).unlink(missing_ok=True)
            elif self.place(part).exists():
                os.replace(self.place(part), self.place(name))
        if self._card.replacing:
            self._update(files=self.files, replacing={})

    def _remove_parts(self) -> None:
        """Remove what a killed process left of files that it had not finished; the names are those it gave them."""
        for name in (CARD, *self._card.files):
            target = self.place(name)
            part = re.compile(rf"\.{{1,2}}{re.escape(target.name)}(\.new)?(\.\d+)?")
            for file in target.parent.glob(f".*{glob.escape(target.name)}*"):
                if part.fullmatch(file.name):
                    file.unlink()


def _check(path: Path, kind: str, again: bool, shared: bool) -> Card | None:
    """Return what a folder says of itself, None if it is new; see :meth:`RunFolder.claim` for what is refused."""
    try:
        if os.path.lexists(path) and not path.is_dir():
            raise ConfigError(f"{path}: is not a folder; choose another one with --out")
        others = [entry for entry in (os.listdir(path) if path.is_dir() else ()) if entry != LOCK]
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise ConfigError(f"{str(path)!r}: is no name of a folder: {error}") from None
    card = _read_card(path)
    if card is None:
        if others and not shared:
            raise ConfigError(
                f"{path}: is not empty and holds no run of {KINDS[kind]} ({CARD} is missing); choose another folder "
                "with --out"
            )
        return None
    if card.kind != kind:
        raise ConfigError(
            f"{path}: holds a run of {_maker(card)}, not of {KINDS[kind]}; choose another folder with --out"
        )
    if card.finished and not again:
        raise ConfigError(f"{path}: holds a finished run; choose another folder with --out or add --overwrite")
    return card


def _read_card(path: Path) -> Card | None:
    """Return what a folder says of itself, None if it is no run folder; raises ConfigError if that is damaged."""
    file = path / CARD
    if not os.path.lexists(file):
        return None
    data = read_json(file, MOST_CARD)
    if not isinstance(data, dict):
        raise ConfigError(f"{file}: must hold a mapping of keys to values")
    if isinstance(data.get("format"), int) and data["format"] > FORMAT:
        raise ConfigError(f"{file}: format = {data['format']}: was written by a newer version of sffr-gym")
    return build(Card, data, lambda key: str(file))


def _maker(card: Card) -> str:
    """Return the command that leaves runs of a kind."""
    return KINDS.get(card.kind, repr(card.kind))
