"""The one way in for files of others: bounds on size, depth and type are checked before anything is expanded.

Every reader raises :class:`ConfigError` with the file's name, what is wrong with it and what would be right, whatever
the bytes are; nothing of a file is ever run.
"""

from __future__ import annotations

import csv
import io
import json
import os
import stat
import zipfile
from collections.abc import Iterable
from math import prod
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from sffr_gym.config.errors import ConfigError, one_line

MOST_JSON = 32_000_000  # bytes; a search's plan or a run's manifest has some 10 kB
MOST_DEPTH = 50  # of lists and mappings in each other; a manifest has 6
MOST_CSV = 100_000_000  # bytes; 200,000 episodes
MOST_ARRAYS = 400_000_000  # bytes of all arrays of a file, expanded
MOST_MEMBERS = 4096  # of a zip archive
ZIP_ENTRY = b"PK\1\2"  # begins what an archive says of a member
MOST_HEADER = 10_000  # characters of an array's header
PLAIN = "?biufU"  # kinds of numbers, and texts; no objects, which would have to be unpickled


def read_bytes(file: Path, most: int) -> bytes:
    """Return the content of a regular file of at most ``most`` bytes.

    Raises:
        ConfigError: if it cannot be read, is no regular file or is larger.
    """
    try:
        with open(file, "rb", opener=_open_without_waiting) as opened:
            about = os.fstat(opened.fileno())
            if not stat.S_ISREG(about.st_mode):
                raise ConfigError(f"{file}: is not a regular file")
            content = opened.read(min(about.st_size, most) + 1)
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:  # a NUL in the name
        raise (
            error if isinstance(error, ConfigError) else ConfigError(f"{str(file)!r}: cannot be read: {error}")
        ) from None
    size = max(about.st_size, len(content))
    if size > most:
        raise ConfigError(f"{file}: is too large: {size / 1e6:,.1f} MB, at most {most / 1e6:,.1f} MB are read")
    return content


def _open_without_waiting(file: str, flags: int) -> int:
    """Open a file; a pipe that nobody writes to would be waited for."""
    return os.open(file, flags | getattr(os, "O_NONBLOCK", 0))


def read_text(file: Path, most: int) -> str:
    """Return the text of a file in UTF-8, with or without a byte order mark.

    Raises:
        ConfigError: see :func:`read_bytes`, and for another encoding.
    """
    try:
        return read_bytes(file, most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"{file}: is not text in UTF-8: byte {error.start + 1} is {error.object[error.start]:#04x}"
        ) from None


def read_json(file: Path, most: int = MOST_JSON) -> Any:
    """Return the value of a JSON file; see :func:`parse_json`."""
    return parse_json(read_text(file, most), str(file))


def parse_json(text: str, where: str) -> Any:
    """Return the value of a JSON text.

    Raises:
        ConfigError: if it is no JSON, gives a key twice, holds NaN or infinity, or is nested too deeply.
    """
    try:
        value = json.loads(text, object_pairs_hook=_distinct, parse_constant=_reject_constant)
        _check_depth(value)
        return value
    except RecursionError:
        raise ConfigError(f"{where}: is nested too deeply") from None
    except ValueError as error:
        raise ConfigError(f"{where}: is no valid JSON: {one_line(str(error))}") from None


def read_csv(file: Path, columns: Iterable[str]) -> list[dict[str, str]]:
    """Return the rows of a CSV file, by the names of its columns; see :func:`read_text` and :func:`parse_csv`."""
    return parse_csv(read_text(file, MOST_CSV), columns, str(file))


def parse_csv(text: str, columns: Iterable[str], where: str) -> list[dict[str, str]]:
    """Return the rows of a CSV text, by the names of its columns.

    Args:
        text: what to read.
        columns: names that must be among those of the first line.
        where: what it is, for messages.

    Raises:
        ConfigError: if it is no CSV, a column is missing or named twice, or a row has another length.
    """
    try:
        lines = list(csv.reader(io.StringIO(text, newline=""), strict=True))
    except csv.Error as error:
        raise ConfigError(f"{where}: is no valid CSV: {error}") from None
    head = lines[0] if lines else []
    for name in columns:
        if name not in head:
            raise ConfigError(f"{where}: has no column {name!r}")
    if len(set(head)) < len(head):
        raise ConfigError(f"{where}:1: has two columns of the same name")
    for number, line in enumerate(lines[1:], 2):
        if len(line) != len(head):
            raise ConfigError(f"{where}:{number}: must have {len(head)} entries, has {len(line)}")
    return [dict(zip(head, line, strict=True)) for line in lines[1:]]


def read_arrays(file: Path, most: int = MOST_ARRAYS) -> dict[str, np.ndarray]:
    """Return the arrays of an ``.npz`` file, of numbers and texts alone.

    Args:
        file: what to read.
        most: bytes of all its arrays together, compared with what the file announces before anything is expanded.

    Raises:
        ConfigError: if it cannot be read, is larger, is damaged or holds anything else.
    """
    content = read_bytes(file, most)
    try:
        with open_archive(content, most) as archive:
            members = archive.infolist()
            arrays = {member.filename.removesuffix(".npy"): _read_array(archive, member) for member in members}
    except Exception as error:  # zipfile, zlib and the parsers of headers have no common error for damaged bytes
        raise ConfigError(f"{file}: is no .npz file of plain arrays, or is damaged: {one_line(str(error))}") from None
    if len(arrays) < len(members):
        raise ConfigError(f"{file}: has two arrays of the same name")
    return arrays


def open_archive(content: bytes, most: int) -> zipfile.ZipFile:
    """Return a zip archive whose members have at most ``most`` bytes in all, expanded; see :func:`read_member`.

    Raises:
        ValueError: for more or larger members, beside what zipfile raises for damaged bytes.
    """
    count = content.count(ZIP_ENTRY)  # before zipfile makes an object of each
    if count > MOST_MEMBERS:
        raise ValueError(f"{count} members, at most {MOST_MEMBERS} are read")
    archive = zipfile.ZipFile(io.BytesIO(content))
    size = sum(member.file_size for member in archive.infolist())
    if size > most:
        raise ValueError(f"{size / 1e6:,.1f} MB once it is expanded, at most {most / 1e6:,.1f} MB are read")
    return archive


def read_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    """Return the content of a member of an archive, never more than the archive announces.

    Raises:
        ValueError: for a method of compression that would expand without a bound.
    """
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{member.filename!r} is compressed by method {member.compress_type}")
    with archive.open(member) as packed:
        return packed.read(member.file_size)


def _read_array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    """Return an array of an archive; never more is expanded than the archive announces, nor more allocated.

    Raises:
        ValueError: for an array that is not plain, or whose header does not fit its bytes; beside what the parsers of
            damaged bytes raise.
    """
    name = member.filename.removesuffix(".npy")
    content = bytearray(read_member(archive, member))
    stream = io.BytesIO(content)
    version = np.lib.format.read_magic(stream)
    if version not in _HEADER_READERS:
        raise ValueError(f"array {name!r} has version {version} of the format")
    shape, in_columns, dtype = _HEADER_READERS[version](stream, max_header_size=MOST_HEADER)
    if dtype.kind not in PLAIN or dtype.itemsize == 0:
        raise ValueError(f"array {name!r} is of type {dtype}; must hold numbers or texts")
    start = stream.tell()
    if min(shape, default=0) < 0 or prod(shape) * dtype.itemsize != len(content) - start:
        raise ValueError(f"array {name!r} has {len(content) - start} bytes, not those of {dtype}{list(shape)}")
    values = np.frombuffer(content, dtype, offset=start).reshape(shape, order="F" if in_columns else "C")
    return values if dtype.isnative else values.astype(dtype.newbyteorder("="))


_HEADER_READERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the pairs of a JSON object as a mapping; raises ValueError if it has a key twice."""
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"key {next(name for name in names if names.count(name) > 1)!r} is given twice")
    return found


def _check_depth(value: Any) -> None:
    """Raise RecursionError if a value is nested more deeply than whoever walks through it can follow."""
    level = [value]
    for _ in range(MOST_DEPTH + 1):
        level = [
            child
            for each in level
            if isinstance(each, dict | list)
            for child in (each.values() if isinstance(each, dict) else each)
        ]
        if not level:
            return
    raise RecursionError


def _reject_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")
